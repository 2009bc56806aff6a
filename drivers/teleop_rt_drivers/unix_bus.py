"""A CAN bus between processes of one machine, over unix sockets: no network, half of its cost.

A bus is a folder. Each program on it listens at a socket there and is connected with each other
one, so a program comes and goes, however it ends, without the others; who has just come is met by
those that hear others already when they next find nothing to receive. A frame is SocketCAN's
`struct can_frame` (16 bytes) or `struct canfd_frame` (72), followed by the nanosecond of
CLOCK_MONOTONIC at which it was sent; a packet holds one of them, or up to seven of the first.
python-can knows it as the interface `unix`, by an entry point.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import secrets
import select
import socket
import time
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import can

from teleop_rt_drivers.bus_folder import SUFFIX, entered, folder_of, names_in, sweep_buses
from teleop_rt_drivers.can_door import FRAMES_PER_PACKET, LOOK_EVERY, CanDoor
from teleop_rt_drivers.can_frames import (
    FRAME,
    REMOTE,
    CanFrame,
    Outgoing,
    message_of,
    one_by_one,
    packed,
    unpacked,
    unpacked_plainly,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

_pack = FRAME.pack
_BUFFER_BYTES = 4 << 20
"""Send buffer of a socket: frames wait there while the other program stalls."""
_GONE = (errno.ECONNREFUSED, errno.ENOENT)


class UnixBus(can.BusABC):
    """One program's end of a bus of this machine.

    `lost` counts frames that another program's full queue did not take: as on a wire, who does
    not listen misses frames, and nobody waits for it.
    """

    def __init__(self, channel: str = "can", **options: Any) -> None:
        """Join the bus, which begins with its first program. Raises OSError."""
        self._place = folder_of(str(channel))
        self._peers: list[socket.socket] = []
        self._heads: dict[socket.socket, tuple[int, can.Message]] = {}
        # The first is readable while frames wait, too: a search by it takes 40 us.
        self._ready, self._comers = select.epoll(), select.epoll()
        self._rests: dict[socket.socket, list[bytes]] = {}
        self.door = CanDoor(FRAME.size)
        self._packets = self.door.packets
        self._kept: list[CanFrame] = []
        self._readings = 0
        self._name = f"{os.getpid()}-{secrets.token_hex(4)}{SUFFIX}"
        self.lost = 0
        self.channel_info = f"unix {channel}"
        self._listening = _seqpacket()
        self.door.look_after(self._listening.fileno())
        options.pop("bitrate", None)  # there is none here
        super().__init__(channel=channel, **options)
        if "/" not in str(channel):
            sweep_buses()
        self._folder = entered(self._place)
        try:
            self._join()
        except OSError:
            self.shutdown()
            raise

    def _join(self) -> None:
        """Listen, and connect with whoever is there: one program at a time, so that each is met."""
        try:
            others = names_in(self._folder)
            self._listening.bind(self._path(self._name))
            self._listening.listen(64)
            for one in (self._ready, self._comers):
                one.register(self._listening, select.EPOLLIN)
            for name in others:
                self._connect(name)
        finally:
            fcntl.flock(self._folder, fcntl.LOCK_UN)

    def _connect(self, name: str) -> None:
        """Connect with a program; the socket that one left which was killed is removed."""
        peer = _seqpacket()
        try:
            peer.connect(self._path(name))
        except OSError as error:
            peer.close()
            if error.errno not in _GONE:
                raise
            with contextlib.suppress(OSError):
                os.unlink(name, dir_fd=self._folder)
        else:
            self._add(peer)

    def _path(self, name: str) -> str:
        """Return a path that fits into the kernel's 108 bytes, however long the folder's is."""
        return f"/proc/self/fd/{self._folder}/{name}"

    def _add(self, peer: socket.socket) -> None:
        peer.settimeout(0.0)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
        self._ready.register(peer, select.EPOLLIN)
        self._peers.append(peer)
        self._set_door()

    def _drop(self, peer: socket.socket) -> None:
        """Forget a program that has left."""
        self._ready.unregister(peer)
        self._peers.remove(peer)
        peer.close()
        self._set_door()

    def _set_door(self) -> None:
        """Let the door be the only peer's."""
        only = self._peers[0].fileno() if len(self._peers) == 1 else -1
        self.door.door.descriptor = only
        self.door.take_back()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame to every program on the bus, without waiting for any.

        Raises CanOperationError for a frame that is longer than its kind can be.
        """
        del timeout
        if not self._peers:
            self._meet()
        self._send_packet(packed(msg, time.monotonic_ns()))

    def _send_packet(self, data: bytes, frames: int = 1) -> None:
        for peer in self._peers:
            try:
                peer.send(data)
            except BlockingIOError:
                self.lost += frames
            except OSError:  # it has left; its frames from before are still to be heard
                continue

    def send_frame(self, can_id: int, data: bytes) -> None:
        """Send one frame of classic CAN; nothing is waited for, as in `send`."""
        if not self._peers:
            self._meet()
        self._send_packet(_packed(can_id, data, time.monotonic_ns()))

    def send_frames(self, frames: Sequence[Outgoing]) -> None:
        """Send frames of classic CAN, as many as fit in a packet: for those who receive, too.

        Nothing is waited for, as in `send`.
        """
        if not self._peers:
            self._meet()
        now_ns = time.monotonic_ns()
        for first in range(0, len(frames), FRAMES_PER_PACKET):
            some = frames[first : first + FRAMES_PER_PACKET]
            packet = b"".join(_packed(can_id, data, now_ns) for can_id, data in some)
            self._send_packet(packet, len(some))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame that passes the filters, None where none comes in time.

        Raises CanOperationError for anything but a frame.
        """
        self.door.take_back()
        ends = time.monotonic() + timeout if timeout else None
        while True:
            message = self._next()
            if message is None:
                left = timeout if ends is None else max(0.0, ends - time.monotonic())
                if not self._ready.poll(left) and timeout is not None:
                    return None
                self._meet()
            elif self._filters is None or self._matches_filters(message):
                return message

    def _next(self) -> can.Message | None:
        """Return the frame that was sent first of those that have come, or None."""
        if len(self._peers) == 1 and not self._heads:
            taken = self._take(self._peers[0])
            return None if taken is None else taken[1]
        for peer in tuple(self._peers):
            if peer not in self._heads and (taken := self._take(peer)) is not None:
                self._heads[peer] = taken
        if not self._heads:
            return None
        return self._heads.pop(min(self._heads, key=lambda peer: self._heads[peer][0]))[1]

    def _take(self, peer: socket.socket) -> tuple[int, can.Message] | None:
        """Return when a program's next frame was sent [ns] and the frame, or None.

        It is forgotten once it has left. The other frames of its packet wait for the next call.
        """
        if (rest := self._rests.pop(peer, None)) is not None:
            if len(rest) > 1:
                self._rests[peer] = rest[1:]
            return message_of(rest[0])
        try:
            data = peer.recv(self._packets.size)
        except BlockingIOError:
            return None
        except OSError:
            data = b""
        if len(data) > FRAME.size and _holds_frames(len(data)):
            places = range(0, len(data), FRAME.size)
            first, *self._rests[peer] = (data[at : at + FRAME.size] for at in places)
            return message_of(first)
        if data:
            return message_of(data)
        self._drop(peer)
        return None

    def waiting_frames(self, most: int) -> list[CanFrame]:
        """Return the frames received, in the order of sending, `most` at most; never raises.

        Data that are not a frame are returned as UNREADABLE.
        """
        self.door.take_back()
        self._look_for_programs()
        if self._filters is not None or self._heads or self._rests:
            return one_by_one(self, most)
        frames, self._kept = self._kept, []
        waiting = self._peers
        while waiting:
            waiting = [peer for peer in tuple(waiting) if self._take_some(peer, frames, most)]
        if len(self._peers) > 1:
            frames.sort(key=itemgetter(2))
        return frames

    def is_plain(self) -> bool:
        """Return whether all that can come now comes by the door; new programs are let in here.

        That is so while one program is there and nothing is kept of it.
        """
        self._readings += 1
        if self._readings % LOOK_EVERY == 0:
            self._let_in()
        return self._is_plain()

    def _is_plain(self) -> bool:
        """Return whether one program is there, and nothing is kept of it or to be kept out."""
        held = self._kept or self._heads or self._rests
        return len(self._peers) == 1 and not held and self._filters is None

    def lend(self) -> bool:
        """Let new programs in, and lend the door to kernels if all comes by it: see `is_plain`."""
        self._let_in()
        return self.door.lend(all_comes=self._is_plain())

    def set_filters(self, filters: can.typechecking.CanFilters | None = None) -> None:
        """Let only frames through that pass a filter."""
        self.door.take_back()
        super().set_filters(filters)

    def keep(self) -> None:
        """Keep the door's last packet, which was UNUSUAL, for `waiting_frames`."""
        peer, received = self._peers[0], self.door.door.received
        if received < 0:
            self._drop(peer)
        else:
            self._unpack(peer, received, self._kept)

    def _look_for_programs(self) -> None:
        """Let in who has come, once in a while, and while nobody is there."""
        self._readings += 1
        if self._readings % LOOK_EVERY == 0 or not self._peers:
            self._let_in()

    def _let_in(self) -> None:
        """Let programs in, if any have come: nobody has to a bus that was left."""
        if not self._comers.closed and self._comers.poll(0):
            self._meet()

    def _take_some(self, peer: socket.socket, frames: list[CanFrame], most: int) -> bool:
        """Add a program's waiting frames; return whether more may wait and there is room."""
        packets = min(self._packets.most, (most - len(frames)) // FRAMES_PER_PACKET)
        if packets <= 0:
            return False
        try:
            count = self._packets.receive(peer.fileno(), packets)
        except OSError:
            self._drop(peer)
            return False
        return self._unpack(peer, count, frames) and count == packets

    def _unpack(self, peer: socket.socket, count: int, frames: list[CanFrame]) -> bool:
        """Add the frames received from a program; return whether it is still there.

        A program is forgotten once it has left.
        """
        packets, lengths = self._packets, self._packets.lengths
        for index in range(count):
            place, length = index * packets.size, lengths[index]
            if not length:
                self._drop(peer)
                return False
            if _holds_frames(length):  # nearly always
                frames += unpacked_plainly(packets.memory[place : place + length])
            else:
                frames.append(unpacked(packets.memory, place, length))
        return True

    def _meet(self) -> None:
        """Let programs in that have come since."""
        while True:
            try:
                peer, _ = self._listening.accept()
            except OSError:
                return
            self._add(peer)

    def fileno(self) -> int:
        """Return a descriptor that is readable while something waits."""
        return self._ready.fileno()

    def shutdown(self) -> None:
        """Leave the bus; the last one removes it."""
        super().shutdown()
        if self._ready.closed:
            return
        for one in (self._listening, *self._peers):
            one.close()
        self._peers.clear()
        self._set_door()
        self._ready.close()
        self._comers.close()
        fcntl.flock(self._folder, fcntl.LOCK_EX)  # or one that is just joining would lose its place
        with contextlib.suppress(OSError):
            os.unlink(self._name, dir_fd=self._folder)
        with contextlib.suppress(OSError):
            self._place.rmdir()
        os.close(self._folder)


def _packed(can_id: int, data: bytes, now_ns: int) -> bytes:
    return _pack(can_id, 1 if can_id & REMOTE else len(data), data, now_ns)


def _holds_frames(length: int) -> bool:
    """Return whether a packet of this length holds frames of classic CAN with their stamps."""
    return length % FRAME.size == 0 and 0 < length <= FRAMES_PER_PACKET * FRAME.size


def _seqpacket() -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    made.settimeout(0.0)
    return made
