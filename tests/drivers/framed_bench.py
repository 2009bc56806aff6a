"""A serial, raw-CAN or mixed axis with its simulated devices in lock-step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rig_bench import MS, START_NS, Cycles, plant_config

from teleop_rt.axis import Sample
from teleop_rt.config.loader import load_rig
from teleop_rt_drivers import opening, registry
from teleop_rt_drivers.ends import LockStepEnds

RIGS = Path(__file__).parents[2] / "config" / "rigs"
KINDS = ("serial", "raw_can", "mixed")
QUIET = {"force_noise": 0.0, "force_lag_jitter_us": 0.0, "force_lag_ms": 0.0}


def load(kind: str):
    return load_rig(RIGS / f"simulated_{kind}.yaml", registry.AXIS_SCHEMAS)


def edited(kind: str, folder: Path, *changes: tuple[str, str]):
    """The rig's file with some text replaced."""
    text = (RIGS / f"simulated_{kind}.yaml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "rig.yaml"
    path.write_text(text)
    return load_rig(path, registry.AXIS_SCHEMAS)


class FramedBench(Cycles):
    def __init__(self, rig: Any, *, plant=None, seed=1, log_folder=None) -> None:
        self.now = START_NS
        self.ends = LockStepEnds(log_folder, lambda: self.now)
        now_ns = lambda: self.now  # noqa: E731 - the bench's clock
        self.simulated = opening.open_rig_on(
            rig, plant or plant_config(), now_ns, seed, self.ends.devices
        )
        self.ends.answer_with(self.simulated.process)
        self.simulated.power_on()
        self.axis: Any = opening.open_axis_on(rig, now_ns, self.ends)
        self.sample = Sample()

    def cycle(self, position: float = 0.0) -> Sample:
        self.now += MS
        self.axis.read_into(self.sample)
        self.axis.write(position)
        return self.sample

    def armed(self, within: int = 15) -> FramedBench:
        """Configure and arm; the drive must be enabled after so many cycles."""
        self.axis.configure()
        self.axis.arm()
        assert self.cycles(within).enabled
        return self
