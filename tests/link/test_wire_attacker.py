"""An attacker on loopback that knows nothing but datagrams gains nothing by changing them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from heard_wire import HeardWire

from teleop_rt.link.messages import MotionMessage, StateMessage

MS = 1_000_000
AT_ONCE = 15


class Loopback(HeardWire):
    """Both ends on real sockets, an attacker between them, and a clock in steps of 1 ms."""

    def __init__(self) -> None:
        super().__init__()
        self.sent = 0
        self.obeyed: list[int] = []

    def step(self, *, alive: bool = True, attacks: int = 0) -> None:
        """Let a millisecond pass; each motion's target is its number."""
        self.now_ns += MS
        if alive:
            self.sent += 1
            self.master.send(MotionMessage(float(self.sent), 0.0, 0, engaged=True))
            self.master.poll()
        self.slave.send(StateMessage(float(self.sent), 0.0, 0, in_contact=False))
        self.wire.pump()
        if attacks:
            self.wire.attack(attacks)
        self.slave.poll()
        if self.slave.fresh_motion:
            assert self.slave.motion is not None
            self.obeyed.append(int(self.slave.motion.target))


@pytest.fixture
def loopback() -> Iterator[Loopback]:
    """A link that stands, its delay fixed as when an axis is armed."""
    world = Loopback()
    for _ in range(100):
        world.step()
    world.slave.fix_clock()
    world.obeyed.clear()
    yield world
    world.close()


def test_packets_repeated_reflected_changed_and_mixed_are_never_obeyed(loopback) -> None:
    first = loopback.sent
    for _ in range(300):
        loopback.step(attacks=AT_ONCE)
    obeyed = loopback.obeyed
    assert obeyed == sorted(set(obeyed)), "each motion at most once, and none after a later one"
    assert set(obeyed) <= set(range(first, loopback.sent + 1))
    assert len(obeyed) > 290, "the genuine ones come through all the same"


def test_nothing_that_was_heard_replaces_a_master_that_is_dead(loopback) -> None:
    for _ in range(300):
        loopback.step(alive=False, attacks=AT_ONCE)
    assert loopback.obeyed == []
    assert loopback.slave.silence_ns(loopback.now_ns) >= 299 * MS


def test_motion_that_is_withheld_and_let_go_later_does_not_replace_a_dead_master(loopback) -> None:
    loopback.wire.to_slave.open = False
    for _ in range(200):
        loopback.step()
    for _ in range(150):
        loopback.step(alive=False)
    loopback.obeyed.clear()
    before_ns = loopback.slave.silence_ns(loopback.now_ns)
    released = 0
    while loopback.wire.let_go():
        released += 1
        loopback.step(alive=False)
    assert released >= 200
    assert loopback.obeyed == []
    assert loopback.slave.silence_ns(loopback.now_ns) >= before_ns + released * MS


def test_a_session_that_was_heard_whole_opens_no_other_and_hinders_none() -> None:
    heard, fresh = Loopback(), Loopback()
    for _ in range(100):
        heard.step()
    for way, old in (
        (fresh.wire.to_slave, heard.wire.to_slave),
        (fresh.wire.to_master, heard.wire.to_master),
    ):
        way.seen += old.seen
    for _ in range(100):
        fresh.step(alive=False, attacks=AT_ONCE)
    assert not fresh.slave.connected
    assert fresh.obeyed == []
    for _ in range(200):
        fresh.step(attacks=3)
    assert fresh.slave.connected
    assert len(fresh.obeyed) > 100
    assert fresh.obeyed == sorted(set(fresh.obeyed))
    heard.close()
    fresh.close()
