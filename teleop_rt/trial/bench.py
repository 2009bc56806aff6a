"""What a trial on simulated time runs on: an axis, and what simulates it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from teleop_rt.axis import Axis
from teleop_rt.config import TrialConfig
from teleop_rt.master.build import OpenDevice


@dataclass(slots=True)
class Bench:
    """An axis on simulated time, with what simulates it, if anything does.

    `truth()` gives the plant's secrets for truth.json; `publish_truth(session)` makes the ring of
    its true motion. Both are None for an axis that replays measurements. `open_device` opens the
    operator's device, where the trial has a real one.
    """

    axis: Axis
    truth: Callable[[], dict[str, Any]] | None = None
    publish_truth: Callable[[Path], object] | None = None
    open_device: OpenDevice | None = None


OpenBench = Callable[[TrialConfig, Callable[[], int]], Bench]
