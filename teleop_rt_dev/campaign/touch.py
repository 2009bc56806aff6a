"""The first touch by each mode: the felt force in the half second in which the wall is unknown.

    scripts/campaign touch [--round-trips MS ...] [--seconds S] [--set KEY=VALUE ...]

The shipped handle approaches the silicone cube, by a rendered model and by the modes that need
none. From the moment at which the tool touches, for half a second: the force of the motor beside
the force of the tool at the same moment (NRMSE of the tool's largest force), how long after the
touch the motor gives half a newton, the tool's largest force, and the energy the hand gets back. A
mode without a model that felt better here would be worth switching to until the wall is known.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_dev.paths import TRIALS

TRIAL = TRIALS / "handle.yaml"
MODES = ("model-mediated", "direct", "tdpa", "four-channel")
ROUND_TRIPS_MS = (0.0, 5.0, 10.0, 20.0, 50.0)  # from one room to one country
WINDOW, TOUCH_N, FELT_N = 500, 0.4, 0.5
"""Ticks that are looked at, and the forces that count as a touch of the tool and as felt."""
_MOTOR, _GIVEN = 4, 5

Rows = NDArray[np.float64]


def run(
    mode: str, round_trip_ms: float, seconds: float, others: Sequence[str] = ()
) -> tuple[Rows, Rows]:
    """Return the rows of HANDLE_TRUTH and the tool's force (n,) of every tick."""
    changes = [f"mode={mode}", f"link.round_trip_ms={round_trip_ms}", f"duration_s={seconds}"]
    changes += ["link.jitter_ms=0", "link.loss=0", *others]
    trial = load_trial_file(TRIAL, changes)
    rows, tool_N = [], []
    with tempfile.TemporaryDirectory() as name:
        one = LockstepTrial(trial, TRIAL.parent, open_bench, Path(name))
        one.slave.configure()
        truth_row = one.bench.handle_truth
        assert truth_row is not None
        while one.clock.now_ns() < 1_000_000_000 + seconds * 1e9:
            one.step()
            rows.append(truth_row.copy())
            tool_N.append(one.slave.sample.force)
        one.bench.axis.stop()
        one.master.let_go()
    return np.array(rows), np.array(tool_N)


def measures(handle: Rows, tool_N: Rows) -> tuple[float, float, float, float]:
    """Return NRMSE, delay of the first felt force [ms], largest force [N], energy given [mJ]."""
    touch = int(np.argmax(tool_N > TOUCH_N))
    span = slice(touch, touch + WINDOW)
    motor, tool, given = handle[span, _MOTOR], tool_N[span], handle[span, _GIVEN]
    most = float(tool.max())
    nrmse = float(np.sqrt(np.mean((motor - tool) ** 2))) / most
    felt = np.flatnonzero(motor > FELT_N)
    late_ms = float(felt[0]) if felt.size else float("nan")
    back_mJ = 1e3 * float((np.maximum.accumulate(given) - given).max())
    return nrmse, late_ms, most, back_mJ


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="teleop-rt-dev campaign touch", description=__doc__)
    parser.add_argument("--round-trips", type=float, nargs="+", default=ROUND_TRIPS_MS)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--set", nargs="+", default=[], help="changes of the trial")
    chosen = parser.parse_args(arguments)
    print("| round trip [ms] | mode | NRMSE | felt after [ms] | tool [N] | given back [mJ] |")
    print("| --- | --- | --- | --- | --- | --- |")
    for round_trip_ms in chosen.round_trips:
        for mode in MODES:
            found = measures(*run(mode, round_trip_ms, chosen.seconds, chosen.set))
            cells = " | ".join(f"{value:.3g}" for value in found)
            print(f"| {round_trip_ms:g} | {mode} | {cells} |", flush=True)
    return 0
