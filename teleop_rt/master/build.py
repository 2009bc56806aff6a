"""The operator that a trial asks for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from teleop_rt.config import HandOperator, OperatorConfig, ProfileOperator
from teleop_rt.master.hand import Hand
from teleop_rt.master.operators import Operator, Profile
from teleop_rt.master.recorded import Recorded


def make_operator(
    config: OperatorConfig, *, folder: Path, period_s: float, rng: np.random.Generator
) -> Operator:
    """Return the operator of a trial; `folder` is the trial file's. Raises OperatorError."""
    if isinstance(config, ProfileOperator):
        return Profile(config)
    if isinstance(config, HandOperator):
        return Hand(config, period_s, rng)
    return Recorded(config, folder)
