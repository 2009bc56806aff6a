"""The rows of the fault table: each one's injection, the required reaction, and its time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teleop_rt.slave.faults import State
from teleop_rt_dev.faults.checks import (
    STOPPED,
    Check,
    counted_hostile,
    goes_back_to_the_surface,
    goes_on_once_healed,
    goes_on_without_a_step,
    held,
    held_for_a_stall,
    hung,
    in_hold,
    late_now_and_then,
    limited,
    named_by_comparison,
    never_beyond_the_limits,
    none_accepted,
    nothing_waited,
    number_again,
    power_returns,
    rejected,
    rejected_and_going_on,
    restart_is_disarmed,
    stays_off,
    stopped,
    stopped_while_jammed,
)
from teleop_rt_dev.faults.disk import alarmed, fill_the_disk, goes_on_and_loses_nothing
from teleop_rt_dev.faults.injections import (
    ask_for_the_moon,
    corrupt_for_two_cycles,
    deliver,
    error_passive,
    frame,
    freeze_daemon,
    hostile_packets,
    impossible,
    jam,
    mute,
    mute_for_six_cycles,
    not_a_number,
    nothing,
    power_cut,
    silence,
    stalled,
    unplugged,
    wild_models,
)
from teleop_rt_dev.faults.master_checks import (
    applied_in_order,
    declutches_and_fades,
    master_is,
    reduced,
    refused_models,
    renders_sanely,
    within_the_passive_bound,
)
from teleop_rt_dev.faults.world import WATCHDOG_MS, FaultWorld, Phase

if TYPE_CHECKING:
    pass

MOVING: tuple[Phase, ...] = ("approach", "contact", "release")


@dataclass(frozen=True)
class Row:
    """One fault: `detected` must hold within `bound_ms`; `then` returns failed checks after it."""

    name: str
    inject: Callable[[FaultWorld], Any]
    detected: Check
    bound_ms: int
    stops: bool = True
    fault: str | None = None
    rig: str = "canopen"
    phases: tuple[Phase, ...] = ("arming", "approach", "contact", "release")
    overrides: tuple[str, ...] = ()
    then: Callable[[FaultWorld], str] = lambda world: ""
    before_arming: bool = False


ON_HARDWARE = ("rig.realtime.late={hold_ms: 5, stop_ms: 20, stop_share: 0.2}",)
PRESSES_ON = ("operator.mean_m=0.02", "operator.amplitude_m=0.012")
"""On to 115 N: a stuck sensor does harm to a person who leads on by the felt force."""
BAD_NETWORK = (
    "link.round_trip_ms=400", "link.jitter_ms=100", "link.loss=0.3", "link.duplicate=0.05",
    "link.reorder=0.05",
)  # fmt: skip

ROWS = (
    Row("3 cycles without a valid sample", mute_for_six_cycles, held, 5, stops=False,
        then=goes_on_once_healed),
    Row("20 cycles without a valid sample", mute("force sensor"), stopped, 25,
        fault="samples_lost", overrides=ON_HARDWARE),
    Row("encoder dies", mute("encoder"), stopped, 80, fault="samples_lost", overrides=ON_HARDWARE),
    Row("drive dies", mute("drive"), stopped, 30, fault="drive_silent", phases=MOVING),
    Row("drive's status never comes", lambda w: w.rig.inject("mute_pdo", "drive"), stopped, 30,
        fault="drive_silent", phases=MOVING, then=stays_off),
    Row("tool jams", jam, stopped_while_jammed, 300, phases=MOVING, then=named_by_comparison),
    Row("force sensor sticks", lambda w: w.rig.inject("freeze", "force sensor"), stopped, 1500,
        fault="force_mismatch", phases=("contact",), then=stays_off, overrides=PRESSES_ON),
    Row("daemon killed or frozen", freeze_daemon, lambda w: w.stopped, 70, stops=False,
        phases=MOVING, then=restart_is_disarmed),
    Row("bus-off", lambda w: w.rig.inject("bus_off"), stopped, 2, fault="bus_off",
        then=stays_off),
    Row("error-passive", error_passive, stopped, 2, fault="error_passive", then=stays_off),
    Row("e-stop, then power returns", power_cut, stopped, 80, phases=MOVING, then=power_returns),
    Row("nobody acknowledges, then they do", lambda w: w.rig.inject("no_acknowledge", "drive"),
        stopped, 25, fault="not_acknowledged", then=nothing_waited),
    Row("malformed frames", corrupt_for_two_cycles, rejected, 3, stops=False,
        then=rejected_and_going_on),
    Row("impossible jump", lambda w: impossible(w, (10**7).to_bytes(4, "little") + bytes(4)),
        rejected, 3, stops=False, then=rejected_and_going_on),
    Row("wrong length", lambda w: impossible(w, bytes(6)), rejected, 3, stops=False,
        then=rejected_and_going_on),
    Row("emergency", lambda w: w.rig.inject("emergency", "drive"), stopped, 2, fault="emergency",
        then=stays_off),
    Row("duplicate node", lambda w: w.rig.inject("duplicate", "encoder"), stopped, 10,
        fault="duplicate_node"),
    Row("foreign SYNC", lambda w: deliver(w, frame(0x080)), stopped, 2, fault="foreign_master"),
    Row("foreign NMT", lambda w: deliver(w, frame(0x000, b"\x80\x00")), stopped, 2,
        fault="foreign_master"),
    Row("cable of the force sensor pulled", unplugged("force sensor"), stopped, 25, rig="serial",
        fault="unplugged", then=stays_off),
    Row("cable of the drive pulled", unplugged("drive"), stopped, 25, rig="serial",
        fault="unplugged"),
    Row("loop stalls for 3 ms", stalled(3), lambda w: w.state is not State.HOLD, 1, stops=False,
        overrides=ON_HARDWARE, phases=MOVING, then=goes_on_without_a_step),
    Row("loop stalls for 15 ms", stalled(15), held_for_a_stall, 1, stops=False,
        overrides=ON_HARDWARE, phases=MOVING, then=goes_on_without_a_step),
    Row("loop stalls for 30 ms", stalled(30), stopped, 1, fault="late_ticks",
        overrides=ON_HARDWARE),
    Row("a fifth of a second is late", nothing, late_now_and_then, 510, fault="late_ticks",
        overrides=ON_HARDWARE, phases=MOVING),
    Row("not a number", not_a_number, rejected, 3, stops=False, rig="serial", then=number_again),
    Row("hung loop: watchdog", freeze_daemon, hung, WATCHDOG_MS, stops=False, phases=MOVING,
        then=restart_is_disarmed),
    Row("disk full", fill_the_disk, alarmed, 51, stops=False, then=goes_on_and_loses_nothing),
    Row("bad network", nothing, lambda w: True, 1, stops=False, overrides=BAD_NETWORK,
        phases=("contact",), then=applied_in_order),
    Row("no model for 500 ms, then 2 s", silence("slave"), master_is("FROZEN"), 530, stops=False,
        phases=MOVING, then=declutches_and_fades),
    Row("no motion for 100 ms, then 500 ms", silence("master"), in_hold, 115, stops=False,
        phases=MOVING, then=goes_back_to_the_surface),
    Row("replayed, flipped and foreign packets", hostile_packets, counted_hostile, 25, stops=False,
        phases=MOVING, then=none_accepted),
    Row("wild parameters", wild_models, refused_models, 150, stops=False, phases=("contact",),
        then=renders_sanely),
    Row("a wall too stiff to render", nothing, reduced, 1500, stops=False, phases=("contact",),
        overrides=("plant.environment.stiffness_N_per_m=30000", "slave.force_cap_N=60"),
        then=within_the_passive_bound),
    Row("a command beyond the limits", ask_for_the_moon, limited, 30, stops=False, phases=MOVING,
        then=never_beyond_the_limits),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """The outcome of one case."""

    detected_ms: int
    state: str
    fault: str
    peak_force_N: float
    problem: str


def play(row: Row, phase: Phase, seed: int, ring_folder: Path) -> Outcome:
    """Lead a world to the phase, inject, and judge the reaction; ticks are milliseconds."""
    world = FaultWorld(ring_folder, row.rig, seed, *row.overrides)
    try:
        if row.before_arming:
            row.inject(world)
        return _played(world.lead_to(phase), row)
    finally:
        world.close()


def _played(world: FaultWorld, row: Row) -> Outcome:
    if not row.before_arming:
        row.inject(world)
    took = world.until(lambda: row.detected(world), row.bound_ms + 200)
    problems = []
    if not 0 < took <= row.bound_ms:
        problems.append(f"detected after {took} ms" if took > 0 else "never detected")
    if row.fault is not None and world.fault != row.fault:
        problems.append(f"named {world.fault}")
    if row.stops:
        world.until(lambda: False, 300)
        if world.axis.last != "stop":
            problems.append(f"the last command was {world.axis.last}")
        if world.rig.drive.enabled or world.state not in STOPPED:
            problems.append(f"not stopped: {world.state.name}")
    if problem := row.then(world):
        problems.append(problem)
    return Outcome(took, world.state.name, world.fault, world.peak_force, "; ".join(problems))
