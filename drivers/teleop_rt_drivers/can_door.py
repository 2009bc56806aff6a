"""A socket that carries CAN frames in packets, for kernels: a cycle's are received in one step."""

from __future__ import annotations

import select
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.record import record_type
from teleop_rt.realtime.packets import Packets
from teleop_rt.realtime.system_calls import is_ready, monotonic_ns, receive_packets, send_bytes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from teleop_rt_drivers.can_frames import Slots

FRAMES_PER_PACKET = 7  # at most, of those that a program sends at once
_ROOM = FRAMES_PER_PACKET + 1
"""Frames for which a packet has room: a packet that fills it may be longer, and is no frames."""
PACKETS_AT_ONCE = 16  # in one call: more that wait are Python's to take
UNUSUAL = -1 << 20
"""In place of a number of frames: Python must read the received packet, or check the socket."""
NOT_LENT = UNUSUAL - 1
"""In place of a number of frames: nothing was received, for the bus has not lent its door."""


def poll_words(descriptors: Sequence[int]) -> Whole:
    """Return the `struct pollfd`s (n,) that wait until one of these descriptors is readable."""
    return np.array([one | select.POLLIN << DESCRIPTOR_BITS for one in descriptors], np.int64)


class CanDoorFields:
    """Fields of a socket: its descriptor, its packets' headers, and the last call's packets.

    That is `received` packets, or minus the number of an error, with `frames` frames. `sending` is
    the address of the words of a `CanDoor`, of which a frame to send takes `frame_bytes`. While it
    is `lent`, all comes by the door, and Python need not ask the bus: unless somebody wants to come
    in, after whom a kernel looks each LOOK_EVERY cycles, so in `look_in` cycles again.
    """

    descriptor: int
    headers: int
    most: int
    received: int
    frames: int
    sending: int
    frame_bytes: int
    lent: int
    look_in: int


_DOOR = record_type(CanDoorFields)
Doors = NDArray[np.record]
Lengths = NDArray[np.uint32]
Whole = NDArray[np.int64]

LOOK_EVERY = 16
"""Cycles between two searches for new programs on a bus."""
_ID, _DATA, _STAMP, _CLOCK = range(4)
"""Words of a frame to send, id with length, bytes and stamp, and where the clock is read to."""
_WORD = 8  # bytes of an int64
_CLOCK_WORDS = 2  # a timespec: seconds and nanoseconds
_COMERS = _CLOCK + _CLOCK_WORDS
"""Word of a `struct pollfd`, on whose descriptor new programs come."""
DESCRIPTOR_BITS = 32
"""Place of the wanted events in the word of a `struct pollfd` [bits]."""
LENGTH_SHIFT = 32
"""Place of a frame's length in the word of its id [bits]."""


class CanDoor:
    """Room for a socket's packets: `slots` of `size` bytes hold its frames for kernels.

    `arrays` are those of `take_packets`, `words` those of `put_frame`, and `door` the
    socket's fields by name.
    """

    def __init__(self, size: int) -> None:
        room = _ROOM * size
        self.packets = packets = Packets(PACKETS_AT_ONCE, room)
        memory = np.frombuffer(packets.memory, np.uint8)
        self.slots: Slots = memory.reshape(PACKETS_AT_ONCE * _ROOM, size)
        stored: Doors = np.zeros(1, _DOOR)
        self.door = cast("CanDoorFields", stored[0])
        self.door.descriptor = -1
        self.door.headers, self.door.most = packets.headers, PACKETS_AT_ONCE
        self.words: Whole = np.zeros(_COMERS + 1, np.int64)
        self.words[_COMERS] = -1
        self.door.sending, self.door.frame_bytes = self.words.ctypes.data, size
        self.arrays = stored, np.asarray(packets.lengths), self.slots

    def look_after(self, descriptor: int) -> None:
        """Look on this descriptor for new programs."""
        self.words[_COMERS] = descriptor | select.POLLIN << DESCRIPTOR_BITS

    @property
    def comers(self) -> int:
        """The descriptor on which new programs come, -1 without."""
        return int(self.words[_COMERS].astype(np.int32))

    def lend(self, *, all_comes: bool) -> bool:
        """Lend the door to kernels if all comes by it; return whether it is lent."""
        self.door.lent = all_comes
        return all_comes

    def take_back(self) -> None:
        """Let no kernel receive by a lent door: something may be kept, or come by another way."""
        self.door.lent = 0


@kernel
def take_lent(stored: Doors, lengths: Lengths, slots: Slots) -> int:
    """Receive a cycle's frames by a lent door as `take_packets` does; or return NOT_LENT."""
    door: Any = stored[0]
    door.look_in -= 1
    if door.look_in <= 0:
        door.look_in = LOOK_EVERY
        if is_ready(door.sending + _COMERS * _WORD):
            door.lent = 0
    return take_packets(stored, lengths, slots) if door.lent > 0 else NOT_LENT


@kernel
def take_packets(stored: Doors, lengths: Lengths, slots: Slots) -> int:
    """Receive the waiting frames into the first slots; return their number, or UNUSUAL.

    With UNUSUAL the packets lie as they were received: other than plain frames, the end of the
    socket, or so much that more may wait.
    """
    door: Any = stored[0]
    received = receive_packets(door.descriptor, door.headers, door.most)
    door.received, door.frames = received, 0
    if received < 0 or received == door.most or not are_plain(lengths, received, slots):
        return UNUSUAL
    for packet in range(received):
        move_up(slots, packet, int(lengths[packet]) // slots.shape[1], door.frames)
        door.frames += int(lengths[packet]) // slots.shape[1]
    return int(door.frames)


@kernel
def are_plain(lengths: Lengths, packets: int, slots: Slots) -> bool:
    """Return whether these packets are whole frames of the slots' size, and nothing else."""
    size = slots.shape[1]
    for packet in range(packets):
        length = int(lengths[packet])
        if length == 0 or length % size or length > FRAMES_PER_PACKET * size:
            return False
    return True


@kernel
def move_up(slots: Slots, packet: int, frames: int, to: int) -> None:
    """Move the frames of a packet from their room to the slots from `to` on."""
    for frame in range(frames):
        place = packet * _ROOM + frame
        if place != to + frame:
            for byte in range(slots.shape[1]):
                slots[to + frame, byte] = slots[place, byte]


@kernel
def put_frame(stored: Doors, words: Whole, head: int, data: int) -> int:
    """Send a frame of classic CAN; return when [ns, monotonic], or minus the number of an error.

    `head` is its id, with its length above, and `data` are its bytes as they lie in memory.
    """
    door: Any = stored[0]
    now_ns = monotonic_ns(words[_CLOCK:], door.sending + _CLOCK * _WORD)
    words[_ID], words[_DATA], words[_STAMP] = head, data, now_ns
    failed = send_bytes(door.descriptor, door.sending, door.frame_bytes)
    return failed if failed < 0 else now_ns
