"""Two ends of a link on a stepped clock, and a wire that can be tapped."""

from __future__ import annotations

from collections import deque

import numpy as np

from teleop_rt.link.channel import Endpoint
from teleop_rt.link.impairment import ImpairedTransport, Impairment
from teleop_rt.link.keys import PeerKeys, shared_key
from teleop_rt.link.messages import MotionMessage, StateMessage
from teleop_rt.link.transport import Address, MemoryTransport

KEY = bytes(range(32))
MS = 1_000_000
PERFECT = Impairment()


class Tap:
    """A memory transport that keeps sent packets, and takes those of an attacker."""

    def __init__(self, inner: MemoryTransport) -> None:
        self.inner = inner
        self.sent: list[bytes] = []
        self.injected: deque[bytes] = deque()

    @property
    def sender(self) -> Address | None:
        return self.inner.sender

    def send(self, packet: bytes, to: Address | None = None) -> None:
        self.sent.append(packet)
        self.inner.send(packet, to)

    def receive(self) -> bytes | None:
        return self.injected.popleft() if self.injected else self.inner.receive()

    def confirm_sender(self) -> None:
        self.inner.confirm_sender()

    def close(self) -> None:
        self.inner.close()


class Pair:
    """Master and slave ends; each `step()` is a millisecond in which both send and poll."""

    def __init__(
        self,
        *,
        there: Impairment = PERFECT,
        back: Impairment = PERFECT,
        seed: int = 0,
        slave_key: bytes = KEY,
        master_keys: PeerKeys | None = None,
        slave_keys: PeerKeys | None = None,
        slave_clock_ahead_ns: int = 0,
        master_rate_hz: int = 1000,
        slave_rates_hz: tuple[int, int] = (100, 4000),
    ) -> None:
        self.now = 10**12
        self.rng = np.random.default_rng(seed)
        near, far = MemoryTransport.pair()
        self.master_tap, self.slave_tap = Tap(near), Tap(far)
        self._slave_keys = slave_keys or shared_key(slave_key)
        self._slave_rates_hz = slave_rates_hz
        self._slave_now = lambda: self.now + slave_clock_ahead_ns
        self._to_master = ImpairedTransport(self.slave_tap, back, lambda: self.now, self.rng)
        self.master = Endpoint(
            "master",
            ImpairedTransport(self.master_tap, there, lambda: self.now, self.rng),
            shared_key(KEY) if master_keys is None else master_keys,
            lambda: self.now,
            rate_hz=master_rate_hz,
        )
        self.restart_slave()
        self.sent = 0

    def restart_slave(self, keys: PeerKeys | None = None) -> None:
        """Begin again as after a reload, which reads the list of keys again."""
        self.slave = Endpoint(
            "slave",
            self._to_master,
            self._slave_keys if keys is None else keys,
            self._slave_now,
            rate_hz=1000,
            accepted_rates_hz=self._slave_rates_hz,
        )

    def step(self) -> None:
        self.now += MS
        self.sent += 1
        self.slave.poll()
        self.slave.send(StateMessage(float(self.sent), 0.0, 0, in_contact=False))
        self.master.poll()
        self.master.send(MotionMessage(float(self.sent), 0.0, 0, engaged=True))

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.step()
