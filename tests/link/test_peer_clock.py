"""The age of a message, and the influence of somebody who delays packets on it."""

from __future__ import annotations

import pytest

from teleop_rt.link.channel import Role
from teleop_rt.link.impairment import Impairment
from teleop_rt.link.keys import shared_key
from teleop_rt.link.peer_clock import FUTURE_NS, PeerClock
from teleop_rt.link.transport import MemoryTransport
from teleop_rt.trial.sides import make_endpoint
from teleop_rt_dev.link.pair import MS, Pair
from teleop_rt_dev.trial.files import silicone

S = 1_000_000_000
AHEAD = 3 * 10**15
"""The peer's clock minus ours."""


def exchanged(clock: PeerClock, now: int, there: int, back: int) -> int:
    """A round trip that ends now, took so long either way, and was answered at once."""
    sent = now - there - back
    stamp = sent + there + AHEAD
    return clock.exchange(sent, stamp, stamp, now)


def test_age_is_what_a_message_takes_beyond_the_links_own_time() -> None:
    clock = PeerClock()
    now = 10 * S
    assert clock.age_ns(now + AHEAD, now) is None, "before the first exchange nothing is dated"
    exchanged(clock, now, 80 * MS, 80 * MS)
    assert clock.offset_ns == AHEAD
    assert clock.age_ns(now - 80 * MS + AHEAD, now) == 0
    clock.fix()
    assert clock.age_ns(now - 80 * MS + AHEAD, now) == 0
    assert clock.age_ns(now - 380 * MS + AHEAD, now) == 300 * MS


def test_a_declared_one_way_time_holds_from_the_beginning() -> None:
    clock = PeerClock(20 * MS)
    exchanged(clock, 10 * S, 8 * S, 1 * MS)  # somebody withholds packets from us, or to us
    assert clock.age_ns(10 * S - 1 * MS + AHEAD, 10 * S) == pytest.approx(4 * S, abs=40 * MS)


@pytest.mark.parametrize(("there", "back"), [(5 * S, 5 * S), (10 * S, 5 * S), (5 * S, 10 * S)])
def test_a_fixed_clock_follows_a_link_that_becomes_slower_at_100_ppm(there: int, back: int) -> None:
    clock = PeerClock()
    now = 100 * S
    exchanged(clock, now, 5 * MS, 5 * MS)
    clock.age_ns(now - 5 * MS + AHEAD, now)
    clock.fix()
    own = clock.one_way_ns
    for second in range(1, 601):
        now += S
        exchanged(clock, now, there, back)
        assert abs(clock.offset_ns - AHEAD) <= second * S * 100 // 10**6
        assert clock.one_way_ns == own
        age = clock.age_ns(now - back + AHEAD, now)
        assert age >= back - own - second * S * 100 // 10**6


def test_a_fixed_clock_follows_a_crystal() -> None:
    clock = PeerClock()
    now, drift = 100 * S, 0
    exchanged(clock, now, 5 * MS, 5 * MS)
    clock.fix()
    for _ in range(3600):
        now += S
        drift += 50_000  # 50 ppm
        sent = now - 10 * MS
        stamp = sent + 5 * MS + AHEAD + drift
        clock.exchange(sent, stamp, stamp, now)
    assert abs(clock.offset_ns - AHEAD - drift) < 2 * MS


def test_a_stamp_from_the_future_cannot_be_dated() -> None:
    clock = PeerClock()
    exchanged(clock, 10 * S, 5 * MS, 5 * MS)
    clock.fix()
    assert clock.age_ns(10 * S + AHEAD + FUTURE_NS, 10 * S) is not None
    assert clock.age_ns(10 * S + AHEAD + FUTURE_NS + 6 * MS, 10 * S) is None


def test_a_fixed_clock_is_not_forgotten_and_a_released_one_learns_again() -> None:
    clock = PeerClock()
    exchanged(clock, 10 * S, 5 * MS, 5 * MS)
    clock.fix()
    clock.forget()
    assert clock.known
    clock.release()
    clock.forget()
    assert not clock.known


def slow_after(ms: int) -> Pair:
    """A pair whose way to the slave has become slower by so much, since its clock was fixed."""
    pair = Pair(there=Impairment(20 * MS), back=Impairment(20 * MS))
    pair.run(1500)
    pair.slave.fix_clock()
    pair.master.transport.impairment = Impairment((20 + ms) * MS)
    return pair


def test_a_link_that_became_slower_is_followed_within_the_bound_and_not_beyond() -> None:
    quick, slow = slow_after(60), slow_after(160)
    quick.run(1000)
    slow.run(1000)
    assert quick.slave.silence_ns(quick.now) == pytest.approx(60 * MS, abs=2 * MS)
    assert quick.slave.statistics.rejected == {}
    assert slow.slave.silence_ns(slow.now) > 900 * MS
    assert slow.slave.statistics.rejected["stale"] > 700
    assert "arm the axis again" in (slow.slave.trouble or "")
    slow.slave.clock.release()
    slow.run(2500)
    slow.slave.fix_clock()
    slow.run(200)
    assert slow.slave.silence_ns(slow.now) < 5 * MS
    assert slow.slave.trouble is None


def test_a_master_with_another_clock_is_followed_only_once_the_axis_is_armed_again() -> None:
    pair = Pair()
    pair.run(1500)
    pair.slave.fix_clock()
    moved = pair.sent
    pair.master._now_ns = lambda: pair.now + 3600 * S
    pair.master.sessions.current = None
    pair.run(3000)
    assert pair.slave.connected
    assert pair.slave.silence_ns(pair.now) > 2500 * MS
    assert pair.slave.motion is None or pair.slave.motion.target <= moved + 1
    pair.slave.clock.release()
    pair.master.sessions.current = None
    pair.run(3000)
    assert pair.slave.silence_ns(pair.now) < 5 * MS


@pytest.mark.parametrize("role", ["slave", "master"])
def test_each_side_takes_the_one_way_time_that_a_trial_declares(role: Role) -> None:
    keys, (transport, _) = shared_key(bytes(32)), MemoryTransport.pair()
    ages = []
    for declared in ("20", "null"):
        trial = silicone(f"link.one_way_max_ms={declared}")
        clock = make_endpoint(role, trial, transport, keys, lambda: 10 * S).clock
        exchanged(clock, 10 * S, 8 * S, 1 * MS)
        ages.append(clock.age_ns(10 * S - 1 * MS + AHEAD, 10 * S))
    assert ages == [pytest.approx(4 * S, abs=40 * MS), 0]
