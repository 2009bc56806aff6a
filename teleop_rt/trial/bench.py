"""The bench of a trial on simulated time: an axis and its simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.axis import Axis
from teleop_rt.config.trial import TrialConfig

if TYPE_CHECKING:
    from teleop_rt.master.build import OpenDevice


@dataclass(slots=True)
class Bench:
    """An axis on simulated time, with its simulation, if there is one.

    `truth()` gives the plant's secrets for truth.json; `publish_truth(ring_folder)` makes the ring
    of its true motion. Both are None for an axis that replays measurements. `open_device` opens the
    operator's device, where the trial has a real one; `handles` are simulated ones' true rows.
    """

    axis: Axis
    truth: Callable[[], dict[str, Any]] | None = None
    publish_truth: Callable[[Path], object] | None = None
    open_device: OpenDevice | None = None
    handles: Sequence[NDArray[np.float64]] = ()

    @property
    def handle_truth(self) -> NDArray[np.float64] | None:
        """The newest row of `signals.HANDLE_TRUTH` of a simulated operator's device."""
        return self.handles[0] if self.handles else None


OpenBench = Callable[[TrialConfig, Callable[[], int]], Bench]
