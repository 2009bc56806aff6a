"""A maker's drive as a port of framed devices: orders in, position and torque out.

To the axis it is one source and one command, `drive`. This module decides, alike for all makers and
wires, which frames an order takes, how the drive is given power and when it is asked.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisFault
from teleop_rt_drivers.actuators.codec import DriveState, Report, Taken
from teleop_rt_drivers.framed.source import FieldInfo, Source

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from teleop_rt_drivers.actuators.codec import Codec, Frame, Frames, TorqueCodec
    from teleop_rt_drivers.actuators.wire import Wire
    from teleop_rt_drivers.framed.source import Values
    from teleop_rt_drivers.framed.stream import Watched
    from teleop_rt_drivers.framed.written_frame import StoredAim

DRIVE = "drive"
OFF, FOLLOW, STOP = 0, 1, 2
"""The control values of the command."""
POSITION, VELOCITY, TORQUE, STATE = range(4)
ORDER_AGAIN_NS = 20_000_000
"""Time after which an order to switch on or off is repeated to a drive that has not obeyed yet."""
BRAKING_NS = 100_000_000
"""Longest time under power in which a stopped drive comes to rest; then it is switched off."""
SLOWING_NS, SLOWER = 20_000_000, 0.9
"""Longest time in which its speed falls by no tenth: then the body pushes it, and it gives way."""
STEADY_NS = 20_000_000
"""Time between two targets beyond which no velocity is derived from them."""
AT_REST_PER_S = 0.02
"""Speed [turn/s or rad/s] below which a drive counts as at rest."""
CLOSING_TRIES, CLOSING_WAIT_S = 5, 0.01
"""How often, and how long each time, a drive that is left is asked to say that it has no power."""


class ActuatorPort:
    """Speaks a codec on a wire that it takes over and closes; `by_torque` asks it for torques."""

    def __init__(
        self,
        codec: Codec,
        wire: Wire,
        counters: dict[str, int],
        now_ns: Callable[[], int],
        state_timeout_ns: int,
        watchdog_ns: int | None,
        by_torque: TorqueCodec | None = None,
    ) -> None:
        self.wire = wire
        self._counters = counters
        unit = codec.unit
        fields = (
            FieldInfo("position", unit),
            FieldInfo("velocity", f"{unit}/s"),
            FieldInfo("torque", "Nm"),
            FieldInfo("state", ""),
        )
        target = FieldInfo("target", "Nm" if by_torque else unit)
        self.sources = {DRIVE: Source(DRIVE, fields)}
        self.commands = {DRIVE: Source(DRIVE, (FieldInfo("control", ""), target))}
        self.report = Report()
        self._codec = codec
        self._now_ns = now_ns
        self._by_torque = by_torque
        self._opened = False
        self._state_timeout_ns = state_timeout_ns
        self._unreported_ns = None if codec.reports_time_out else watchdog_ns
        self._let_go, self._failed = "", False
        self._values = [0.0] * 4
        self._state_ns = self._ordered_ns = self._braking_ns = -1
        self._slowest, self._slowed_ns = 0.0, 0
        self._asked_ns = 0
        self._target, self._target_ns = 0.0, -STEADY_NS

    @property
    def fault(self) -> AxisFault:
        """Fault of the wire, or of a second master on it."""
        return self.wire.fault

    @property
    def complaint(self) -> str:
        """The drive's own description of its fault, empty for none."""
        return self._let_go or self.report.complaint

    @property
    def watched(self) -> Sequence[Watched]:
        """The open line or bus."""
        return self.wire.watched

    def open(self) -> None:
        """Reset: clear all faults, also in the drive, which stays without power."""
        self.wire.open(self._take)
        self._opened = True
        self.report.state, self.report.complaint = DriveState.BUSY, ""
        self._let_go, self._failed = "", False
        self._state_ns = self._ordered_ns = self._braking_ns = -1
        for frame in self._codec.opening():
            self._order((frame,))
            self.wire.settle()

    def drain(self, now_ns: int) -> None:
        """Take all that has arrived."""
        self.wire.drain(now_ns)

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive; a drive that must be asked is asked again."""
        if self._codec.asks:
            self._order(self._codec.disable())
        self.wire.wait(timeout_s)

    def close(self) -> None:
        """Leave the drive without power, and release the wire."""
        for _ in range(CLOSING_TRIES if self._opened else 0):
            if self.wire.fault is not AxisFault.NONE or self.report.state is DriveState.OFF:
                break
            self._order(self._codec.disable())
            self.wire.wait(CLOSING_WAIT_S)
            self.drain(self._now_ns())
        self._opened = False
        self.wire.close()

    def _take(self, frame: Frame, now_ns: int) -> None:
        """Take a frame into the report, and hand a new measurement on."""
        taken = self._codec.take(frame, self.report)
        if taken is Taken.MEASURED:
            self._watch(now_ns)
            self._deliver(now_ns)
        elif taken is Taken.PLACED:
            self._place()
        elif taken is Taken.STATE:
            self._state_ns = now_ns
        elif taken is Taken.REFUSED:
            self._counters[self.report.refusal] += 1
        elif taken is not Taken.NOTED:
            self._counters["unexpected_id"] += 1
            if taken is Taken.FOREIGN:
                self.wire.raise_fault(AxisFault.FOREIGN_MASTER)

    def _watch(self, now_ns: int) -> None:
        """Take a drive without a reported time-out as stopped after so long without a command."""
        silent_ns = now_ns - self._asked_ns
        if self._unreported_ns is None or silent_ns <= self._unreported_ns:
            return
        if self.report.state is DriveState.FOLLOWING:
            self._let_go = f"nothing was sent to the drive for {silent_ns // 1_000_000} ms"
            self._order(self._codec.disable())
            self.report.state = DriveState.OFF

    def _deliver(self, now_ns: int) -> None:
        """Hand the measured values on."""
        if self._codec.asks:
            now_ns = self._state_ns = self._measured_ns(self._asked_ns)
        self._hand_on(now_ns)

    def _measured_ns(self, asked_ns: int) -> int:
        """Return when an answer was measured: when it was asked, or half way to its arrival."""
        return asked_ns + max(0, self.wire.arrived_ns - asked_ns) // 2

    def _place(self) -> None:
        """Take a position alone; this port asks for none."""

    def _hand_on(self, now_ns: int) -> None:
        """Hand the report on, unless the drive's state is too old to be known."""
        if self._state_ns < 0 or now_ns - self._state_ns > self._state_timeout_ns:
            self._counters["stale_state"] += 1
            return
        report, values = self.report, self._values
        values[POSITION], values[VELOCITY] = report.position, report.velocity
        values[TORQUE] = report.torque
        values[STATE] = DriveState.FAULT if self._failed else report.state
        self._counters["frames"] += 1
        self.sources[DRIVE].deliver(values, now_ns)

    def target_sender(self, aim: StoredAim) -> None:
        """Return None: an order may take several frames."""

    def send(self, command: str, values: Values) -> None:  # noqa: ARG002 - the port has but one
        """Send the frames of an order: a control value and a target [turn or rad, or Nm]."""
        control, target = int(values[0]), values[1]
        now_ns, state = self._now_ns(), self.report.state
        if control == FOLLOW:
            self._braking_ns = -1
            self._follow(target, state, now_ns)
        elif control == STOP and state is DriveState.FOLLOWING and self._brakes(now_ns):
            by_torque = self._by_torque
            self._order(self._codec.brake() if by_torque is None else by_torque.push(0.0))
        else:  # also to one without power: a frame keeps its watchdog from expiring
            self._repeat(self._codec.disable(), now_ns)

    def _follow(self, target: float, state: DriveState, now_ns: int) -> None:
        if state is DriveState.FOLLOWING:
            by_torque = self._by_torque
            self._order(
                self._toward(target, now_ns) if by_torque is None else by_torque.push(target)
            )
        elif state is DriveState.FAULT or self._failed:
            self._fail()
            self._repeat(self._codec.disable(), now_ns)
        else:
            self._repeat(self._codec.enable(self.report.position), now_ns)

    def _fail(self) -> None:
        """Remember a fault until the port is opened again: some drives forget theirs."""
        if not self._failed:
            self._failed, self._let_go = True, self.report.complaint

    def _toward(self, target: float, now_ns: int) -> Frames:
        """Return the order to a target, at the velocity of the targets themselves."""
        elapsed_ns = now_ns - self._target_ns
        fresh = 0 < elapsed_ns <= STEADY_NS
        rate = (target - self._target) / (elapsed_ns * 1e-9) if fresh else 0.0
        self._target, self._target_ns = target, now_ns
        return self._codec.follow(target, rate)

    def _brakes(self, now_ns: int) -> bool:
        """Return whether a stopped drive is still coming to rest under power.

        One that is pushed back does not: it would go on to press on the body that stopped it.
        """
        speed = abs(self.report.velocity)
        if self._braking_ns < 0:
            self._braking_ns, self._slowest = now_ns, math.inf
        if speed < SLOWER * self._slowest:
            self._slowest, self._slowed_ns = speed, now_ns
        slows = now_ns - self._slowed_ns < SLOWING_NS
        return slows and speed > AT_REST_PER_S and now_ns - self._braking_ns < BRAKING_NS

    def _repeat(self, frames: Frames, now_ns: int) -> None:
        """Send an order that takes effect later: now and then, or each cycle where it asks."""
        if self._codec.asks or self._ordered_ns < 0 or now_ns - self._ordered_ns >= ORDER_AGAIN_NS:
            self._ordered_ns = now_ns
            self._order(frames)

    def _order(self, frames: Frames) -> None:
        now_ns = self._now_ns()
        if self.wire.order(frames, now_ns):
            self._asked_ns = now_ns
