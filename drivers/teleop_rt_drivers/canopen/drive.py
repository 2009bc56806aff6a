"""The drive, seen from the cycle: its state machine, its command frame, its answer."""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING

from teleop_rt_drivers.canopen import cia402
from teleop_rt_drivers.canopen.channel import Replies
from teleop_rt_drivers.canopen.cia402 import Cia402State
from teleop_rt_drivers.canopen.intake import SILENT_CYCLES, SourceRecord, kind_of, place

if TYPE_CHECKING:
    from teleop_rt.axis import Sample
    from teleop_rt_drivers.canopen.counters import Counters
    from teleop_rt_drivers.canopen.pdo import PdoCodec
    from teleop_rt_drivers.canopen.position_loop import PositionLoop
    from teleop_rt_drivers.quantity import DriveZero, Scale

_STATUSWORD, _SILENT = place("statusword"), place("silent_cycles")
_ACTUAL, _FORCE = place("actual"), place("force_counts")
LOWEST, HIGHEST = -(2**31), 2**31 - 1


class Intent(Enum):
    """The requested state of the drive."""

    IDLE = "no power"
    ARMING = "on the way to operation enabled"
    RUNNING = "operation enabled"
    STOPPED = "stopped, and stays so until armed again"


_POWERING = (Intent.ARMING, Intent.RUNNING)
_FAULTY = (Cia402State.FAULT, Cia402State.FAULT_REACTION)
_MOVING = (Cia402State.OPERATION_ENABLED, Cia402State.QUICK_STOP_ACTIVE)
# By these names a tick finds them at once: in Python 3.11 each look-up in an enum is a call.
_ARMING, _RUNNING, _STOPPED = Intent.ARMING, Intent.RUNNING, Intent.STOPPED
_ENABLED = Cia402State.OPERATION_ENABLED


class Torque:
    """The force that is commanded in mode 10: by a position loop, in thousandths of the rated."""

    def __init__(self, loop: PositionLoop, rated: float, sign: int) -> None:
        self.loop = loop
        self._per_unit = sign * cia402.PER_RATED / rated

    def counts(self, force: float) -> int:
        """Return a force [rig unit] as object 6071h holds it."""
        return min(max(round(force * self._per_unit), -(2**15)), 2**15 - 1)


class Drive:
    """Walks the CiA 402 states from the statusword, one controlword per cycle.

    While power is not enabled the commanded position is the actual one, so that enabling never
    jumps. A drive that leaves operation enabled by itself is not enabled again.
    """

    def __init__(
        self,
        tpdo: PdoCodec,
        rpdo: PdoCodec,
        scale: Scale,
        counters: Counters,
        zero: DriveZero = "encoder",
        torque: Torque | None = None,
        force_per_count: float | None = None,
    ) -> None:
        self.tpdo = tpdo
        self.rpdo = rpdo
        self.record = SourceRecord()
        self.replies = Replies(self.record)
        self.state = Cia402State.NOT_READY
        self.intent = self._settled = Intent.IDLE
        self.fell_out = False
        self._statusword = -1
        self._scale = scale
        self._zero = zero
        self._aligned = True
        self._counters = counters
        self._force_per_count = force_per_count
        self._describe(tpdo)
        self._control_slot = rpdo.slot(cia402.CONTROLWORD)
        self._target_slot = rpdo.slot(cia402.TARGET_POSITION)
        self._torque = torque
        self._torque_slot = -1 if torque is None else rpdo.slot(cia402.TARGET_TORQUE)
        self._fields = [0] * len(rpdo.words)
        self._target = 0
        self._position = 0.0

    def _describe(self, tpdo: PdoCodec) -> None:
        """Say where the kernels find what the drive answers."""
        source = self.record.source
        status, actual = tpdo.slot(cia402.STATUSWORD), tpdo.slot(cia402.ACTUAL_POSITION)
        source.is_drive, source.cob_id, source.length = 1, tpdo.cob_id, tpdo.struct.size
        source.status_at, source.status_kind = tpdo.places[status], kind_of(tpdo.kinds[status])
        source.number_at, source.number_kind = tpdo.places[actual], kind_of(tpdo.kinds[actual])
        if self._force_per_count is not None:
            force = tpdo.slot(cia402.ACTUAL_TORQUE)
            source.extra_at, source.extra_kind = tpdo.places[force], kind_of(tpdo.kinds[force])
        source.statusword, source.silent_cycles = -1, SILENT_CYCLES

    @property
    def _actual(self) -> float:
        """The position that the drive measures [counts]."""
        return self.record.floats[_ACTUAL]

    @property
    def takes_positions(self) -> bool:
        """Return whether the drive is in cyclic synchronous position mode."""
        return self._torque is None

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands, by a recent report of its own."""
        return self.intent is _RUNNING and self.record.counts[_SILENT] < SILENT_CYCLES

    def fill(self, sample: Sample) -> None:
        """Write the state and the measurements of the drive into a sample."""
        record, per_count = self.record, self._force_per_count
        sample.enabled = self.intent is _RUNNING and record.counts[_SILENT] < SILENT_CYCLES
        sample.drive_position = self._scale.value(record.floats[_ACTUAL])
        sample.drive_force = None if per_count is None else per_count * record.floats[_FORCE]

    @property
    def faulty(self) -> bool:
        """Return whether the drive reports a fault."""
        return self.state in _FAULTY

    def settle(self) -> bool:
        """Advance the intent by what this cycle brought; return whether the drive has failed."""
        statusword = self.record.counts[_STATUSWORD]
        if statusword != self._statusword or self.intent is not self._settled:
            self._advance(statusword)
        return self.fell_out or self.faulty

    def _advance(self, statusword: int) -> None:
        if statusword != self._statusword:
            self._statusword = statusword
            self.state = cia402.drive_state(statusword)
        if self.intent is _ARMING and self.state is _ENABLED:
            self.intent = _RUNNING
        elif self.intent is _RUNNING and self.state is not _ENABLED:
            self.intent = _STOPPED
            self.fell_out = True
        self._settled = self.intent

    def arm(self) -> None:
        """Begin the walk to operation enabled."""
        self.fell_out = False
        self.intent = _ARMING
        self._aligned = self._zero == "encoder"

    def disarm(self) -> None:
        """Begin again without power."""
        self.replies.reset()
        self.fell_out = False
        self.intent = Intent.IDLE
        self.state = Cia402State.NOT_READY
        source = self.record.source
        self._statusword = source.statusword = -1
        source.silent_cycles = SILENT_CYCLES

    def command(self, position: float) -> bytes:
        """Return the command frame for a position [rig unit]; it acts at the next SYNC.

        A position that is no number is counted and the last one is kept.
        """
        if self.intent is not _RUNNING:
            self._target = int(self._actual)
        elif math.isfinite(position):
            if not self._aligned:
                self._aligned = True
                self._scale = self._scale.moved(position - self._scale.value(self._actual))
            self._position = position
            self._target = min(max(self._scale.counts(position), LOWEST), HIGHEST)
        else:
            self._counters["bad_command"] += 1
        if self._torque is not None:
            running = self.intent is _RUNNING
            self._push(self._torque, self._position if running else None)
        return self._pack(self._controlword())

    def force_command(self, force: float) -> bytes:
        """Return the command frame for a force [rig unit], 0 until power is enabled."""
        counts = 0
        if self._torque is not None and self.intent is _RUNNING:
            if math.isfinite(force):
                counts = self._torque.counts(force)
            else:
                self._counters["bad_command"] += 1
        self._fields[self._torque_slot] = counts
        self._target = int(self._actual)
        return self._pack(self._controlword())

    def stop_command(self) -> bytes:
        """Return the frame that stops the drive, and ask for nothing else from now on."""
        self.intent = _STOPPED
        self._target = int(self._actual)
        if self._torque is not None:
            self._push(self._torque, None)
        return self._pack(cia402.QUICK_STOP)

    def _push(self, torque: Torque, position: float | None) -> None:
        """Set the force that leads to a position; None asks for none."""
        if position is None:
            torque.loop.reset()
            self._fields[self._torque_slot] = 0
        else:
            self._fields[self._torque_slot] = torque.counts(torque.loop.update(position))

    def _controlword(self) -> int:
        """Return the controlword for the present intent and state."""
        if self.intent in _POWERING:
            return cia402.NEXT_TOWARDS_ENABLED.get(self.state, cia402.DISABLE_VOLTAGE)
        if self.intent is _STOPPED and self.state in _MOVING:
            return cia402.QUICK_STOP
        return cia402.DISABLE_VOLTAGE

    def _pack(self, controlword: int) -> bytes:
        self._fields[self._control_slot] = controlword
        self._fields[self._target_slot] = self._target
        return self.rpdo.struct.pack(*self._fields)
