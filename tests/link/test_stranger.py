"""A stranger's handshakes over real sockets: no session, and no more bytes back than it sent."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from heard_wire import HeardWire

from teleop_rt.link.handshake import HANDSHAKES_PER_S, MOST_PENDING
from teleop_rt.link.messages import MotionMessage
from teleop_rt_dev.link.stranger import PORTS, Stranger

TICKS, PER_TICK = 2000, 12


class Heard(HeardWire):
    """A master that leads over a wire on which everything is heard, in steps of 1 ms."""

    def __init__(self) -> None:
        super().__init__()
        self.stranger = Stranger(self.slave_port, seed=8)
        self.led = 0

    def step(self, attacks: int) -> bool:
        """Let a millisecond pass; return whether the master's newest motion is obeyed."""
        self.now_ns += 1_000_000
        self.led += 1
        self.master.poll()
        self.master.send(MotionMessage(float(self.led), 0.0, 0, engaged=True))
        self.wire.pump()
        self.slave.poll()
        motion = self.slave.motion
        if attacks:
            self.stranger.attack(self.wire.to_slave.seen, attacks)
        return motion is not None and motion.target == self.led

    def close(self) -> None:
        super().close()
        self.stranger.close()


@pytest.fixture
def heard() -> Iterator[Heard]:
    world = Heard()
    yield world
    world.close()


def test_a_stranger_gets_no_session_and_no_more_bytes_than_it_sends(heard) -> None:
    while not heard.step(0):
        assert heard.led < 100
    session = heard.slave.session_id
    received = heard.slave.statistics.received
    begun = heard.led
    obeyed = [heard.step(PER_TICK) for _ in range(TICKS)]
    assert all(obeyed)
    assert heard.slave.session_id == heard.master.session_id == session
    assert heard.slave.statistics.take_overs == 0
    assert heard.slave.statistics.received - received == heard.led - begun
    stranger = heard.stranger
    assert stranger.sent > TICKS * PER_TICK / 2
    assert stranger.answers, "a heard handshake is answered, at a bounded rate"
    assert len(stranger.answers) <= (1 + PORTS) * HANDSHAKES_PER_S * (1 + TICKS * 1e-3)
    for sent, back in zip(stranger.bytes_out, stranger.bytes_back, strict=True):
        assert back <= sent
    # Memory, which nothing public shows.
    assert len(heard.slave._answerer.pending) <= MOST_PENDING


def test_a_master_that_calls_while_strangers_ask_still_gets_its_session(heard) -> None:
    """Half-open sessions of a stranger and a spent budget delay a master, and keep none out."""
    while not heard.step(0):
        assert heard.led < 100
    first = heard.slave.session_id
    for _ in range(500):
        heard.step(PER_TICK)
    heard.master.sessions.current = None  # as a master that was started again
    while heard.slave.session_id == first or not heard.slave.fresh_motion:
        heard.step(PER_TICK)
        assert heard.led < 10_000
    assert heard.slave.session_id == heard.master.session_id
