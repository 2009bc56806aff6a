"""The operator that a trial asks for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from teleop_rt.axis import Device, Timing
from teleop_rt.config.master import MasterConfig
from teleop_rt.config.operator import DeviceOperator, HandOperator, OperatorConfig, ProfileOperator
from teleop_rt.master.device import HeldDevice
from teleop_rt.master.hand import Hand
from teleop_rt.master.handle_safety import HandleWatch
from teleop_rt.master.held_key import HeldKey
from teleop_rt.master.operators import Operator, Profile
from teleop_rt.master.passivity import Port
from teleop_rt.master.recorded import OperatorError, Recorded

OpenDevice = Callable[[DeviceOperator], Device]
CUTOFF_HZ = 30.0
"""Of a real device's velocity where none is given: a difference of two samples would cost so much
passivity that little of a wall's damping could be rendered."""


def make_port(
    config: MasterConfig,
    period_s: float,
    device: DeviceOperator | None = None,
    timing: Timing | None = None,
) -> Port:
    """Return how the operator's device senses and is driven.

    A real device's damping is said by its rig, its latency by its driver; the master's own keys can
    only be more careful.
    """
    delay_s, damping = 1e-3 * config.device_delay_ms, config.device_damping or 0.0
    if device is not None and timing is not None:
        damping = device.body.damping
        if config.device_damping is not None:
            damping = min(damping, config.device_damping)
        delay_s = max(delay_s, timing.latency_s)
    return Port(
        period_s,
        damping,
        config.device_velocity if device is None else "difference",
        cutoff_of(config, real=device is not None),
        delay_s,
        position_scale=config.position_scale,
        force_scale=config.force_scale,
    )


def cutoff_of(config: MasterConfig, *, real: bool) -> float:
    """Return the low-pass on the device's velocity [Hz], 0 for none."""
    if config.device_cutoff_hz is not None:
        return config.device_cutoff_hz
    return CUTOFF_HZ if real else 0.0


def make_operator(
    config: OperatorConfig,
    *,
    folder: Path,
    period_s: float,
    rng: np.random.Generator,
    open_device: OpenDevice | None = None,
    device_cutoff_hz: float = 0.0,
) -> Operator:
    """Return the operator of a trial; `folder` is the trial file's.

    `open_device` opens a real one, whose velocity is low-passed at `device_cutoff_hz`. Raises
    OperatorError, or AxisError for a device.
    """
    if isinstance(config, DeviceOperator):
        if open_device is None:
            raise OperatorError("operator.kind: no device can be opened here: choose another")
        rig = config.rig
        watch = HandleWatch(rig.limits, period_s, config.body.enabling, rig.axis.unsafe())
        chosen = config.body.enabling_key
        key = None if chosen is None else HeldKey(chosen.device, chosen.code)
        operator = HeldDevice(open_device(config), watch, period_s, device_cutoff_hz, key)
        operator.configure()
        return operator
    if isinstance(config, ProfileOperator):
        return Profile(config)
    if isinstance(config, HandOperator):
        return Hand(config, period_s, rng)
    return Recorded(config, folder)
