"""An operator's device and the hand that holds it, as one plant with encoder and drive."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from teleop_rt.kernels.jit import bound
from teleop_rt.master.hand import Hand
from teleop_rt.signals import HANDLE_TRUTH
from teleop_rt_drivers.simulated import handle_motion
from teleop_rt_drivers.simulated.config import (
    EnvironmentConfig,
    SensorConfig,
    ServoConfig,
    SimulatedPlantConfig,
)
from teleop_rt_drivers.simulated.motion import (
    DECELERATION,
    HISTORY,
    POSITION,
    PUSHING,
    VELOCITY,
    advance_reference,
    force_at,
)
from teleop_rt_drivers.simulated.plant import Plant
from teleop_rt_drivers.simulated.senses import HEAD, NOW, REPORTED_NS

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt.config.device import DeviceBody
    from teleop_rt.config.operator import DeviceOperator, HandOperator
    from teleop_rt_drivers.simulated.motion import Vector
    from teleop_rt_drivers.transport import TransportTimes

DRIVE_STEP = 1e-6
"""Resolution of the handle's drive [rig unit]."""
NOWHERE = 1e3
"""There is no wall at the operator's side but the one that is rendered."""


class HandPlant(Plant):
    """Moves as device and hand do, under the drive's force; all of it from one seed.

    `transport` is the time of samples and forces on their way that the clock does not show.
    `truth_row` is the newest row of `teleop_rt.signals.HANDLE_TRUTH`; `on_truth` is called with it.
    """

    def __init__(
        self, operator: DeviceOperator, transport: TransportTimes, start_ns: int, seed: int
    ) -> None:
        assert operator.hand is not None  # noqa: S101 - who simulates a device has a hand for it
        hand, rig, body = operator.hand, operator.rig, operator.plant or operator.body
        self.body = body
        self._period_ns = rig.period_ns
        self._let_go_s = math.inf if hand.let_go_s is None else hand.let_go_s
        self._hand = Hand(hand, rig.period_ns * 1e-9, np.random.default_rng(seed))
        self._handle = np.zeros(handle_motion.STATES)
        self._handle[[handle_motion.POSITION, handle_motion.HAND]] = hand.intention.start
        self._handle_constants = _constants(body, hand)
        self.sample_age_ns = round(1e9 * transport.hidden_age_s + 1e6 * body.position_latency_ms)
        self.command_delay_ns = round(1e9 * transport.hidden_delay_s + 1e6 * body.force_latency_ms)
        self._pending: deque[tuple[int, float]] = deque()
        self._command = 0.0
        self._moved_s = 0.0
        self.truth_row = np.zeros(len(HANDLE_TRUTH))
        self.on_truth: Callable[[], None] | None = None
        config = SimulatedPlantConfig(
            environment=EnvironmentConfig(stiffness=1.0, damping=0.0, surface=NOWHERE),
            sensors=SensorConfig(encoder_resolution=rig.sensors.position_resolution),
            drive=ServoConfig(
                mass=body.mass, force_max=rig.limits.force_max, position_resolution=DRIVE_STEP
            ),
            start=hand.intention.start,
        )
        super().__init__(config, start_ns, seed)
        self._positions = np.full(HISTORY, hand.intention.start)
        arrays = self._handle, self._handle_constants, self._stamps, self._positions
        example = 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
        self._move_handle = bound(handle_motion.move_handle, arrays, *example)

    def _compile(self) -> None:
        """Compile the kernel of earlier positions; that of the motion is bound to its arrays."""
        force_at(self._stamps, self._forces, 1, self.now_ns)

    @property
    def answers(self) -> bool:
        """Return false: device and hand move by kernels of their own."""
        return False

    def advance(self, to_ns: int) -> None:
        """Move up to `to_ns`, by the same steps as any plant."""
        for end_ns in (to_ns - REPORTED_NS, to_ns):
            if end_ns > self.now_ns:
                self._integrate(end_ns - self.now_ns)
                self._numbers[NOW] = end_ns

    @property
    def reported_position(self) -> float:
        """Position that a drive with its own encoder reports now, at the age of its sample."""
        at_ns = self.now_ns - self.sample_age_ns
        return float(force_at(self._stamps, self._positions, self._numbers[HEAD], at_ns))

    @property
    def servo_force(self) -> float:
        """Force of the drive on the handle now."""
        return float(self._handle[handle_motion.MOTOR])

    @property
    def encoder_counts(self) -> float:
        """Position as the encoder counts it, as old as it is by then, not rounded."""
        return self.reported_position / self.config.sensors.encoder_resolution

    def push(self, force: float) -> None:
        """Push with a force once the command has come through."""
        self.mode = PUSHING
        self._pending.append((self.now_ns + self.command_delay_ns, force))

    def power_off(self) -> None:
        """Take the motor's force away, and the commanded one."""
        super().power_off()
        self._pending.clear()
        self._command = 0.0

    def slow_down(self, deceleration: float) -> None:
        """Stop a drive that pushes: it pushes no more."""
        super().slow_down(deceleration)
        self._pending.clear()
        self._command = 0.0

    def _integrate(self, span_ns: int) -> None:
        """Let device and hand move on; a drive that does not push is felt as friction alone.

        However long nobody asked, the hand is never asked for more than a period at once.
        """
        now_ns, end_ns = self.now_ns, self.now_ns + span_ns
        while now_ns < end_ns:
            until_ns = min(end_ns, now_ns + self._period_ns)
            self._advance_hand(now_ns, until_ns)
            now_ns = until_ns
        self._note_truth(end_ns)

    def _advance_hand(self, from_ns: int, to_ns: int) -> None:
        """Move on by at most a period, over which the hand's wish runs in a straight line."""
        span_s = (to_ns - from_ns) * 1e-9
        self._moved_s += span_s
        wish = self._hand.intend(self._moved_s, -float(self._handle[handle_motion.MOTOR]))
        grip = wish.grip if self._moved_s < self._let_go_s else 0.0
        now_ns = from_ns
        while now_ns < to_ns:
            while self._pending and self._pending[0][0] <= now_ns:
                self._command = self._pending.popleft()[1]
            until_ns = min(to_ns, self._pending[0][0]) if self._pending else to_ns
            self._numbers[HEAD] = self._move_handle(
                self._numbers.item(HEAD),
                now_ns,
                until_ns,
                self._command,
                wish.goal,
                wish.rate,
                wish.tremor,
                grip,
                to_ns,
            )
            now_ns = until_ns
        self._state[POSITION] = self._handle[handle_motion.POSITION]
        self._state[VELOCITY] = self._handle[handle_motion.VELOCITY]
        advance_reference(self._state, self.mode, self._constants.item(DECELERATION), span_s)

    def _note_truth(self, now_ns: int) -> None:
        handle = self._handle
        self.truth_row[:] = (
            now_ns,
            handle[handle_motion.POSITION],
            handle[handle_motion.VELOCITY],
            handle[handle_motion.PORT],
            -handle[handle_motion.MOTOR],
            handle[handle_motion.GIVEN],
        )
        if self.on_truth is not None:
            self.on_truth()

    def truth(self) -> dict[str, Any]:
        """Return the truth on device and hand, in the rig's units."""
        return {
            "device": self.body.model_dump(),
            "sample_age_ms": self.sample_age_ns * 1e-6,
            "command_delay_ms": self.command_delay_ns * 1e-6,
            "energy_J": float(self._handle[handle_motion.GIVEN]),
            "energy_min_J": float(self._handle[handle_motion.LEAST]),
            "motor_energy_J": float(self._handle[handle_motion.MOTOR_WORK]),
        }


def _constants(body: DeviceBody, hand: HandOperator) -> Vector:
    """Return the constants of the kernel."""
    constants = np.zeros(handle_motion.CONSTANTS)
    constants[handle_motion.MASS], constants[handle_motion.DAMPING] = body.mass, body.damping
    constants[handle_motion.DRY] = body.coulomb_friction
    constants[handle_motion.STOP_MIN], constants[handle_motion.STOP_MAX] = (
        body.end_stop_min,
        body.end_stop_max,
    )
    constants[handle_motion.MOTOR_LAG_S] = 1 / (2 * math.pi * body.force_bandwidth_hz)
    constants[handle_motion.HAND_MASS] = hand.mass
    constants[handle_motion.HAND_STIFFNESS] = hand.stiffness
    constants[handle_motion.HAND_DAMPING] = hand.damping
    constants[handle_motion.HAND_FORCE] = hand.force_max
    return constants
