"""How packets travel: UDP datagrams, or a pair of queues in one process."""

from __future__ import annotations

import socket
import struct
from collections import deque
from typing import Protocol

import numpy as np

from teleop_rt.errors import FAULT, ExpectedError
from teleop_rt.realtime.packets import SENDER_BYTES, Packets

Address = tuple[str, int]

MAX_DATAGRAM = 2048
"""Bytes read of a datagram: above any packet of the link."""
RECEIVE_BUFFER = 1 << 20
"""Bytes asked of the kernel for datagrams that wait."""
_AT_ONCE = 16
"""Datagrams that are taken by one call of the system."""
_FAMILY = struct.Struct("=H")
_INTERNET = struct.Struct(">2xH4s8x")
"""Port and address in `struct sockaddr_in`."""
_NAME_WORDS = SENDER_BYTES // 8
"""Words of a sender's name, of which the first holds all that differs: the second is padding."""
MEMORY_QUEUE = 4096
"""Datagrams that wait in a transport of the same process; the oldest one is lost."""


class LinkError(ExpectedError):
    """The link cannot be opened as configured; the message gives cause, place and next step."""


class UnknownHostError(LinkError):
    """The peer's name is not known, or not yet: a service that ends by it is started again."""

    code = FAULT


class Transport(Protocol):
    """Carries datagrams to one peer without blocking; any of them may be lost."""

    @property
    def sender(self) -> Address | None:
        """Who sent the datagram received last; None where there can be only one.

        It is another object after each change.
        """

    def send(self, packet: bytes, to: Address | None = None) -> None:
        """Send a datagram to the peer, or to another address.

        Never raises and never blocks: a packet that cannot be sent is lost.
        """

    def receive(self) -> bytes | None:
        """Return the next datagram that has arrived, or None."""

    def confirm_sender(self) -> None:
        """Say that the datagram received last was verified: its sender is the peer."""

    def close(self) -> None:
        """Release the transport."""


def _resolved(peer: Address) -> Address:
    """Return the peer's address as a number. Raises UnknownHostError."""
    host, port = peer
    try:
        found = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError as error:
        raise UnknownHostError(
            f"cannot resolve {host!r}: {error.strerror}; correct link.host, or give the address of"
            " the other side as a number"
        ) from error
    return str(found[0][4][0]), port


class UdpTransport:
    """UDP datagrams over a non-blocking socket.

    Bound to loopback by default. The peer is given, or learnt from the sender of a verified
    packet: a peer that moves to another port is followed, a foreign one is not.

    While it `is_empty`, `receive` would look at the socket first: then a kernel may receive into
    `packets` from the `descriptor`, and `take_up` is called. `name` is the first word of the
    address of the last packet's sender. `peer_name` is the peer's `struct sockaddr_in`, all zeros
    while its address is no number.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        peer: Address | None = None,
        if_taken: str = "choose another port (0 takes a free one)",
    ) -> None:
        self.peer_name = np.zeros(SENDER_BYTES, np.uint8)
        self.peer = None if peer is None else _resolved(peer)
        self.unsent = 0
        self.sender: Address | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise LinkError(
                f"cannot bind UDP {host}:{port}: {error.strerror}; "
                f"{if_taken} or an address of this machine"
            ) from error
        self.packets = Packets(_AT_ONCE, MAX_DATAGRAM, named=True)
        self.descriptor = self._socket.fileno()
        self.name = 0
        self._count = self._next = 0
        self.is_empty = True
        self._names = self.packets.senders.cast("q")

    @property
    def peer(self) -> Address | None:
        """Where packets are sent to; None while nobody is known."""
        return self._peer

    @peer.setter
    def peer(self, address: Address | None) -> None:
        self._peer = address
        self.peer_name[:] = np.frombuffer(_name_of(address), np.uint8)

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def send(self, packet: bytes, to: Address | None = None) -> None:
        """Send a datagram to an address, or to the peer if one is known."""
        address = to or self._peer
        if address is None:
            return
        try:
            self._socket.sendto(packet, address)
        except OSError:
            self.unsent += 1

    def receive(self) -> bytes | None:
        """Return the next datagram, or None: all that wait are taken by one call of the system."""
        at = self._next
        if at == self._count:
            self.is_empty = True
            if 0 < at < _AT_ONCE:  # the last call had taken all
                self._count = self._next = 0
                return None
            at = self._next = 0
            try:
                self._count = self.packets.receive(self.descriptor)
            except OSError:
                self._count = 0
            if not self._count:
                return None
        self._next = at + 1
        self.is_empty = self._next == self._count == _AT_ONCE
        if self._names[at * _NAME_WORDS] != self.name:
            self._meet(at)
        return self._packet(at)

    @property
    def held(self) -> int:
        """How many datagrams `receive` returns before it asks the system."""
        return self._count - self._next

    def next_held(self) -> bytes:
        """Return the datagram that `receive` returns next, of those that are `held`."""
        return self._packet(self._next)

    def _packet(self, at: int) -> bytes:
        packets, place = self.packets, at * MAX_DATAGRAM
        return bytes(packets.memory[place : place + packets.lengths[at]])

    def take_up(self, count: int) -> None:
        """Let `receive` return the packets that a kernel received into `packets`."""
        self._count, self._next, self.is_empty = count, 0, False

    def _meet(self, at: int) -> None:
        """Read another sender's address than the last one's: family, port and host."""
        self.name = self._names[at * _NAME_WORDS]
        port, address = _INTERNET.unpack_from(self.packets.senders, at * SENDER_BYTES)
        self.sender = (socket.inet_ntoa(address), port)

    def confirm_sender(self) -> None:
        """Take the sender of the last datagram for the peer."""
        if self._peer is not self.sender:
            self.peer = self.sender

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _name_of(address: Address | None) -> bytes:
    """Return an address as a `struct sockaddr_in`, zeros where its host is no number."""
    try:
        host, port = address or ("", 0)
        return _FAMILY.pack(socket.AF_INET) + _INTERNET.pack(port, socket.inet_aton(host))[2:]
    except OSError:
        return bytes(SENDER_BYTES)


class MemoryTransport:
    """One end of a pair of bounded queues in one process; `pair()` makes both."""

    def __init__(self, outgoing: deque[bytes], incoming: deque[bytes]) -> None:
        self.sender: Address | None = None
        self._outgoing = outgoing
        self._incoming = incoming

    @classmethod
    def pair(cls) -> tuple[MemoryTransport, MemoryTransport]:
        """Return two ends; when a queue is full its oldest datagram is lost."""
        there: deque[bytes] = deque(maxlen=MEMORY_QUEUE)
        back: deque[bytes] = deque(maxlen=MEMORY_QUEUE)
        return cls(there, back), cls(back, there)

    def send(self, packet: bytes, to: Address | None = None) -> None:  # noqa: ARG002 - one peer
        """Queue a datagram for the other end."""
        self._outgoing.append(packet)

    def receive(self) -> bytes | None:
        """Return the next datagram, or None."""
        return self._incoming.popleft() if self._incoming else None

    def confirm_sender(self) -> None:
        """Do nothing: there is only one peer."""

    def close(self) -> None:
        """Do nothing: there is nothing to release."""
