"""The socket of the link for kernels: the one packet of a tick is received and judged at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.record import record_type
from teleop_rt.link.codec import HEADER_BYTES
from teleop_rt.link.intake import SEQUENCE, is_expected, put_whole
from teleop_rt.link.noise import NONCE_BYTES, NONCE_NUMBER_AT
from teleop_rt.realtime.system_calls import receive_packets

if TYPE_CHECKING:
    from teleop_rt.realtime.packets import Packets

    Whole = NDArray[np.int64]

NOTHING, OTHER = 0, -1
"""In place of a length: nothing came, or something that is to be looked at step by step."""


class PacketDoorFields:
    """Fields of a socket: its descriptor and its packets' headers.

    `received` is how many packets the last call took, or minus the number of an error.
    """

    descriptor: int
    headers: int
    most: int
    received: int


_DOOR = record_type(PacketDoorFields)
_RECEIVED = list(PacketDoorFields.__annotations__).index("received")
Doors = NDArray[np.record]


class PacketDoor:
    """A socket that receives into `packets`, for kernels: `arrays`, and `door` by name.

    `clear` is the header of the packet received first, and `nonce` that of its number if it was
    expected. `newest` is the rest of that packet, if it has this `length`.
    """

    def __init__(self, packets: Packets, descriptor: int) -> None:
        stored: Doors = np.zeros(1, _DOOR)
        self.door = cast("PacketDoorFields", stored[0])
        self.door.descriptor, self.door.headers = descriptor, packets.headers
        self.door.most = packets.most
        self.clear = packets.memory[:HEADER_BYTES]
        self._memory, self.newest = packets.memory, packets.memory[HEADER_BYTES:]
        self.length = len(packets.memory)
        nonce = np.zeros(NONCE_BYTES, np.uint8)
        self.nonce = nonce.data
        memory = np.frombuffer(packets.memory, np.uint8)
        names = np.frombuffer(packets.senders, np.int64)
        self.arrays = stored, np.asarray(packets.lengths), memory, names, nonce
        self._words = stored.view(np.int64).data

    @property
    def received(self) -> int:
        """How many packets the last call took, or minus the number of an error."""
        return self._words[_RECEIVED]

    def sealed(self, length: int) -> memoryview:
        """Return the body of the first packet, which is of another length."""
        self.length, self.newest = length, self._memory[HEADER_BYTES:length]
        return self.newest


@kernel
def receive_expected(
    doors: Doors,
    lengths: NDArray[np.uint32],
    memory: NDArray[np.uint8],
    names: Whole,
    nonce: NDArray[np.uint8],
    link: Whole,
    window: Whole,
    sender: int,
    session: int,
    kinds: int,
) -> int:
    """Receive the waiting packets; return the length of a single one that is expected.

    That is one more of this session, of one of these kinds (bits), from this sender: the first
    word of its address. Whatever else came lies as it was received, and OTHER is returned; NOTHING,
    also for a socket that reports an error.
    """
    door: Any = doors[0]
    door.received = receive_packets(door.descriptor, door.headers, door.most)
    if door.received <= 0:
        return NOTHING
    if door.received != 1 or names[0] != sender:
        return OTHER
    length = int(lengths[0])
    if not is_expected(link, window, memory[:length], session, kinds):
        return OTHER
    put_whole(nonce, NONCE_NUMBER_AT, link[SEQUENCE])
    return length
