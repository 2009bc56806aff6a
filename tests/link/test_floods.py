"""Floods by senders without a key: their cost for a tick, and the peers that they keep out."""

from __future__ import annotations

import os
from collections import deque

import numpy as np
import pytest

from teleop_rt.link import handshake
from teleop_rt.link.channel import PACKETS_PER_POLL
from teleop_rt.link.handshake import HASHES_PER_POLL, Caller
from teleop_rt.link.keys import MOST_KEYS, PeerKey, shared_key
from teleop_rt.link.transport import Address, MemoryTransport
from teleop_rt_dev.link.pair import KEY, Pair

MASTER: Address = ("192.0.2.1", 40_000)
STRANGER = "192.0.2.9"


class ManyPorts:
    """The slave's transport: the master's packets, and a stranger's from as many ports as it has.

    They arrive in any order, and the stranger gets no answer.
    """

    def __init__(self, inner: MemoryTransport, ports: int) -> None:
        self.sender: Address | None = None
        self._inner = inner
        self._ports = ports
        self._rng = np.random.default_rng(5)
        self._arrived: deque[tuple[Address, bytes]] = deque()

    def arrive(self, strangers: list[bytes]) -> None:
        packets = [((STRANGER, int(self._rng.integers(self._ports))), one) for one in strangers]
        while (genuine := self._inner.receive()) is not None:
            packets.append((MASTER, genuine))
        self._arrived.extend(packets[place] for place in self._rng.permutation(len(packets)))

    def receive(self) -> bytes | None:
        if not self._arrived:
            return None
        self.sender, packet = self._arrived.popleft()
        return packet

    def send(self, packet: bytes, to: Address | None = None) -> None:
        if to is None or to == MASTER:
            self._inner.send(packet)

    def confirm_sender(self) -> None:
        assert self.sender == MASTER

    def close(self) -> None:
        self._inner.close()


def test_a_flood_costs_a_poll_a_bounded_number_of_hashes_however_many_keys_are_listed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    operators = tuple(PeerKey(f"operator{n}", os.urandom(32)) for n in range(MOST_KEYS - 1))
    pair = Pair(slave_keys=(*operators, *shared_key(KEY)))
    pair.run(100)
    hashed = []
    genuine = handshake._mac
    monkeypatch.setattr(handshake, "_mac", lambda *given: hashed.append(1) or genuine(*given))
    stranger = Caller(PeerKey("?", os.urandom(32))).hello(1000, 0, pair.now)
    del hashed[:]
    pair.slave_tap.injected.extend([stranger] * (PACKETS_PER_POLL - 1))
    pair.slave.poll()
    assert MOST_KEYS <= len(hashed) <= HASHES_PER_POLL
    assert not pair.slave_tap.injected, "none is left for the tick after"
    assert pair.slave.statistics.rejected["handshake rate"] > 100
    pair.run(2)
    assert pair.slave.motion.target == pair.sent - 1, "who leads is not held up"


def test_a_host_that_asks_from_a_thousand_ports_keeps_no_other_out() -> None:
    pair = Pair()
    near, far = MemoryTransport.pair()
    wire = ManyPorts(far, ports=1000)
    pair.slave.transport, pair.master.transport = wire, near
    pair.run(5)
    hello = Caller(shared_key(KEY)[0]).hello(1000, 0, pair.now)  # heard once, and replayed
    for _ in range(300):
        wire.arrive([hello] * 50)
        pair.step()
    assert pair.slave.statistics.rejected["handshake rate"] > 1000
    pair.master.sessions.current = None  # as a master that was started again
    pair.master._caller = Caller(shared_key(KEY)[0])
    first = pair.slave.session_id
    for _ in range(1000):
        wire.arrive([hello] * 50)
        pair.step()
    assert pair.slave.session_id == pair.master.session_id != first
    assert pair.slave.fresh_motion
