"""A stranger who heard a session, and asks for sessions of its own from ports of its own.

It knows datagrams alone and imports nothing of the link: it replays, cuts and forges handshakes,
writes counters at the ends of their range, and sends empty and oversize datagrams. It counts
the bytes of both ways, for a slave that answers with more than it was sent is a weapon.
"""

from __future__ import annotations

import contextlib
import random
import socket
from collections.abc import Sequence

LOOPBACK = "127.0.0.1"
PORTS = 8  # from which it sends: limits per sender are tried as well
LONGEST = 65507  # bytes of a datagram of UDP over IPv4
COUNTER = slice(12, 20)
"""Where a sniffer sees a number that grows by one from packet to packet."""
COOKIE_BYTES = 16  # of the link, with which it shares no code
EDGES = [n.to_bytes(8, "little") for n in (0, 1, 2**31, 2**63 - 1, 2**63, 2**64 - 1000, 2**64 - 1)]
# None, one, about a header and its tag, a packet of Ethernet, about the buffer, and longer.
SIZES = (0, 1, 43, 44, 1400, 2047, 2048, 2049, 9000, LONGEST)


class Stranger:
    """Attacks one port from several of its own."""

    def __init__(self, port: int, seed: int) -> None:
        self._target = (LOOPBACK, port)
        self._rng = random.Random(seed)
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(PORTS)]
        for one in self._sockets:
            one.bind((LOOPBACK, 0))
            one.settimeout(0.0)
        self.sent = 0
        self.bytes_out = [0] * PORTS
        self.bytes_back = [0] * PORTS
        self.answers: list[bytes] = []

    def attack(self, heard: Sequence[bytes], count: int) -> None:
        """Send so many packets, made of packets heard and of answers."""
        forgeries = (
            self._again, self._first, self._cookie, self._flipped, self._cut, self._counter,
            self._odd, self._answered,
        )  # fmt: skip
        for _ in range(count):
            packet = self._rng.choice(forgeries)(heard)
            number = self._rng.randrange(PORTS)
            with contextlib.suppress(OSError):  # a full buffer
                self._sockets[number].sendto(packet, self._target)
                self.sent += 1
                self.bytes_out[number] += len(packet)
        self._listen()

    def close(self) -> None:
        """Close its ports."""
        for one in self._sockets:
            one.close()

    def _listen(self) -> None:
        for number, one in enumerate(self._sockets):
            with contextlib.suppress(BlockingIOError):
                while True:
                    answer = one.recv(LONGEST)
                    self.bytes_back[number] += len(answer)
                    self.answers.append(answer)

    def _again(self, heard: Sequence[bytes]) -> bytes:
        return self._rng.choice(heard)

    def _first(self, heard: Sequence[bytes]) -> bytes:
        """The packet that opened the session: a sniffer knows it by its place."""
        return heard[0]

    def _cookie(self, heard: Sequence[bytes]) -> bytes:
        """The same with a cookie of its own making at its end."""
        return heard[0][:-COOKIE_BYTES] + self._rng.randbytes(COOKIE_BYTES)

    def _flipped(self, heard: Sequence[bytes]) -> bytes:
        changed = bytearray(heard[0])
        changed[self._rng.randrange(len(changed))] ^= 1 << self._rng.randrange(8)
        return bytes(changed)

    def _cut(self, heard: Sequence[bytes]) -> bytes:
        return heard[0][: self._rng.randrange(len(heard[0]))] + self._rng.randbytes(
            self._rng.choice((0, 1, 16))
        )

    def _counter(self, heard: Sequence[bytes]) -> bytes:
        changed = bytearray(self._rng.choice(heard))
        changed[COUNTER] = self._rng.choice(EDGES)
        return bytes(changed)

    def _odd(self, _heard: Sequence[bytes]) -> bytes:
        return self._rng.randbytes(self._rng.choice(SIZES))

    def _answered(self, heard: Sequence[bytes]) -> bytes:
        """Reflect an answer."""
        return self._rng.choice(self.answers or heard)
