from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.config.link import LinkConfig
from teleop_rt.link.impairment import ImpairedTransport, Impairment
from teleop_rt.link.transport import MemoryTransport

MS = 1_000_000


class Line:
    """Sends one numbered packet a millisecond and notes when each arrives."""

    def __init__(self, impairment: Impairment, seed: int = 1) -> None:
        self.now = 10**12
        near, self.far = MemoryTransport.pair()
        rng = np.random.default_rng(seed)
        self.near = ImpairedTransport(near, impairment, lambda: self.now, rng)
        self.arrivals: list[tuple[int, int]] = []

    def run(self, packets: int, drain_ms: int = 500) -> np.ndarray:
        """Return columns number, delay [ns] in order of arrival."""
        for number in range(packets + drain_ms):
            self.now = 10**12 + number * MS
            if number < packets:
                self.near.send(number.to_bytes(4, "little"))
            assert self.near.receive() is None
            while (packet := self.far.receive()) is not None:
                sent = int.from_bytes(packet, "little")
                self.arrivals.append((sent, self.now - 10**12 - sent * MS))
        return np.array(self.arrivals, dtype=np.int64).reshape(-1, 2)


def test_a_perfect_network_delivers_everything_at_once_and_in_order() -> None:
    arrivals = Line(Impairment()).run(1000)
    np.testing.assert_array_equal(arrivals[:, 0], np.arange(1000))
    assert not arrivals[:, 1].any()


def test_every_packet_takes_the_delay_and_none_comes_early() -> None:
    arrivals = Line(Impairment(delay_ns=75 * MS)).run(1000)
    assert len(arrivals) == 1000
    assert set(arrivals[:, 1]) == {75 * MS}


def test_jitter_spreads_the_delay_around_its_mean() -> None:
    delays = Line(Impairment(delay_ns=100 * MS, jitter_ns=25 * MS)).run(20_000)[:, 1] / MS
    assert delays.min() >= 75
    assert delays.max() <= 126
    assert delays.mean() == pytest.approx(100.5, abs=0.5)
    assert delays.std() == pytest.approx(25 / np.sqrt(3), rel=0.03)


def test_loss_and_duplication_have_the_stated_shares() -> None:
    line = Line(Impairment(loss=0.3, duplicate=0.05))
    arrivals = line.run(20_000)
    kept = np.unique(arrivals[:, 0])
    assert len(kept) / 20_000 == pytest.approx(0.7, abs=0.015)
    assert (len(arrivals) - len(kept)) / len(kept) == pytest.approx(0.05, abs=0.008)
    assert line.near.lost == 20_000 - len(kept)
    assert line.near.duplicated == len(arrivals) - len(kept)


def test_losses_come_in_bursts_of_the_stated_length_at_the_same_share() -> None:
    arrivals = Line(Impairment(loss=0.1, burst=20.0)).run(100_000, drain_ms=1)
    gaps = np.diff(arrivals[:, 0]) - 1
    gaps = gaps[gaps > 0]
    assert gaps.sum() / 100_000 == pytest.approx(0.1, abs=0.02)
    assert gaps.mean() == pytest.approx(20, rel=0.15)


def test_reordering_holds_back_the_stated_share() -> None:
    arrivals = Line(Impairment(delay_ns=10 * MS, reorder=0.1)).run(20_000)
    assert len(arrivals) == 20_000
    assert set(arrivals[:, 1]) == {10 * MS, 15 * MS}
    assert np.mean(arrivals[:, 1] > 10 * MS) == pytest.approx(0.1, abs=0.01)
    assert (np.diff(arrivals[:, 0]) < 0).any()


def test_nothing_that_is_sent_in_a_blackout_arrives() -> None:
    arrivals = Line(Impairment(blackouts_ns=((100 * MS, 300 * MS),))).run(1000)
    expected = [n for n in range(1000) if not 100 <= n < 300]
    assert list(arrivals[:, 0]) == expected


def test_a_seed_gives_the_same_network_and_another_seed_another() -> None:
    bad = Impairment(50 * MS, 20 * MS, loss=0.2, duplicate=0.1, reorder=0.1)
    first, again, other = (Line(bad, seed).run(2000) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or (first != other).any()


def test_the_queue_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("teleop_rt.link.impairment.QUEUE_LIMIT", 100)
    line = Line(Impairment(delay_ns=10_000 * MS))
    line.run(150, drain_ms=0)
    assert line.near.overflowed == 50


def test_each_direction_takes_half_of_the_trials_round_trip() -> None:
    link = LinkConfig(round_trip_ms=150, jitter_ms=5, loss=0.01, blackouts_s=((1.0, 2.5),))
    one_way = Impairment.one_way(link)
    assert one_way.delay_ns == 75 * MS
    assert one_way.jitter_ns == 2.5 * MS
    assert one_way.loss == 0.01
    assert one_way.blackouts_ns == ((1000 * MS, 2500 * MS),)
