"""The hand on a long link before the first touch is known, with the leash and without.

A hand walks towards an unknown wall and waits for nobody; slave, link, master and the driver of the
handle are the real ones, on a simulated clock. A run ends when the master knows the wall. Before
that the only force on the hand is the leash's brake, and the tool's effect so far on the
wall the hand could not feel.
"""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from teleop_rt.batch.workers import Case, Result
from teleop_rt.config.trial import TrialConfig
from teleop_rt.master.walls import NO_WALL
from teleop_rt.trial.bench import OpenBench
from teleop_rt.trial.lockstep_run import LockstepTrial

ROUND_TRIPS_MS = (150.0, 500.0, 1000.0, 2000.0)
"""From the shipped trials' own to 2 s, where operators without a model move and wait."""
SPEEDS_MM_PER_S = (10.0, 40.0)
"""Of a hand that nearly waits for the slave on a link of 2 s, and of one that hurries."""
LONGEST_S, LONGEST_TRIPS = 3.0, 8.0
"""A wall that is not felt within this time and so many round trips is not felt."""
WAY_M = 0.07
"""From where the handle starts to a depth in the wall that is felt by any of these hands."""


def cases(
    round_trips_ms: Sequence[float] = ROUND_TRIPS_MS,
    speeds_mm_per_s: Sequence[float] = SPEEDS_MM_PER_S,
) -> list[Case]:
    """Return each round trip with each speed of the hand, with the leash and without."""
    grid = itertools.product(round_trips_ms, speeds_mm_per_s, (True, False))
    return [
        {"round_trip_ms": trip, "hand_mm_per_s": speed, "leash": leash}
        for trip, speed, leash in grid
    ]


@dataclass(frozen=True, slots=True)
class Approach:
    """A handle's trial, and how its file is read and its simulated devices are opened."""

    load_trial: Callable[[Path, list[str] | None], TrialConfig]
    open_bench: OpenBench
    trial_file: Path

    def walk(self, case: Case) -> Result:
        """Walk towards the wall until the master knows it; null where it never does.

        lead: the longest way by which the hand leads the slave. brake: the largest force on the
        hand. felt: when the wall is felt, from the start. tool: the largest force on the wall by
        then. offset: the distance between hand and tool from then on.
        """
        speed, trip_s = 1e-3 * case["hand_mm_per_s"], 1e-3 * case["round_trip_ms"]
        lasts_s = LONGEST_S + WAY_M / speed + LONGEST_TRIPS * trip_s
        changes = [
            f"link.round_trip_ms={case['round_trip_ms']}",
            f"operator.hand.intention.approach_speed_m_per_s={speed}",
            f"duration_s={lasts_s}",
            *([] if case["leash"] else ["master.leash_force_N=0"]),
        ]
        trial = self.load_trial(self.trial_file, changes)
        with tempfile.TemporaryDirectory() as name:
            one = LockstepTrial(trial, self.trial_file.parent, self.open_bench, Path(name))
            found = _until_known(one, lasts_s)
        return case | found


def _until_known(one: LockstepTrial, lasts_s: float) -> Result:
    one.slave.configure()
    master, begins_ns = one.master.master, one.clock.now_ns()
    lead = brake = tool_N = 0.0
    felt_s = math.inf
    while math.isinf(felt_s) and one.clock.now_ns() < begins_ns + lasts_s * 1e9:
        one.step()
        tool_N = max(tool_N, one.slave.sample.force)
        if master.adoption.newest is NO_WALL:
            lead, brake = master.leash.longest, max(brake, master.force)
        else:
            felt_s = 1e-9 * (one.clock.now_ns() - begins_ns)
    known, offset_mm = math.isfinite(felt_s), 1e3 * master.registration.offset
    one.bench.axis.stop()
    one.master.let_go()
    return {
        "lead_mm": 1e3 * lead,
        "brake_N": brake,
        "felt_s": felt_s if known else None,
        "tool_N": tool_N,
        "offset_mm": offset_mm if known else None,
    }
