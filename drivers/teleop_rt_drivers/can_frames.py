"""Frames as SocketCAN's structs, as python-can's messages, and as the tuples that a loop reads."""

from __future__ import annotations

import struct
import time
from typing import TYPE_CHECKING, Any, Protocol, cast

import can
import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import bound
from teleop_rt_drivers.can_door import UNUSUAL, take_packets

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from teleop_rt_drivers.can_door import CanDoor

FRAME = struct.Struct("=IB3x8sQ")
BARE = struct.Struct("=IB3x8s")
WIDE = struct.Struct("=IBB2x64sQ")
# Flags and bits of an id, and most bytes of a frame, classical and FD (linux/can.h).
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000
STANDARD_MASK, EXTENDED_MASK = 0x7FF, 0x1FFFFFFF
LONGEST, LONGEST_WIDE = 8, 64
UNREADABLE = -1  # in place of an id, which is never negative
MOST_FRAMES_PER_CYCLE = 256
"""A full bus of 1 Mbit/s takes some 30 ms for so many of 8 bytes; the rest is for the next tick."""
LENGTH_AT, DATA_AT = 4, 8
"""Bytes of a slot where a frame's length and data are; its id is the first four."""
Slots = NDArray[np.uint8]
"""Frames for kernels (frames, at least BARE.size): each begins as BARE does."""
_BIT_RATE_SWITCH = 0x01  # CANFD_BRS of linux/can.h
_ID = 0xFFFFFFFF
"""The id in a slot without a frame; no frame has it."""


CanFrame = tuple[int, bytes | bytearray, int]
"""Id, bytes, and when the frame was sent [ns of CLOCK_MONOTONIC], 0 where nobody says it.

The id has SocketCAN's flags, so that only a plain frame's is a COB-ID; UNREADABLE marks data that
were not a frame. A tuple, because a loop reads thousands a second.
"""


Outgoing = tuple[int, bytes]
"""Id with SocketCAN's flags, and bytes, of a frame of classic CAN to send."""


class _WithDoor(Protocol):
    door: CanDoor

    def is_plain(self) -> bool:
        """Return whether all that can come now comes by the door."""

    def lend(self) -> bool:
        """Lend the door to kernels if all comes by it; return whether it is lent."""

    def keep(self) -> None:
        """Keep the door's last packets, which were UNUSUAL, for `waiting_frames`."""


class _Batching(Protocol):
    def waiting_frames(self, most: int) -> Sequence[CanFrame]:
        """Return the frames that have come, `most` at most."""

    def send_frame(self, can_id: int, data: bytes) -> None:
        """Send a frame of classic CAN."""

    def send_frames(self, frames: Sequence[Outgoing]) -> None:
        """Send frames of classic CAN one after the other."""


def reader_of(bus: can.BusABC) -> Callable[[int], Sequence[CanFrame]]:
    """Return a function that takes all waiting frames, up to a given number; it never raises."""
    if hasattr(bus, "waiting_frames"):
        return cast("_Batching", bus).waiting_frames
    return lambda most: one_by_one(bus, most)


class SlotReader:
    """Takes the frames that wait at a bus into `slots`, `most` at most; it never raises.

    `door` is the bus's, where it has one that kernels receive from themselves.
    """

    def __init__(self, bus: can.BusABC, most: int) -> None:
        self._most = most
        self._own: Slots = np.zeros((most, BARE.size), np.uint8)
        self._memory = self._own.data.cast("B")
        self._waiting_frames = reader_of(bus)
        self._frames: Sequence[CanFrame] | None = None
        self.slots = self._own
        self.door: CanDoor | None = None
        if hasattr(bus, "door"):
            self._bus: _WithDoor = cast("Any", bus)
            self.door = self._bus.door
            self._take = bound(take_packets, self.door.arrays)

    def is_plain(self) -> bool:
        """Return whether kernels can receive the waiting frames; if so, `slots` are the door's."""
        if self.door is None or not self._bus.is_plain():
            return False
        self.slots, self._frames = self.door.slots, None
        return True

    def is_lent(self) -> bool:
        """Return as `is_plain` does, for a kernel that uses the door while it is lent."""
        if self.door is None or not self._bus.lend():
            return False
        self.slots, self._frames = self.door.slots, None
        return True

    @property
    def all_slots(self) -> list[Slots]:
        """All that `slots` may be."""
        return [self._own] if self.door is None else [self._own, self.door.slots]

    @property
    def received(self) -> int:
        """How many frames a kernel received by the door last."""
        return 0 if self.door is None else self.door.door.frames

    def read(self) -> int:
        """Return how many frames have come."""
        if not self.is_plain():
            return self.read_otherwise()
        count = self._take()
        return self.read_unusual() if count == UNUSUAL else count

    def read_unusual(self) -> int:
        """Return how many frames have come, after a kernel that returned UNUSUAL."""
        self._bus.keep()
        return self.read_otherwise()

    def read_otherwise(self) -> int:
        """Return how many frames have come, without the door."""
        self._frames = frames = self._waiting_frames(self._most)
        for index, (can_id, data, _) in enumerate(frames):
            BARE.pack_into(self._memory, index * BARE.size, can_id & _ID, len(data), data)
        self.slots = self._own
        return len(frames)

    def frame(self, row: int) -> CanFrame:
        """Return a frame of those read last."""
        if self._frames is not None:
            return self._frames[row]
        size = self.slots.shape[1]
        return unpacked(self.slots.data.cast("B"), row * size, size)


def sender_of(bus: can.BusABC) -> Callable[[Sequence[Outgoing]], None]:
    """Return a function that sends frames of classic CAN without waiting.

    It raises as python-can's own `send` does.
    """
    if hasattr(bus, "send_frames"):
        return cast("_Batching", bus).send_frames

    def send(frames: Sequence[Outgoing]) -> None:
        for can_id, data in frames:
            bus.send(plain_message(can_id, data), 0)

    return send


def single_sender_of(bus: can.BusABC) -> Callable[[int, bytes], None]:
    """Return a function that sends one frame of classic CAN: as `sender_of` does."""
    if hasattr(bus, "send_frame"):
        return cast("_Batching", bus).send_frame
    return lambda can_id, data: bus.send(plain_message(can_id, data), 0)


def plain_message(can_id: int, data: bytes) -> can.Message:
    """Return a frame of classic CAN as python-can's message; a remote one asks for one byte."""
    extended, remote = bool(can_id & EXTENDED), bool(can_id & REMOTE)
    return can.Message(
        arbitration_id=can_id & (EXTENDED_MASK if extended else STANDARD_MASK),
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=bool(can_id & ERROR),
        dlc=1 if remote else len(data),
        data=b"" if remote else data,
    )


def wide_message(can_id: int, data: bytes) -> can.Message:
    """Return a frame of CAN FD, its data at the higher rate, as python-can's message."""
    extended = bool(can_id & EXTENDED)
    return can.Message(
        arbitration_id=can_id & (EXTENDED_MASK if extended else STANDARD_MASK),
        is_extended_id=extended,
        is_fd=True,
        bitrate_switch=True,
        data=data,
    )


def one_by_one(bus: can.BusABC, most: int) -> list[CanFrame]:
    """Take the frames that wait by python-can's own call."""
    frames: list[CanFrame] = []
    for _ in range(most):
        try:
            message = bus.recv(0)
        except (can.CanError, OSError, ValueError):
            frames.append((UNREADABLE, b"", 0))
            continue
        if message is None:
            break
        frames.append((flagged_id(message), message.data, monotonic_stamp(message)))
    return frames


def monotonic_stamp(message: can.Message) -> int:
    """Return when a frame was sent or came [ns, monotonic] by its wall clock's stamp."""
    stamp_s = message.timestamp
    return time.monotonic_ns() - time.time_ns() + round(stamp_s * 1e9) if stamp_s else 0


def flagged_id(message: can.Message) -> int:
    """Return a message's id with SocketCAN's flags."""
    can_id = message.arbitration_id
    if message.is_extended_id:
        can_id |= EXTENDED
    if message.is_remote_frame:
        can_id |= REMOTE
    if message.is_error_frame:
        can_id |= ERROR
    return can_id


def packed(message: can.Message, now_ns: int) -> bytes:
    """Return a message as one of SocketCAN's structs, with the time that it is sent.

    Raises CanOperationError for a frame that is longer than its kind can be.
    """
    if message.dlc > (LONGEST_WIDE if message.is_fd else LONGEST):
        raise can.CanOperationError(f"a frame of {message.dlc} bytes is not a CAN frame")
    if message.is_fd:
        flags = _BIT_RATE_SWITCH if message.bitrate_switch else 0
        return WIDE.pack(flagged_id(message), message.dlc, flags, bytes(message.data), now_ns)
    return FRAME.pack(flagged_id(message), message.dlc, message.data, now_ns)


def unpacked_plainly(data: bytes | memoryview) -> list[CanFrame]:
    """Return the frames of a packet of nothing but FRAMEs."""
    return [
        (can_id, content if size >= LONGEST else content[:size], sent_ns)
        for can_id, size, content, sent_ns in FRAME.iter_unpack(data)
    ]


def unpacked(data: bytes | memoryview, place: int, length: int) -> CanFrame:
    """Return the frame of the packet of this length that begins at `place`."""
    if length == FRAME.size:
        can_id, size, content, sent_ns = FRAME.unpack_from(data, place)
    elif length == WIDE.size:
        can_id, size, _, content, sent_ns = WIDE.unpack_from(data, place)
    elif length == BARE.size:
        can_id, size, content = BARE.unpack_from(data, place)
        sent_ns = time.monotonic_ns()
    else:
        return UNREADABLE, b"", 0
    return can_id, content[:size], sent_ns


def message_of(data: bytes) -> tuple[int, can.Message]:
    """Return when a frame was sent [ns, monotonic] and the frame, stamped as python-can does.

    That is with the wall clock [s since 1970], as it stands now: one that is set while a frame
    waits makes it no older. Raises CanOperationError for other than a frame.
    """
    now_ns = time.monotonic_ns()
    if len(data) == FRAME.size:
        can_id, length, content, sent_ns = FRAME.unpack(data)
    elif len(data) == WIDE.size:
        return _wide_message(data, now_ns)
    elif len(data) == BARE.size:
        can_id, length, content = BARE.unpack(data)
        sent_ns = now_ns
    else:
        raise can.CanOperationError(f"a packet of {len(data)} bytes is not a CAN frame")
    stamp_s = (time.time_ns() - now_ns + sent_ns) * 1e-9
    if can_id <= STANDARD_MASK:  # nearly all
        return sent_ns, can.Message(stamp_s, can_id, is_extended_id=False, data=content[:length])
    extended = bool(can_id & EXTENDED)
    remote = bool(can_id & REMOTE)
    return sent_ns, can.Message(
        timestamp=stamp_s,
        arbitration_id=can_id & (EXTENDED_MASK if extended else STANDARD_MASK),
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=bool(can_id & ERROR),
        dlc=min(length, LONGEST),
        data=b"" if remote else content[:length],
    )


def _wide_message(data: bytes, now_ns: int) -> tuple[int, can.Message]:
    """Return when a CAN FD frame was sent, and the frame."""
    can_id, length, flags, content, sent_ns = WIDE.unpack(data)
    extended = bool(can_id & EXTENDED)
    length = min(length, LONGEST_WIDE)
    return sent_ns, can.Message(
        timestamp=(time.time_ns() - now_ns + sent_ns) * 1e-9,
        arbitration_id=can_id & (EXTENDED_MASK if extended else STANDARD_MASK),
        is_extended_id=extended,
        is_fd=True,
        bitrate_switch=bool(flags & _BIT_RATE_SWITCH),
        dlc=length,
        data=content[:length],
    )
