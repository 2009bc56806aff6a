"""How packets travel: UDP datagrams, or a pair of queues in one process."""

from __future__ import annotations

import select
import socket
from collections import deque
from typing import Protocol

from teleop_rt.errors import ExpectedError

Address = tuple[str, int]

MAX_DATAGRAM = 2048
RECEIVE_BUFFER = 1 << 20
MEMORY_QUEUE = 4096


class LinkError(ExpectedError):
    """The link cannot be opened as configured: says what, where and what to do next."""


class Transport(Protocol):
    """Carries datagrams to one peer without blocking; any of them may be lost."""

    @property
    def sender(self) -> Address | None:
        """Who sent the datagram received last; None where there can be only one."""

    def send(self, packet: bytes, to: Address | None = None) -> None:
        """Send a datagram to the peer, or to another address.

        Never raises and never blocks: what cannot be sent is lost.
        """

    def receive(self) -> bytes | None:
        """Return the next datagram that has arrived, or None."""

    def confirm_sender(self) -> None:
        """Say that the datagram received last was verified: its sender is the peer."""

    def close(self) -> None:
        """Release the transport."""


class UdpTransport:
    """UDP datagrams over a non-blocking socket.

    Bound to loopback by default. The peer is given, or learnt from the sender of a verified
    packet: a peer that moves to another port is followed, a foreign one is not.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0, peer: Address | None = None) -> None:
        self.peer = peer
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
                "choose another port (0 takes a free one) or an address of this machine"
            ) from error
        self._arrivals = select.poll()
        self._arrivals.register(self._socket, select.POLLIN)

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def send(self, packet: bytes, to: Address | None = None) -> None:
        """Send a datagram to an address, or to the peer if one is known."""
        address = to or self.peer
        if address is None:
            return
        try:
            self._socket.sendto(packet, address)
        except OSError:
            self.unsent += 1

    def receive(self) -> bytes | None:
        """Return the next datagram, or None.

        Asking first is a quarter of the cost of the exception of a socket that has nothing.
        """
        if not self._arrivals.poll(0):
            return None
        try:
            packet, self.sender = self._socket.recvfrom(MAX_DATAGRAM)
        except OSError:
            return None
        return packet

    def confirm_sender(self) -> None:
        """Take the sender of the last datagram for the peer."""
        self.peer = self.sender

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


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
