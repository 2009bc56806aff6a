"""A soak: random faults on the slave daemon, healed, reset and armed again; nothing may grow.

    scripts/campaign soak [--minutes M] [--seed S] [--json]

Minutes are of this machine's time, stepped as fast as it can. Memory and descriptors are compared
between the end of the first quarter and the end. Exits with 1 where something grew, where a fault
was not latched and reset, or where an exception came out of the loop.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "faults"))

from fault_world import FaultWorld

from teleop_rt.slave.faults import State

MOST_GROWTH_KIB = 4096
DEVICES = ("encoder", "force sensor", "drive")
FAULTS = ("mute", "freeze", "wrong_length", "corrupt", "duplicate", "delay", "reset", "emergency")


def resident_kib() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


class Soak:
    """One daemon that is harmed again and again."""

    def __init__(self, session: Path, seed: int) -> None:
        self._random = random.Random(seed)
        self.world = FaultWorld(session, "canopen", seed)
        self.world.lead_to("contact")
        self.faults: Counter[str] = Counter()
        self.problems: list[str] = []

    def step(self) -> None:
        """Run on for a while, harm, see it stopped where it must be, and set it going again."""
        world = self.world
        world.until(lambda: False, self._random.randrange(100, 1500))
        fault, device = self._random.choice(FAULTS), self._random.choice(DEVICES)
        if self._random.random() < 0.2:
            fault = "late ticks"
            world.jump(self._random.randrange(1, 60))
        else:
            world.rig.inject(fault, device)
        world.until(lambda: False, self._random.randrange(5, 200))
        for one in DEVICES:
            world.rig.heal(one)
        self.faults[fault] += 1
        if world.until(lambda: world.state is not State.SAFE_STOP, 1500) < 0:
            self.problems.append(f"{fault}: never left SAFE_STOP")
        if world.state is State.FAULT:
            if world.axis.last != "stop" or world.rig.drive.enabled:
                self.problems.append(f"{fault}: not stopped")
            world.slave.reset()
            if world.until(lambda: world.state is State.DISARMED, 500) < 0:
                self.problems.append(f"{fault}: no sample after the reset")
            world.until(lambda: world.slave.sample.valid, 500)
            world.slave.arm()
        world.states.clear()


def soak(minutes: float, seed: int) -> dict[str, Any]:
    """Return what a soak of so many minutes came to."""
    end = time.monotonic() + 60 * minutes
    settled = time.monotonic() + 15 * minutes
    with tempfile.TemporaryDirectory() as session:
        one = Soak(Path(session), seed)
        memory = files = rounds = 0
        while time.monotonic() < end:
            one.step()
            rounds += 1
            if not memory and time.monotonic() > settled:
                memory, files = resident_kib(), descriptors()
        grown, opened = resident_kib() - memory, descriptors() - files
        return {
            "campaign": "soak",
            "minutes": minutes,
            "ticks": one.world.slave.tick,
            "missed_ticks": one.world.slave.missed_ticks,
            "faults": dict(one.faults),
            "grown_KiB": grown,
            "new_descriptors": opened,
            "problems": one.problems[:10],
            "holds": grown <= MOST_GROWTH_KIB and opened == 0 and not one.problems,
        }


def main() -> int:
    parser = argparse.ArgumentParser(prog="scripts/campaign soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    found = soak(chosen.minutes, chosen.seed)
    if chosen.json:
        print(json.dumps(found))
    else:
        print("\n".join(f"{name}: {value}" for name, value in found.items()))
    return 0 if found["holds"] else 1


if __name__ == "__main__":
    sys.exit(main())
