"""The operator that a trial asks for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from teleop_rt.axis import Device
from teleop_rt.config_operator import DeviceOperator as DeviceConfig
from teleop_rt.config_operator import HandOperator, OperatorConfig, ProfileOperator
from teleop_rt.master.device import DeviceOperator
from teleop_rt.master.hand import Hand
from teleop_rt.master.operators import Operator, Profile
from teleop_rt.master.recorded import OperatorError, Recorded

OpenDevice = Callable[[DeviceConfig], Device]


def make_operator(
    config: OperatorConfig,
    *,
    folder: Path,
    period_s: float,
    rng: np.random.Generator,
    open_device: OpenDevice | None = None,
) -> Operator:
    """Return the operator of a trial; `folder` is the trial file's.

    `open_device` opens a real one. Raises OperatorError, or AxisError for a device.
    """
    if isinstance(config, DeviceConfig):
        if open_device is None:
            raise OperatorError("operator.kind: no device can be opened here: choose another")
        operator = DeviceOperator(open_device(config), period_s)
        operator.configure()
        return operator
    if isinstance(config, ProfileOperator):
        return Profile(config)
    if isinstance(config, HandOperator):
        return Hand(config, period_s, rng)
    return Recorded(config, folder)
