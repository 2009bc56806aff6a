"""The drive, seen from the cycle: its state machine, its command frame, its answer."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

from teleop_rt.kernels.jit import bound
from teleop_rt_drivers.can_door import LENGTH_SHIFT
from teleop_rt_drivers.canopen import cia402, exchange
from teleop_rt_drivers.canopen.channel import Replies
from teleop_rt_drivers.canopen.cia402 import Cia402State
from teleop_rt_drivers.canopen.intake import SILENT_CYCLES, format_code
from teleop_rt_drivers.canopen.source import SourceRecord, place
from teleop_rt_drivers.drive_intent import (
    ARMING,
    IDLE,
    POWERING,
    RUNNING,
    STOPPED,
    Intent,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt_drivers.can_door import CanDoor
    from teleop_rt_drivers.canopen.counters import Counters
    from teleop_rt_drivers.canopen.pdo import PdoCodec
    from teleop_rt_drivers.canopen.position_loop import PositionLoop
    from teleop_rt_drivers.canopen.source import Sources
    from teleop_rt_drivers.quantity import DriveZero, Scale

_STATUSWORD, _SEEN = place("statusword"), place("seen")
_SILENT, _TARGET = place("silent_cycles"), place("target")
_ACTUAL, _RUNNING = place("actual"), place("running")
_UNSEEN = -2
"""In place of the statusword that was looked at: it is to be looked at again."""


_FAULTY = (Cia402State.FAULT, Cia402State.FAULT_REACTION)
_MOVING = (Cia402State.OPERATION_ENABLED, Cia402State.QUICK_STOP_ACTIVE)
# By this name a tick finds it at once: in Python 3.11 each look-up in an enum is a call.
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
        self.intent = IDLE
        self.fell_out = False
        self._zero = zero
        self.record.source.aligned = 1
        self._counters = counters
        self._force_per_count = force_per_count
        self._control_slot = rpdo.slot(cia402.CONTROLWORD)
        self._target_slot = rpdo.slot(cia402.TARGET_POSITION)
        self._describe(tpdo, rpdo, scale)
        self._torque = torque
        self._torque_slot = -1 if torque is None else rpdo.slot(cia402.TARGET_TORQUE)
        self._fields = [0] * len(rpdo.words)
        self._position = 0.0
        self.bind(self.record.stored)

    def bind(self, stored: Sources) -> None:
        """Let the drive's record live in this array (1,) from now on."""
        self.record.bind(stored)
        self._aim = bound(exchange.set_target, (stored,), 0.0)

    def sender(self, door: CanDoor) -> Callable[[float], int] | None:
        """Return a sender of a position [rig unit]: see `exchange.send_position`.

        A drive that takes forces has none: its loop computes them first.
        """
        if self._torque is not None:
            return None
        arrays = self.record.stored, door.arrays[0], door.words
        send = bound(exchange.send_position, arrays, 0, 0, 0.0)
        head = self.rpdo.cob_id | self.rpdo.struct.size << LENGTH_SHIFT
        return functools.partial(send, head, cia402.ENABLE_OPERATION)

    def _describe(self, tpdo: PdoCodec, rpdo: PdoCodec, scale: Scale) -> None:
        """Give the kernels the places of the drive's answers and of a command's fields."""
        source = self.record.source
        source.offset, source.gain = scale.offset, scale.sign * scale.per_count
        source.control_at = rpdo.places[self._control_slot]
        source.target_at = rpdo.places[self._target_slot]
        status, actual = tpdo.slot(cia402.STATUSWORD), tpdo.slot(cia402.ACTUAL_POSITION)
        source.is_drive, source.cob_id, source.length = 1, tpdo.cob_id, tpdo.struct.size
        source.status_at, source.status_kind = tpdo.places[status], format_code(tpdo.kinds[status])
        source.number_at, source.number_kind = tpdo.places[actual], format_code(tpdo.kinds[actual])
        if self._force_per_count is not None:
            force = tpdo.slot(cia402.ACTUAL_TORQUE)
            source.extra_at, source.extra_kind = tpdo.places[force], format_code(tpdo.kinds[force])
            source.force_gain = self._force_per_count
        source.statusword = source.seen = -1
        source.silent_cycles = SILENT_CYCLES

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
        return self.intent is RUNNING and self.record.counts[_SILENT] < SILENT_CYCLES

    def _intend(self, intent: Intent) -> None:
        """Request this state from now on."""
        self.intent = intent
        self.record.counts[_RUNNING] = intent is RUNNING

    @property
    def faulty(self) -> bool:
        """Return whether the drive reports a fault."""
        return self.state in _FAULTY

    def settle(self) -> bool:
        """Advance the intent by this cycle's frames; return whether the drive has failed."""
        counts = self.record.counts
        if counts[_STATUSWORD] != counts[_SEEN]:
            self._advance(counts[_STATUSWORD])
        return self.fell_out or self.faulty

    def _advance(self, statusword: int) -> None:
        self.record.counts[_SEEN] = statusword
        if statusword >= 0:
            self.state = cia402.drive_state(statusword)
        if self.intent is ARMING and self.state is _ENABLED:
            self._intend(RUNNING)
        elif self.intent is RUNNING and self.state is not _ENABLED:
            self._intend(STOPPED)
            self.fell_out = True

    def arm(self) -> None:
        """Begin the walk to operation enabled."""
        self.fell_out = False
        self._intend(ARMING)
        self.record.counts[_SEEN] = _UNSEEN
        self.record.source.aligned = self._zero == "encoder"

    def disarm(self) -> None:
        """Begin again without power."""
        self.replies.reset()
        self.fell_out = False
        self._intend(IDLE)
        self.state = Cia402State.NOT_READY
        source = self.record.source
        source.statusword = source.seen = -1
        source.silent_cycles = SILENT_CYCLES

    def command(self, position: float) -> bytes:
        """Return the command frame for a position [rig unit]; it acts at the next SYNC.

        A position that is no number is counted and the last one is kept.
        """
        if self.intent is not RUNNING:
            self._stay()
        elif math.isfinite(position):
            source = self.record.source
            if not source.aligned:
                source.aligned = 1
                source.offset += position - (source.offset + source.gain * source.actual)
            self._position = position
            self._aim(position)
        else:
            self._counters["bad_command"] += 1
        if self._torque is not None:
            running = self.intent is RUNNING
            self._push(self._torque, self._position if running else None)
        return self._pack(self.controlword())

    def force_command(self, force: float) -> bytes:
        """Return the command frame for a force [rig unit], 0 until power is enabled."""
        counts = 0
        if self._torque is not None and self.intent is RUNNING:
            if math.isfinite(force):
                counts = self._torque.counts(force)
            else:
                self._counters["bad_command"] += 1
        self._fields[self._torque_slot] = counts
        self._stay()
        return self._pack(self.controlword())

    def stop_command(self) -> bytes:
        """Return the frame that stops the drive, and ask for nothing else from now on."""
        self._intend(STOPPED)
        self._stay()
        if self._torque is not None:
            self._push(self._torque, None)
        return self._pack(cia402.QUICK_STOP)

    def _stay(self) -> None:
        """Take where the drive is for the target."""
        self.record.counts[_TARGET] = int(self._actual)

    def _push(self, torque: Torque, position: float | None) -> None:
        """Set the force that leads to a position; None asks for none."""
        if position is None:
            torque.loop.reset()
            self._fields[self._torque_slot] = 0
        else:
            self._fields[self._torque_slot] = torque.counts(torque.loop.update(position))

    def controlword(self) -> int:
        """Return the controlword for the present intent and state."""
        if self.intent in POWERING:
            return cia402.NEXT_TOWARDS_ENABLED.get(self.state, cia402.DISABLE_VOLTAGE)
        if self.intent is STOPPED and self.state in _MOVING:
            return cia402.QUICK_STOP
        return cia402.DISABLE_VOLTAGE

    def _pack(self, controlword: int) -> bytes:
        self._fields[self._control_slot] = controlword
        self._fields[self._target_slot] = self.record.counts[_TARGET]
        return self.rpdo.struct.pack(*self._fields)
