"""The loop's clock on a fake machine: the grid, stalls, spin, lead, work ahead of a tick."""

import numpy as np
import pytest

from teleop_rt.realtime.clock import (
    AHEAD_NS,
    LEAD_FALL_NS,
    LEAD_RISE_NS,
    LEAD_UP_TO_NS,
    RealClock,
)
from teleop_rt.realtime.lateness import late_ns


class FakeTime:
    """A machine's clock that a test moves: sleeping overshoots, reading takes a microsecond."""

    def __init__(self) -> None:
        self.now = 0
        self.slept: list[int] = []
        self.oversleeps = 0
        self.late_ns = 30_000
        self.aimed_ns = 0

    def monotonic_ns(self) -> int:
        self.now += 1000
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(round(seconds * 1e9))
        self.aimed_ns = self.now + self.slept[-1]
        self.now += round(seconds * 1e9) + self.late_ns + self.oversleeps
        self.oversleeps = 0


@pytest.fixture
def machine(monkeypatch):
    fake = FakeTime()
    monkeypatch.setattr("teleop_rt.realtime.clock.time", fake)
    return fake


@pytest.mark.parametrize("rate_hz", [100, 1000, 4000])
def test_deadlines_lie_on_one_grid_and_missed_ones_are_skipped_and_counted(machine, rate_hz):
    period = 10**9 // rate_hz
    clock = RealClock(period)
    start = machine.now
    skipped = 0
    for tick in range(500):
        if tick % 100 == 50:
            machine.now += 3 * period
        skipped += clock.wait_next_tick()
        assert machine.now - clock.wake_latency_ns == start + (tick + 1 + skipped) * period
        assert 0 <= clock.wake_latency_ns <= 40_000
    assert skipped == 15


@pytest.mark.parametrize("rate_hz", [100, 1000, 4000])
def test_who_oversleeps_learns_it_with_that_tick_and_stays_on_the_grid(machine, rate_hz):
    period = 10**9 // rate_hz
    clock = RealClock(period)
    start = machine.now
    assert clock.wait_next_tick() == 0
    machine.oversleeps = 3 * period + period // 2
    assert clock.wait_next_tick() == 3
    assert 0 <= clock.wake_latency_ns - (3 * period + period // 2) <= 40_000
    assert late_ns(3, clock.wake_latency_ns, period) == clock.wake_latency_ns
    assert clock.wait_next_tick() == 0
    assert machine.now - clock.wake_latency_ns == start + 6 * period


def test_a_spin_sleeps_less_and_wakes_nearer_to_the_deadline(machine):
    clock = RealClock(1_000_000, spin_ns=100_000)
    for _ in range(10):
        assert clock.wait_next_tick() == 0
        assert clock.wake_latency_ns <= 1000
        assert machine.slept[-1] <= 900_000
    late = RealClock(1_000_000)
    late.wait_next_tick()
    assert late.wake_latency_ns >= 29_000


@pytest.mark.parametrize("watched", [False, True])
def test_work_ahead_of_a_tick_is_done_once_and_ends_before_the_deadline(machine, watched):
    period, done = 1_000_000, []

    def work() -> None:
        done.append(clock._deadline_ns - machine.now)
        machine.now += 30_000

    watch = machine.sleep if watched else None
    clock = RealClock(period, watch=watch, ahead=work)
    for tick in range(1, 11):
        assert clock.wait_next_tick() == 0
        assert len(done) == tick
    # A wake-up of FakeTime is 30 us late, and the work takes as long.
    assert all(60_000 < before_ns <= AHEAD_NS for before_ns in done)
    assert all(one > AHEAD_NS for one in machine.slept[:: len(machine.slept) // 10])


def test_work_ahead_is_left_out_where_a_tick_leaves_no_time_for_it(machine):
    done = []
    clock = RealClock(1_000_000, ahead=lambda: done.append(machine.now))
    clock.wait_next_tick()
    machine.now = clock._deadline_ns + 1_000_000 - AHEAD_NS
    assert clock.wait_next_tick() == 0
    assert len(done) == 1
    machine.now += 500_000
    assert clock.wait_next_tick() == 0
    assert len(done) == 2


def lead_ns(machine, clock):
    """Return how long before the deadline the last sleep was to end."""
    return machine.now - clock.wake_latency_ns - machine.aimed_ns


def run(machine, clock, sleeps_late_ns):
    """Play a tick for each of these sleeps; return wake latencies and waits awake."""
    latencies, awake = [], []
    for machine.late_ns in sleeps_late_ns:
        assert clock.wait_next_tick() == 0
        latencies.append(clock.wake_latency_ns)
        awake.append(clock.awake_ns)
    return np.array(latencies), np.array(awake)


def test_a_clock_without_history_sleeps_until_the_deadline(machine):
    clock = RealClock(1_000_000)
    clock.wait_next_tick()
    # Three looks at the time, a microsecond each, come before the sleep.
    assert machine.slept == [1_000_000 - 2000]
    assert clock.awake_ns == 0


@pytest.mark.parametrize("rate_hz", [100, 1000, 4000])
def test_a_clock_leads_by_how_late_its_sleeps_are_and_wakes_near_the_deadline(machine, rate_hz):
    clock = RealClock(10**9 // rate_hz)
    sleeps_late_ns = np.random.default_rng(26).normal(25_000, 3000, 2000)
    latencies, awake = run(machine, clock, [int(one) for one in sleeps_late_ns])
    assert np.median(latencies[:20]) > 20_000
    settled = slice(400, None)
    assert np.min(latencies) >= 0
    assert np.median(latencies[settled]) < 5000
    assert 0.2 < np.mean(awake[settled] > 0) < 0.35
    assert np.mean(awake[settled]) < 1500


def test_a_stall_moves_the_lead_by_one_step(machine):
    clock = RealClock(1_000_000)
    run(machine, clock, [20_000] * 500)
    machine.oversleeps = 5_300_000
    assert clock.wait_next_tick() == 5
    before_ns = lead_ns(machine, clock)
    clock.wait_next_tick()
    assert lead_ns(machine, clock) == before_ns + LEAD_RISE_NS


def test_the_lead_is_bounded_and_goes_once_sleeps_are_in_time(machine):
    clock = RealClock(1_000_000)
    run(machine, clock, [400_000] * 1000)
    assert lead_ns(machine, clock) == LEAD_UP_TO_NS
    latencies, awake = run(machine, clock, [0] * 100)
    assert np.min(latencies) >= 0
    assert np.max(awake) <= LEAD_UP_TO_NS
    assert lead_ns(machine, clock) < 3 * LEAD_FALL_NS
    assert np.max(awake[-20:]) < 3 * LEAD_FALL_NS


def test_a_spin_longer_than_the_lead_is_not_lengthened_by_it(machine):
    clock = RealClock(1_000_000, spin_ns=100_000)
    run(machine, clock, [20_000] * 500)
    assert lead_ns(machine, clock) == 100_000
