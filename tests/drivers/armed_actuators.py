"""Makers' drives on their benches, armed, and time that passes for them."""

from __future__ import annotations

from framed_bench import FramedBench, load
from rig_bench import plant_config

ON_CAN = ("odrive", "damiao", "robstride", "moteus", "vesc")
ON_LINES = ("dynamixel", "feetech")
DRIVES = ON_CAN + ON_LINES
WATCHDOG_MS = 50


def at_1_khz(kind: str):
    """The preset's rig, in cycles of a millisecond also where an adapter would not allow it."""
    return load(kind).model_copy(update={"rate_hz": 1000.0})


def armed(kind: str) -> FramedBench:
    bench = FramedBench(at_1_khz(kind), plant=plant_config(start=0.0))
    bench.axis.configure()
    bench.axis.arm()
    for _ in range(60):
        cycle(bench)
    assert bench.sample.enabled
    return bench


def cycle(bench: FramedBench, position: float = 0.0):
    return bench.cycle(position)


def until(bench: FramedBench, done, most: int) -> int:
    """Run cycles until something holds; return how many it took."""
    for count in range(1, most + 1):
        cycle(bench)
        if done(bench.sample):
            return count
    raise AssertionError(f"not within {most} ms: {bench.sample}")
