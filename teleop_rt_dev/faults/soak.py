"""A soak: random faults on the slave daemon, healed, reset and armed again; nothing may grow.

It ends after minutes of this machine's time, stepped as fast as it can, or after a number of
faults, and is then the same on each machine. Memory and descriptors are compared between the end of
the first quarter and the end.
"""

from __future__ import annotations

import random
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teleop_rt.slave.faults import State
from teleop_rt_dev.faults.world import FaultWorld

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.rig import DeviceName

MOST_GROWTH_KIB = 4096
"""Room for the allocator; a leak of 100 bytes a tick is 7 MB in the last 75 of 100 faults."""
FIRST_QUARTER = 0.25
"""Share of a soak in which caches and pools fill."""
DEVICES: tuple[DeviceName, ...] = ("encoder", "force sensor", "drive")
FAULTS = ("mute", "freeze", "wrong_length", "corrupt", "duplicate", "delay", "reset", "emergency")


def resident_kib() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def disarmed(world: FaultWorld) -> bool:
    return world.state is State.DISARMED


class Soak:
    """One daemon that is harmed again and again."""

    def __init__(self, ring_folder: Path, seed: int) -> None:
        self._random = random.Random(seed)
        self.world = FaultWorld(ring_folder, "canopen", seed)
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
            if world.until(lambda: disarmed(world), 500) < 0:
                self.problems.append(f"{fault}: no sample after the reset")
            world.until(lambda: world.slave.sample.valid, 500)
            world.slave.arm()
        world.states.clear()


def after_minutes(minutes: float) -> Callable[[Soak], float]:
    """Return a function of a soak that gives the share of the minutes that have passed."""
    begun = time.monotonic()
    return lambda _: (time.monotonic() - begun) / (60 * minutes)


def after_faults(count: int) -> Callable[[Soak], float]:
    """Return a function of a soak that gives the share of the faults that were injected."""
    return lambda one: one.faults.total() / count


def soak(share: Callable[[Soak], float], seed: int) -> dict[str, Any]:
    """Return the result of a soak until its `share` is 1."""
    with tempfile.TemporaryDirectory() as ring_folder:
        one = Soak(Path(ring_folder), seed)
        memory = files = 0
        while (played := share(one)) < 1.0:
            one.step()
            if not memory and played > FIRST_QUARTER:
                memory, files = resident_kib(), descriptors()
        grown, opened = resident_kib() - memory, descriptors() - files
        return {
            "campaign": "soak",
            "ticks": one.world.slave.tick,
            "missed_ticks": one.world.slave.missed_ticks,
            "faults": dict(one.faults),
            "grown_KiB": grown,
            "new_descriptors": opened,
            "problems": one.problems[:10],
            "holds": grown <= MOST_GROWTH_KIB and opened == 0 and not one.problems,
        }
