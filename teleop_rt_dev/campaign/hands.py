"""Drawn hands on every handle: no sustained oscillation, no energy but the tank's.

    scripts/campaign hands [--trials N] [--first I] [--seconds S] [--json]

Each trial draws a hand (0.1 to 5 kg, 0 to 3000 N/m, 0 to 60 N s/m, some with tremor or a grip that
changes, some let go or held by nobody), a wall (300 to 40 000 N/m: linear, of Hunt and Crossley,
stiffening, layered, moving), a round trip (0 to 5 s), loss to 20 %, and one of the shipped handles,
all by its number alone. Oscillations and energies are measured here, from the plant's truth:
nothing is shared with the product's own watch. A hand that reacts late is no passive hand, so an
oscillation counts only where the same hand makes none against an ideal wall, which a fine
integration renders: the true one, a spring as soft as the one that was rendered, on which tremor
moves a hand further, and the continuous wall that was rendered then, and that never changes
(`hands/same_hand.py`). The second judge (`hands/second_judge.py`) shares no code with the project
or with the first, and has its own definition of shaking; it, too, leaves the hand the swings that
the same hand makes on that last wall. A trial in which either finds an oscillation does not hold.
Energy is that which a contact gives back beyond that from the hand; a surface that moves by
itself may do its own work, |f| times its fastest speed, on top of the tank.
Prints a table by kind of wall. Exits with 1 where a trial does not hold.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.config.loader import dump
from teleop_rt.config.trial import TrialConfig
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_dev.hands.drawn import KINDS, draw
from teleop_rt_dev.hands.ideal import IdealWall, ideal_motion
from teleop_rt_dev.hands.oscillation import (
    IDEAL_SHARE,
    SUSTAINED,
    Swings,
    longest_oscillation,
    rows_of,
)
from teleop_rt_dev.hands.same_hand import Rendered, is_own, second_judges_rows, timed, whole
from teleop_rt_dev.hands.second_judge import judge as second_judge
from teleop_rt_dev.paths import TRIALS

TRIAL = TRIALS / "handle.yaml"
CAP_SLACK, CAP_LONGEST_MS = 1.02, 20
NO_FORCE = 0.01
"""A motor that pushes less holds nothing back."""
TOOL_SLACK, TOOL_LONGEST_MS = 1.1, 10
"""Excess over the slave's cap that a wall adds while it moves or stiffens until the tool has
turned, and its time: two reversals of 5 ms, one to stop and one back.
"""
_POSITION, _VELOCITY, _MOTOR, _GIVEN = 1, 2, 4, 5

Rows = NDArray[np.float64]


def run(number: int, seconds: float) -> dict[str, Any]:
    """Run a trial in lock-step and judge it by the plant's truth."""
    drawn = draw(number, seconds)
    trial = load_trial_file(TRIAL, [f"duration_s={drawn.seconds}", *drawn.changes])
    rows, tool_N, rendered = [], list[float](), Rendered()
    with tempfile.TemporaryDirectory() as name:
        one = LockstepTrial(trial, TRIAL.parent, open_bench, Path(name))
        one.slave.configure()
        truth_row = one.bench.handle_truth
        assert truth_row is not None
        while one.clock.now_ns() < 1_000_000_000 + drawn.seconds * 1e9:
            one.step()
            rows.append(truth_row.copy())
            rendered.note(one.master.master)
            tool_N.append(one.slave.sample.force)
        outcome, slave = one.master.outcome()["rendering"], one.slave.safety.fault.name
        one.bench.axis.stop()
        one.master.let_go()
    truth = np.array(rows)
    found = judge(trial, truth, outcome, rendered)
    found |= {"slave_fault": slave} | by_second_judge(trial, truth, rendered)
    share = np.array(tool_N) / trial.slave.force_cap
    found |= {"tool_over_cap": float(share.max())}
    found |= {"tool_over_cap_ms": longest_ms(share > 1.0, trial.master.rate_hz)}
    found["holds"] &= slave == "none" and tool_is_kept(found)
    found["holds"] &= found["second_judges_swings"] < SUSTAINED
    return {"trial": number, "handle": drawn.handle, "wall": drawn.kind} | found


def tool_is_kept(found: dict[str, Any]) -> bool:
    """Return whether the tool's force passed its cap by no more, and for no longer, than said."""
    kept: bool = found["tool_over_cap"] <= TOOL_SLACK
    return kept and found["tool_over_cap_ms"] <= TOOL_LONGEST_MS


def longest_ms(over: NDArray[np.bool_], rate_hz: int) -> float:
    """Return the longest time without a break in which ticks are marked."""
    words = "".join("x" if o else " " for o in over).split()
    return 1e3 / rate_hz * max(map(len, words), default=0)


def by_second_judge(trial: TrialConfig, truth: Rows, rendered: Rendered) -> dict[str, Any]:
    """Return the longest row of swings that the other judge finds beyond the hand's own share."""
    plain, motion = dump(trial, trial.rig.units), (truth[:, _POSITION], truth[:, _MOTOR])
    found = [
        row
        for row in whole(second_judge(plain, *motion))
        if not is_own(timed(row), second_judges_rows, trial, rendered, *motion)
    ]
    worst = max(found, key=lambda row: row.swings, default=None)
    if worst is None:
        return {"second_judges_swings": 0}
    return {"second_judges_swings": worst.swings, "second_judges_row": asdict(worst)}


def judge(
    trial: TrialConfig, truth: Rows, outcome: dict[str, Any], rendered: Rendered | None = None
) -> dict[str, Any]:
    """Return the findings on a trial, and whether it holds. `truth` are rows of HANDLE_TRUTH."""
    motor, master = truth[:, _MOTOR], trial.master
    period_s = 1.0 / master.rate_hz
    swings, size, own = first_judge(trial, truth, outcome, rendered)
    over = np.abs(motor) > CAP_SLACK * master.force_max
    work_mJ = 1e3 * float(np.abs(motor).sum()) * period_s * IdealWall(trial.plant).fastest
    tank_mJ = master.tank_capacity_mJ + master.tank_power_mW * trial.duration_s
    found = {
        "swings": swings,
        "swings_mm": 1e3 * size,
        "given_mJ": 1e3 * given_back(trial, truth),
        "allowed_mJ": tank_mJ + work_mJ,
        "force_max_N": float(np.abs(motor).max()),
        "over_cap_ms": longest_ms(over, master.rate_hz),
        "softenings": outcome["handle"]["softenings"],
        "hands_own": own,
        "handle_fault": outcome["handle"]["fault"]["name"],
        "stiffness": outcome["passivity"]["stiffness"],
        "stiffness_max": outcome["passivity"]["stiffness_max"],
    }  # fmt: skip
    found["holds"] = (
        found["swings"] < SUSTAINED
        and found["given_mJ"] <= found["allowed_mJ"]
        and found["over_cap_ms"] <= CAP_LONGEST_MS
        and found["handle_fault"] in {"none", "handle_end_of_travel"}
    )
    return found


def first_judge(
    trial: TrialConfig, truth: Rows, outcome: dict[str, Any], rendered: Rendered | None
) -> tuple[int, float, bool]:
    """Return the longest row of swings beyond the hand's own share, and whether any was its own."""
    motion, period_s = (truth[:, _POSITION], truth[:, _MOTOR]), 1.0 / trial.master.rate_hz
    rows = whole(rows_of(*motion, period_s, truth[:, _GIVEN]))
    long, own = [row for row in rows if row.swings >= SUSTAINED], list[Swings]()
    if long:
        made = [longest_oscillation(*ideal, period_s) for ideal in ideals(trial, outcome)]
        sizes = [size for swings, size in made if swings >= SUSTAINED]
        own = [row for row in long if any(size >= IDEAL_SHARE * row.size_m for size in sizes)]
        left = [row for row in long if row not in own]
        if rendered is not None:
            own += [row for row in left if is_own(row, rows_of, trial, rendered, *motion)]
    worst = max((row for row in rows if row not in own), key=lambda row: row.swings, default=None)
    return (0, 0.0, bool(own)) if worst is None else (worst.swings, worst.size_m, bool(own))


def ideals(trial: TrialConfig, outcome: dict[str, Any]) -> Iterator[tuple[Rows, Rows]]:
    """Yield the same hand's motion and force against the true wall, and a rendered one's spring."""
    yield ideal_motion(trial, IdealWall(trial.plant))
    stiffness = outcome["passivity"]["stiffness"]
    if stiffness["rendered"] < stiffness["true"]:
        yield ideal_motion(trial, IdealWall(trial.plant, stiffness["rendered"]))


def given_back(trial: TrialConfig, truth: Rows) -> float:
    """Return the most energy [J] that the port gave the hand between two moments without force.

    Springs are relaxed then, and the energy of the device's mass is counted as the hand's.
    """
    operator = trial.operator
    body = operator.plant or operator.body  # type: ignore[union-attr]
    free = np.abs(truth[:, _MOTOR]) < NO_FORCE
    energy = (truth[:, _GIVEN] - 0.5 * body.mass * truth[:, _VELOCITY] ** 2)[free]
    if not energy.size:
        return 0.0
    return float((np.maximum.accumulate(energy) - energy).max())


def table(found: list[dict[str, Any]]) -> str:
    """Return a row for each kind of wall."""
    head = "| wall | trials | failed | swings | second judge's | given / allowed | above cap [ms] "
    head += "| tool / cap | tool above cap [ms] | softened |"
    lines = [head, "| --- " * (head.count("|") - 1) + "|"]
    for kind in (*KINDS, "all"):
        rows = [one for one in found if kind in (one["wall"], "all")]
        if not rows:
            continue
        share = max(one["given_mJ"] / one["allowed_mJ"] for one in rows)
        cells = (
            kind, len(rows), sum(not one["holds"] for one in rows),
            max(one["swings"] for one in rows), max(one["second_judges_swings"] for one in rows),
            f"{share:.2f}",
            f"{max(one['over_cap_ms'] for one in rows):.0f}",
            f"{max(one['tool_over_cap'] for one in rows):.2f}",
            f"{max(one['tool_over_cap_ms'] for one in rows):.0f}",
            sum(one["softenings"] > 0 for one in rows),
        )  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="teleop-rt-dev campaign hands", description=__doc__)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    found = []
    for number in range(chosen.first, chosen.first + chosen.trials):
        found.append(run(number, chosen.seconds))
        if chosen.json or not found[-1]["holds"]:
            print(json.dumps(found[-1]), flush=True)
    if not chosen.json:
        print(table(found))
    return 1 if any(not one["holds"] for one in found) else 0
