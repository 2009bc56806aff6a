"""A run's lateness in words: its stalls, the reaction on hardware, and advice for this machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.realtime import LateConfig
from teleop_rt.realtime.lateness import ON_HARDWARE, Lateness, late_ns
from teleop_rt.realtime.scheduling import FIFO, LOCKED, PINNED, Privilege
from teleop_rt.slave.faults import State
from teleop_rt.slave.safety import SafetyChain

Array = NDArray[np.float64]

_POWERED = frozenset({State.ARMED, State.RUN, State.HOLD})
EASY_RATE_HZ = 250
"""A rate at which a busy machine holds the loop: half of a core is idle even where it is slow."""


def late_outcome(safety: SafetyChain) -> dict[str, Any]:
    """Return the loop's counts of lateness under power, by both sets of bounds."""
    return both(safety.late, safety.on_hardware)


def recorded(slave: Mapping[str, Array], bounds: LateConfig, period_ns: int) -> dict[str, Any]:
    """Return the same from the recorded rows of a slave that could no longer report it."""
    late, on_hardware = Lateness(bounds, period_ns), Lateness(ON_HARDWARE, period_ns)
    skipped = np.diff(slave["tick"]).astype(np.int64) - 1
    # A latency that is not measured, as on the simulated clock, is in time.
    latency_ns = np.nan_to_num(1e3 * slave["wake_latency_us"]).astype(np.int64)
    states = slave["state"]
    for row in range(1, states.size):
        if states[row - 1] not in _POWERED:
            continue
        if row == 1 or states[row - 2] not in _POWERED:  # armed after the last cycle
            late.reset()
            on_hardware.reset()
        now_ns = late_ns(int(skipped[row - 1]), int(latency_ns[row]), period_ns)
        late.update(now_ns)
        if not on_hardware.stopped:
            on_hardware.update(now_ns)
    return both(late, on_hardware)


def both(late: Lateness, on_hardware: Lateness) -> dict[str, Any]:
    """Return lateness as a summary has it: by the rig's bounds, and by those for hardware."""
    return {**late.outcome(), "on_hardware": on_hardware.outcome()}


def cause(late: Mapping[str, Any]) -> str:
    """Return why lateness stopped the axis, with the bound; `late` has a stop."""
    stop, bounds = late["stop"], late["bounds"]
    if stop["bound"] == "stop_ms":
        return (
            f"the loop stalled for {stop['stall_ms']:.1f} ms after {stop['after_s']:.1f} s under "
            f"power; realtime.late.stop_ms is {bounds['stop_ms']:g}"
        )
    return (
        f"{100 * bounds['stop_share']:g} % of a second's ticks were late after "
        f"{stop['after_s']:.1f} s under power; realtime.late.stop_share is {bounds['stop_share']:g}"
    )


def advice(
    privileges: Sequence[Privilege], rate_hz: int, cpu: int | None, *, simulated: bool
) -> str:
    """Return advice for this machine's loop to be in time, never a measure that it has already.

    `simulated` says that the rig is, so that the same trial can run on simulated time.
    """
    fifo = next((one for one in privileges if one.name == FIFO), None)
    instead = ["run it with --clock simulated"] if simulated else []
    if fifo is not None and not fifo.granted:
        return "; or ".join([f"get real-time priority: {fifo.how_to_grant}", *instead])
    if rate_hz > EASY_RATE_HZ:
        instead.append(f"lower the rate with --set rig.rate_hz={EASY_RATE_HZ}")
    if not simulated and cpu is None:
        instead.append("give the loop a core of its own (realtime.cpu of the rig)")
    if not instead:
        instead.append("end other programs on this machine")
    return "; or ".join(instead)


def stalls(late: Mapping[str, Any]) -> str:
    """Return the longest stall and the holds, in words."""
    text = f"{late['longest_stall_ms']:.1f} ms"
    if late["holds"]:
        text += f", held {_times(late['holds'])} (from {late['bounds']['hold_ms']:g} ms on)"
    return text


def on_hardware(late: Mapping[str, Any]) -> str:
    """Return the reaction of a rig with the default bounds to the same lateness."""
    hardware = late["on_hardware"]
    bounds, stop, holds = hardware["bounds"], hardware["stop"], hardware["holds"]
    limits = ", ".join(f"{key} {value:g}" for key, value in bounds.items())
    held = f"would have held {_times(holds)}" if holds else "would have run on"
    if stop is not None:
        why = f"{stop['stall_ms']:.1f} ms" if stop["bound"] == "stop_ms" else "too many late ticks"
        held = f"would have stopped after {stop['after_s']:.1f} s: {why}"
    return f"{held} ({limits})"


def privileges_text(described: Sequence[str]) -> str:
    """Return which privileges the loop had, from the system's reply to each request."""
    reply = {line.partition(":")[0]: line.partition(": ")[2] for line in described}
    had = [f"{name} {reply[name].partition(';')[0]}" for name in (FIFO, LOCKED) if name in reply]
    pins = [f"{name} {said}" for name, said in reply.items() if name.startswith(PINNED[:4])]
    return ", ".join([*had, *(pins or ["any core (realtime.cpu is not set)"])])


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
