"""A bad network on purpose: delay, jitter, loss, duplication, reordering and blackouts."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teleop_rt.config.link import LinkConfig
from teleop_rt.link.transport import Address, Transport

NS_PER_MS = 1_000_000
NS_PER_S = 1_000_000_000
QUEUE_LIMIT = 65536
"""Packets under way at most: 16 s at 4 kHz."""


@dataclass(frozen=True, slots=True)
class Impairment:
    """Impairment of packets in one direction of the network.

    One-way delay is `delay_ns` plus a uniform jitter of ± `jitter_ns`, never below 0.
    `reorder` is the share of packets held back by another `reorder_ns`. With `burst` above 1
    losses come in bursts of that mean length (Gilbert 1960) at the same mean `loss`. Packets
    sent inside a blackout [start, end), counted from when the transport was made, are lost.
    """

    delay_ns: int = 0
    jitter_ns: int = 0
    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    reorder_ns: int = 5 * NS_PER_MS
    burst: float = 1.0
    blackouts_ns: tuple[tuple[int, int], ...] = ()

    @classmethod
    def one_way(cls, link: LinkConfig) -> Impairment:
        """Return half of a trial's impairment: each direction takes one half."""
        return cls(
            delay_ns=round(link.round_trip_ms * NS_PER_MS / 2),
            jitter_ns=round(link.jitter_ms * NS_PER_MS / 2),
            loss=link.loss,
            duplicate=link.duplicate,
            reorder=link.reorder,
            burst=link.loss_burst,
            blackouts_ns=tuple(
                (round(start_s * NS_PER_S), round(end_s * NS_PER_S))
                for start_s, end_s in link.blackouts_s
            ),
        )


class ImpairedTransport:
    """Delays, loses, duplicates and reorders the packets sent over another transport.

    Packets wait in a queue bounded to QUEUE_LIMIT, ordered by delivery time, and go on when
    either end of this transport is used at or after that time. Deterministic for a seed.
    """

    def __init__(
        self,
        inner: Transport,
        impairment: Impairment,
        now_ns: Callable[[], int],
        rng: np.random.Generator,
    ) -> None:
        self._inner = inner
        self.impairment = impairment
        self._now_ns = now_ns
        self._start_ns = now_ns()
        self._rng = rng
        self._queue: list[tuple[int, int, bytes, Address | None]] = []
        self._count = 0
        self._in_burst = False
        self.lost = 0
        self.duplicated = 0
        self.overflowed = 0

    @property
    def sender(self) -> Address | None:
        """Who sent the packet received last."""
        return self._inner.sender

    def send(self, packet: bytes, to: Address | None = None) -> None:
        """Take a packet into the network: it is delivered later, twice, or never."""
        now_ns = self._now_ns()
        if self._is_lost(now_ns):
            self.lost += 1
        else:
            self._enqueue(now_ns, packet, to)
            if self._happens(self.impairment.duplicate):
                self.duplicated += 1
                self._enqueue(now_ns, packet, to)
        self._deliver(now_ns)

    def receive(self) -> bytes | None:
        """Return the next packet that has arrived, or None; also lets packets go that are due."""
        if self._queue and self._queue[0][0] <= (now_ns := self._now_ns()):
            self._deliver(now_ns)
        return self._inner.receive()

    def confirm_sender(self) -> None:
        """Pass on that the last packet was verified."""
        self._inner.confirm_sender()

    def close(self) -> None:
        """Forget the packets under way and close the inner transport."""
        self._queue.clear()
        self._inner.close()

    def _happens(self, probability: float) -> bool:
        return probability > 0 and self._rng.random() < probability

    def _is_lost(self, now_ns: int) -> bool:
        impairment = self.impairment
        elapsed_ns = now_ns - self._start_ns
        if any(start <= elapsed_ns < end for start, end in impairment.blackouts_ns):
            return True
        if impairment.burst <= 1:
            return self._happens(impairment.loss)
        leave = 1 / impairment.burst
        enter = leave * impairment.loss / (1 - impairment.loss)
        self._in_burst = not self._happens(leave) if self._in_burst else self._happens(enter)
        return self._in_burst

    def _enqueue(self, now_ns: int, packet: bytes, to: Address | None) -> None:
        if len(self._queue) >= QUEUE_LIMIT:
            self.overflowed += 1
            return
        impairment = self.impairment
        delay_ns = impairment.delay_ns
        if impairment.jitter_ns:
            # As `uniform` draws it, which takes three times as long.
            jitter_ns = impairment.jitter_ns
            delay_ns += int(-jitter_ns + 2 * jitter_ns * self._rng.random())
        if self._happens(impairment.reorder):
            delay_ns += impairment.reorder_ns
        self._count += 1
        heapq.heappush(self._queue, (now_ns + max(0, delay_ns), self._count, packet, to))

    def _deliver(self, now_ns: int) -> None:
        while self._queue and self._queue[0][0] <= now_ns:
            _, _, packet, to = heapq.heappop(self._queue)
            self._inner.send(packet, to)
