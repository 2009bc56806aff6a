"""SocketCAN as python-can has it, with its socket for kernels: they receive a cycle in one step."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING, Any

import can
from can.interfaces.socketcan import SocketcanBus

from teleop_rt_drivers.can_door import CanDoor
from teleop_rt_drivers.can_frames import BARE, REMOTE, UNREADABLE, CanFrame, one_by_one, unpacked

if TYPE_CHECKING:
    from collections.abc import Sequence

    from teleop_rt_drivers.can_frames import Outgoing

_pack = BARE.pack
_FLAGS = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL


class DirectSocketcanBus(SocketcanBus):
    """A bus of classic CAN; frames that kernels do not take come by python-can's own way.

    python-can takes 15 to 20 us a frame on this way, most of it for messages and their checks.
    """

    def __init__(self, channel: str, **options: Any) -> None:
        """Open the interface of this name. Raises OSError."""
        super().__init__(channel=channel, **options)
        self.door = CanDoor(BARE.size)
        self.door.door.descriptor = self.socket.fileno()
        self._kept: list[CanFrame] = []

    def is_plain(self) -> bool:
        """Return whether all that can come now comes by the door: unless something is kept."""
        return not self._kept

    def lend(self) -> bool:
        """Lend the door to kernels if nothing is kept; return whether it is lent."""
        return self.door.lend(all_comes=self.is_plain())

    def keep(self) -> None:
        """Keep the door's last packets, which were UNUSUAL, for `waiting_frames`."""
        packets, received = self.door.packets, self.door.door.received
        if received < 0:  # as when the interface goes down
            self._kept.append((UNREADABLE, b"", 0))
        for index in range(received):
            place = index * packets.size
            self._kept.append(unpacked(packets.memory, place, packets.lengths[index]))

    def waiting_frames(self, most: int) -> list[CanFrame]:
        """Return the frames that have come, `most` at most; never raises."""
        self.door.take_back()
        kept, self._kept = self._kept[:most], self._kept[most:]
        return kept + one_by_one(self, most - len(kept))

    def send_frame(self, can_id: int, data: bytes) -> None:
        """Send one frame without waiting. Raises CanOperationError."""
        size = 1 if can_id & REMOTE else len(data)
        try:
            self.socket.send(_pack(can_id, size, data), _FLAGS)
        except OSError as error:
            raise can.CanOperationError(f"cannot send: {error.strerror}", error.errno) from error

    def send_frames(self, frames: Sequence[Outgoing]) -> None:
        """Send frames one after the other, as `send_frame` does."""
        for can_id, data in frames:
            self.send_frame(can_id, data)

    def shutdown(self) -> None:
        """Leave the bus; the door is closed."""
        self.door.door.descriptor = -1
        super().shutdown()
