"""Several packets by one call of the system, from or into memory that is used again.

A call for each packet, and one more that finds nothing, cost a loop several times as much.
"""

from __future__ import annotations

import ctypes
import errno
import socket

SENDER_BYTES = 16
"""`struct sockaddr_in`."""
_NOTHING = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR)


class _Vector(ctypes.Structure):
    """`struct iovec`: where a packet goes."""

    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class _Header(ctypes.Structure):
    """`struct msghdr` without ancillary data."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_length", ctypes.c_uint32),
        ("vectors", ctypes.c_void_p),
        ("vector_count", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_length", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class _Packet(ctypes.Structure):
    """`struct mmsghdr`."""

    _fields_ = (("header", _Header), ("length", ctypes.c_uint32))


# It never waits, so nobody else has to be let in meanwhile: PyDLL keeps the interpreter's lock.
_receive = ctypes.PyDLL(None, use_errno=True).recvmmsg
_send = ctypes.PyDLL(None, use_errno=True).sendmmsg
# Without argument types, which cost as much as the call: those that are no int are made beforehand.
_FLAGS, _SEND_FLAGS = socket.MSG_DONTWAIT, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL


class Packets:
    """Room for `most` packets of `size` bytes each.

    `memory` holds the packets of the last call at multiples of `size`, `lengths` how long each is,
    and `senders` at multiples of SENDER_BYTES where each of UDP came from. `headers` is the address
    of their `struct mmsghdr`s, for kernels.
    """

    def __init__(self, most: int, size: int, *, named: bool = False) -> None:
        """Make room; `named` where the packets' senders are of interest, as on UDP."""
        self.most, self.size = most, size
        buffer = (ctypes.c_char * (most * size))()
        place = ctypes.addressof(buffer)
        self._vectors = (_Vector * most)(*(_Vector(place + i * size, size) for i in range(most)))
        self._packets = (_Packet * most)()
        first = ctypes.addressof(self._vectors)
        names = (ctypes.c_char * (most * SENDER_BYTES))()
        self.senders = memoryview(names).cast("B")
        for i, packet in enumerate(self._packets):
            if named:
                packet.header.name = ctypes.addressof(names) + i * SENDER_BYTES
                packet.header.name_length = SENDER_BYTES
            packet.header.vectors = first + i * ctypes.sizeof(_Vector)
            packet.header.vector_count = 1
        self.headers = ctypes.addressof(self._packets)
        self._place = ctypes.c_void_p(self.headers)
        self.memory = memoryview(buffer).cast("B")
        words = memoryview(self._packets).cast("B").cast("I")
        word = words.itemsize
        offset, step = _Packet.length.offset, ctypes.sizeof(_Packet)
        self.lengths = words[offset // word :: step // word]

    def receive(self, descriptor: int, most: int | None = None) -> int:
        """Receive the packets waiting at a socket without blocking, and return their number.

        That is `most` packets at most, or as many as there is room for. A packet of length 0 at
        the end means that the other end has left. Raises OSError if the socket is broken.
        """
        count: int = _receive(descriptor, self._place, most or self.most, _FLAGS, None)
        if count < 0:
            code = ctypes.get_errno()
            if code not in _NOTHING:
                raise OSError(code, errno.errorcode.get(code, "unknown"))
            return 0
        return count

    def send(self, descriptor: int, count: int) -> int:
        """Send the first packets of `memory`, whole, without waiting; return how many were taken.

        Raises OSError if the socket is broken.
        """
        taken: int = _send(descriptor, self._place, count, _SEND_FLAGS)
        if taken < 0:
            code = ctypes.get_errno()
            if code not in _NOTHING:
                raise OSError(code, errno.errorcode.get(code, "unknown"))
            return 0
        return taken
