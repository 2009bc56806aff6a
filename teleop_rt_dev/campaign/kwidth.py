"""The K-width of a handle: stiffest wall that stays quiet, over the bound, for three controllers.

    scripts/campaign kwidth [--json]

A device of 0.2 kg behind a position step of 1 um is held by hands of 0.1 to 3 kg, and pushed
against a sampled unilateral spring. A hand that comes to rest on it, or swings less and less, is
stable. Plain
rendering is the spring alone; the textbook's controller (Hannaford and Ryu 2002) adds damping while
the port has given more energy than it took, with credit kept for ever. Ours renders no spring above
the bound, so its width is 1 wherever that is quiet. The excess of plain rendering over 1 is the
margin that the bound gives away for these five hands: it holds for every passive one.

A second table compares walls as handles render them, K without B and B beside the cube's K, with
the optimum for the plant's own damping, latency and motor (`best_wall.py`).
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.config.operator import DeviceOperator
from teleop_rt.config.rig import RigConfig
from teleop_rt.kernels.jit import kernel
from teleop_rt.master.build import make_port
from teleop_rt.master.passivity import PassivityBound, Port
from teleop_rt_dev.hands import best_wall
from teleop_rt_dev.hands.drawn import HANDLES
from teleop_rt_dev.paths import TRIALS
from teleop_rt_drivers.actuators.config import ActuatorDeviceConfig
from teleop_rt_drivers.operator_device import simulated_device

Vector = NDArray[np.float64]

HANDS = ((0.1, 100.0, 0.5), (0.3, 300.0, 1.0), (0.8, 500.0, 2.0), (1.5, 1500.0, 10.0),
         (3.0, 3000.0, 30.0))  # fmt: skip
"""Mass [kg], stiffness [N/m] and damping [N s/m] of an arm; flesh in series."""
DEVICE_KG, STEP_M, PERIOD_S, SUBSTEPS = 0.2, 1e-6, 1e-3, 50
WINDOWS, WINDOW_STEPS = 4, 50_000
"""Of a push: a second each."""
FLESH = (5.0e4, 60.0)  # N/m and N s/m between hand and handle: of a firm grip
PUSH_M = 0.004
"""Intended depth of the hand behind the surface."""
QUIET_M, DECAY, MOST_M = 5e-5, 0.95, 1.0
"""Peak to peak of a handle at rest in the last of four windows, or over the window before."""
MOST_N_PER_M, ACCURACY = 2e5, 0.02
PLAIN, TEXTBOOK = 0, 1
CUBE_N_PER_M = 3600.0  # of the default trial's plant
ASKED = ("damiao_handle", "robstride_handle", "moteus_handle")
ANSWERED = ("operator.rig.axis.answer_within_ms=0.35",)
"""Handles whose drive can be asked where it is as a cycle begins, and how long that takes."""
ALPHA_MAX = 200.0
"""Most damping of the textbook's controller [N s/m]: half of a sampled 0.2 kg's most."""


@kernel
def unrest(
    stiffness: float, damping: float, mass: float, arm: float, grip: float,
    controller: int, pending: Vector,
) -> float:  # fmt: skip
    """Return how far a handle moves [m] at the end of a push; 0 where that dies away."""
    h = PERIOD_S / SUBSTEPS
    late = pending.size - 1
    x = y = -0.002
    v = w = sampled = energy = acting = 0.0
    low, high, before, total = 1e9, -1e9, 0.0, WINDOWS * WINDOW_STEPS

    for index in range(total):
        if index % SUBSTEPS == 0:
            read = np.floor(x / STEP_M) * STEP_M
            velocity = (read - sampled) / PERIOD_S
            energy += acting * (read - sampled)
            sampled = read
            force = max(0.0, stiffness * read)
            if controller == TEXTBOOK and energy < 0.0 and abs(velocity) > 0.0:
                force += min(-energy / (PERIOD_S * velocity * velocity), ALPHA_MAX) * velocity
            commanded = force
        pending[index % (late + 1)] = commanded
        acting = pending[(index + 1) % (late + 1)]
        held = FLESH[0] * (y - x) + FLESH[1] * (w - v)
        v += h / DEVICE_KG * (held - acting - damping * v)
        w += h / mass * (arm * (PUSH_M - y) - grip * w - held)
        x += h * v
        y += h * w
        if index % WINDOW_STEPS == 0:
            before, low, high = high - low, x, x
        low, high = min(low, x), max(high, x)
    if high - low <= DECAY * before:
        return 0.0
    return min(MOST_M, high - low)


def stiffest(damping: float, latency_s: float, controller: int) -> float:
    """Return the stiffest spring [N/m] that is quiet for every hand, by bisection."""
    late = round(latency_s * SUBSTEPS / PERIOD_S)
    quiet, loud = 1.0, MOST_N_PER_M
    while loud > (1 + ACCURACY) * quiet:
        middle = float(np.sqrt(quiet * loud))
        rests = all(
            unrest(middle, damping, *hand, controller, np.zeros(late + 1)) < QUIET_M
            for hand in HANDS
        )
        quiet, loud = (middle, loud) if rests else (quiet, middle)
    return quiet


def row(damping: float, latency_s: float) -> dict[str, float]:
    """Return the widths of one device."""
    port = Port(PERIOD_S, damping, velocity="difference", delay_s=latency_s)
    bound = PassivityBound(port).stiffness_max
    ours = stiffest(damping, latency_s, PLAIN)
    return {
        "damping_N_s_per_m": damping,
        "latency_ms": 1e3 * latency_s,
        "bound_N_per_m": bound,
        "ours": min(1.0, ours / bound),
        "plain": ours / bound,
        "textbook": stiffest(damping, latency_s, TEXTBOOK) / bound,
    }


def answers_late(axis: object, rig: RigConfig) -> bool:
    """Return whether a drive answers commands alone: then a sample is that of the last command."""
    if not isinstance(axis, ActuatorDeviceConfig) or axis.asked is not None:
        return False
    return axis.drive.codec(rig).asks


def shipped(handle: str, changes: Sequence[str] = ()) -> dict[str, Any]:
    """Return the wall that a shipped handle renders, and the optimum for its plant."""
    changes = [f"operator.rig=../rigs/simulated_{handle}.yaml", *changes]
    trial = load_trial_file(TRIALS / "handle.yaml", changes)
    operator, period_s = trial.operator, 1.0 / trial.master.rate_hz
    assert isinstance(operator, DeviceOperator)
    axis, _, plant = simulated_device(operator, lambda: 0, 1)
    port = make_port(trial.master, period_s, operator, axis.timing)
    bound, body = PassivityBound(port), plant.body
    latency_s = 1e-9 * (plant.sample_age_ns + plant.command_delay_ns)
    if answers_late(operator.rig.axis, operator.rig):
        latency_s += period_s
    motor = (period_s, latency_s, 1.0 / (2 * math.pi * body.force_bandwidth_hz))
    most_B = best_wall.most_damped(body.damping, CUBE_N_PER_M, port.cutoff_hz, *motor)
    return {
        "handle": handle,
        "damping_N_s_per_m": body.damping,
        "latency_ms": 1e3 * latency_s,
        "optimum_K": best_wall.stiffest(body.damping, *motor),
        "rendered_K": bound.stiffness_max,
        "optimum_B": most_B,
        "rendered_B": bound.damping_max(CUBE_N_PER_M),
    }


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="teleop-rt-dev campaign kwidth", description=__doc__)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    rows = [row(b, late) for b in (2.0, 8.0) for late in (0.0, 0.45e-3, 1e-3, 2e-3)]
    optima = [shipped(handle) for handle in HANDLES]
    for handle in ASKED:
        found = shipped(handle, ANSWERED)
        optima.append(found | {"handle": f"{handle}, asked"})
    if chosen.json:
        print(json.dumps({"campaign": "kwidth", "rows": rows, "shipped": optima}))
        return 0
    print("| b [N s/m] | latency [ms] | bound [N/m] | ours | plain | textbook |")
    print("| --- | --- | --- | --- | --- | --- |")
    for one in rows:
        cells = [f"{one['damping_N_s_per_m']:g}", f"{one['latency_ms']:g}"]
        cells += [f"{one['bound_N_per_m']:.0f}"]
        cells += [f"{one[key]:.2f}" for key in ("ours", "plain", "textbook")]
        print("| " + " | ".join(cells) + " |")
    print("\n| handle | b | latency [ms] | K [N/m] | optimum | B at 3600 N/m | optimum |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for one in optima:
        name, *numbers = one.values()
        b, late, best_K, K, best_B, B = numbers
        print(f"| {name} | {b:g} | {late:.2f} | {K:.0f} | {best_K:.0f} | {B:.1f} | {best_B:.1f} |")
    return 0
