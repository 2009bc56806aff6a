"""An attacker in the middle of the link: knows datagrams and nothing of their contents.

It is written from docs/security.md and from packets on loopback alone, and imports nothing of
the link.
"""

from __future__ import annotations

import contextlib
import random
import socket
from dataclasses import dataclass, field

LOOPBACK = "127.0.0.1"
LONGEST = 2048  # of a packet that is read: beyond any Ethernet frame


@dataclass(slots=True)
class Way:
    """One direction: packets seen, packets withheld, the count of genuine ones let through."""

    seen: list[bytes] = field(default_factory=list)
    withheld: list[bytes] = field(default_factory=list)
    passed: int = 0
    open: bool = True


class WireAttacker:
    """Stands between master and slave; `front` is the end that the master takes for the slave."""

    def __init__(self, slave_port: int, seed: int, front_port: int = 0) -> None:
        self.rng = random.Random(seed)
        self._slave = (LOOPBACK, slave_port)
        self._master: tuple[str, int] | None = None
        self.front, self._back, self._foreign = (_socket(port) for port in (front_port, 0, 0))
        self.to_slave, self.to_master = Way(), Way()
        self.sent = 0

    @property
    def port(self) -> int:
        """The port that the master is to send to."""
        return int(self.front.getsockname()[1])

    def pump(self) -> None:
        """Take in all packets, and let through those that are not withheld."""
        for source, way in ((self.front, self.to_slave), (self._back, self.to_master)):
            while (packet := self._receive(source)) is not None:
                way.seen.append(packet)
                if way.open:
                    self._pass(way, packet)
                else:
                    way.withheld.append(packet)

    def let_go(self) -> bool:
        """Let one withheld packet of the master through; false where none is left."""
        if not self.to_slave.withheld:
            return False
        self._pass(self.to_slave, self.to_slave.withheld.pop(0))
        return True

    def attack(self, count: int) -> None:
        """Send so many packets of its own to either end."""
        for _ in range(count):
            genuine = self.rng.choice(self.rng.choice((self.to_slave, self.to_master)).seen)
            packet = self.rng.choice((self._as_it_was, self._flipped, self._cut, self._mixed))(
                genuine
            )
            target = self._slave if self._master is None or self.rng.random() < 0.7 else None
            if target is None:
                _send(self.rng.choice((self.front, self._foreign)), packet, self._master)
            else:
                _send(self.rng.choice((self._back, self._foreign)), packet, target)
            self.sent += 1

    def close(self) -> None:
        """Close the sockets."""
        for one in (self.front, self._back, self._foreign):
            one.close()

    def _as_it_was(self, packet: bytes) -> bytes:
        """Repeat, or reflect, for the end that it goes to is drawn by itself."""
        return packet

    def _flipped(self, packet: bytes) -> bytes:
        changed = bytearray(packet)
        changed[self.rng.randrange(len(changed))] ^= 1 << self.rng.randrange(8)
        return bytes(changed)

    def _cut(self, packet: bytes) -> bytes:
        return packet[: self.rng.randrange(len(packet))]

    def _mixed(self, packet: bytes) -> bytes:
        """The beginning of one packet with the end of another."""
        other = self.rng.choice(self.to_slave.seen)
        at = self.rng.randrange(len(packet))
        return packet[:at] + other[at:]

    def _receive(self, source: socket.socket) -> bytes | None:
        try:
            packet, sender = source.recvfrom(LONGEST)
        except OSError:
            return None
        if source is self.front:
            self._master = sender
        return packet

    def _pass(self, way: Way, packet: bytes) -> None:
        way.passed += 1
        if way is self.to_slave:
            _send(self._back, packet, self._slave)
        elif self._master is not None:
            _send(self.front, packet, self._master)


def _socket(port: int) -> socket.socket:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind((LOOPBACK, port))
    one.settimeout(0.0)
    return one


def _send(source: socket.socket, packet: bytes, target: tuple[str, int] | None) -> None:
    with contextlib.suppress(OSError):  # an end that has closed, or a full buffer
        source.sendto(packet, target or (LOOPBACK, 9))
