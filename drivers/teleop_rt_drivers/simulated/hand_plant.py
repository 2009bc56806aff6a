"""A hand that holds a simulated device: the device's encoder and drive act on the hand's mass."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.master.hand import Hand
from teleop_rt_drivers.simulated.config import (
    EnvironmentConfig,
    SensorConfig,
    ServoConfig,
    SimulatedPlantConfig,
)
from teleop_rt_drivers.simulated.motion import (
    POSITION,
    PUSH,
    PUSHING,
    SERVO_FORCE,
    VELOCITY,
    advance_reference,
)
from teleop_rt_drivers.simulated.plant import Plant

if TYPE_CHECKING:
    from teleop_rt.config_operator import HandOperator
    from teleop_rt.config_rig import RigConfig

DRIVE_STEP = 1e-6
NOWHERE = 1e6
"""There is no wall at the operator's side but the one that is rendered."""


class HandPlant(Plant):
    """Moves as the hand does, which feels what the drive pushes; all of it from one seed."""

    def __init__(self, hand: HandOperator, rig: RigConfig, start_ns: int, seed: int) -> None:
        self._period_ns = rig.period_ns
        self._hand = Hand(hand, rig.period_ns * 1e-9, np.random.default_rng(seed))
        config = SimulatedPlantConfig(
            environment=EnvironmentConfig(stiffness=1.0, damping=0.0, surface=NOWHERE),
            sensors=SensorConfig(encoder_resolution=rig.sensors.position_resolution),
            drive=ServoConfig(
                mass=hand.mass, force_max=rig.limits.force_max, position_resolution=DRIVE_STEP
            ),
            start=hand.intention.start,
        )
        self._moved_s = 0.0
        super().__init__(config, start_ns, seed)
        self._hand.reset()
        self._moved_s = 0.0

    def _integrate(self, span_ns: int) -> None:
        """Let the hand move on; a drive that does not push is felt as nothing.

        However long nobody asked, the hand is never integrated over more than a period at once.
        """
        pushed = float(self._constants[PUSH]) if self.mode == PUSHING else 0.0
        steps = max(1, math.ceil(span_ns / self._period_ns))
        step_s = span_ns * 1e-9 / steps
        for _ in range(steps):
            self._moved_s += step_s
            position, velocity = self._hand.update(self._moved_s, -pushed)
            self._state[POSITION], self._state[VELOCITY] = position, velocity
            advance_reference(self._state, self.mode, self._deceleration, step_s)
        self._state[SERVO_FORCE] = pushed
