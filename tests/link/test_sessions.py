"""Who gets a session, who takes it over, and how its keys are renewed."""

from __future__ import annotations

import pytest

from teleop_rt.link import sessions
from teleop_rt.link.budget import ADDRESSES
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.codec import HEADER_BYTES, decode_header
from teleop_rt.link.handshake import (
    HANDSHAKES_PER_S,
    MOST_PENDING,
    RETRIES_PER_HOST,
    RETRIES_PER_S,
    Caller,
)
from teleop_rt.link.impairment import Impairment
from teleop_rt.link.keys import PeerKey, shared_key
from teleop_rt.link.messages import Kind, MotionMessage, StateMessage
from teleop_rt.link.transport import MemoryTransport
from teleop_rt.link.troubles import TROUBLES
from teleop_rt_dev.link.pair import KEY, MS, Pair

ALICE, BOB = PeerKey("alice", b"a" * 32), PeerKey("bob", b"b" * 32)
SHARED = shared_key(KEY)


class Wire(MemoryTransport):
    """An end in memory whose packets come from a given address."""

    def __init__(self, outgoing, incoming, address=None) -> None:
        super().__init__(outgoing, incoming)
        self.sender = address


def kinds(packets: list[bytes]) -> list[Kind]:
    return [decode_header(packet).kind for packet in packets]


def second_master(pair: Pair, key: PeerKey) -> tuple[Endpoint, MemoryTransport]:
    """Another master, at the same slave; its answers are those that the slave sends from now on."""
    near, far = MemoryTransport.pair()
    return Endpoint("master", near, (key,), lambda: pair.now, rate_hz=1000), far


def step_with(pair: Pair, other: Endpoint, far: MemoryTransport, target: float) -> None:
    """Let both masters talk for a tick; the slave's packets reach both."""
    before = len(pair.slave_tap.sent)
    other.poll()
    other.send(MotionMessage(target, 0.0, 0, engaged=True))
    while (packet := far.receive()) is not None:
        pair.slave_tap.injected.append(packet)
    pair.step()
    for packet in pair.slave_tap.sent[before:]:
        far.send(packet)


@pytest.mark.parametrize("key", [ALICE, BOB, SHARED[0]])
def test_each_operators_key_opens_a_session_under_its_name(key: PeerKey) -> None:
    pair = Pair(master_keys=(key,), slave_keys=(*SHARED, ALICE, BOB))
    pair.run(10)
    assert pair.slave.peer == key.name
    assert pair.slave.motion is not None


def test_an_operator_whose_line_was_removed_gets_no_session() -> None:
    pair = Pair(master_keys=(BOB,), slave_keys=(*SHARED, ALICE))
    pair.run(300)
    assert not pair.slave.connected
    assert set(kinds(pair.master_tap.sent)) == {Kind.HELLO}
    assert pair.slave_tap.sent == []
    assert set(pair.slave.statistics.rejected) == {"authentication"}


def test_an_operator_who_leads_is_revoked_by_a_reload_and_hears_what_may_be_the_reason() -> None:
    pair = Pair(master_keys=(ALICE,), slave_keys=(*SHARED, ALICE))
    pair.run(200)
    assert pair.slave.peer == "alice"
    pair.restart_slave(SHARED)
    for _ in range(5000):
        pair.step()
        assert pair.slave.motion is None
        assert not pair.slave.connected
    assert pair.slave.statistics.rejected["authentication"] > 10
    cause = TROUBLES[pair.master.trouble_code(pair.now)][1]
    assert "an operator removed from the rig's key file, gets no answer" in cause


def test_a_take_over_is_counted_and_the_one_before_is_notified_and_does_not_take_it_back() -> None:
    pair = Pair(master_keys=(ALICE,), slave_keys=(ALICE, BOB))
    pair.run(100)
    other, far = second_master(pair, BOB)
    for _ in range(3000):
        step_with(pair, other, far, -1.0)
    assert (pair.slave.peer, pair.slave.statistics.take_overs) == ("bob", 1)
    assert pair.slave.motion.target == -1.0
    assert pair.master.taken_by == "bob"
    assert "another master leads the slave now" in (pair.master.trouble or "")
    assert not pair.master.connected
    assert other.connected
    assert other.taken_by is None


def test_a_master_that_comes_back_after_silence_takes_nothing_over() -> None:
    pair = Pair()
    pair.run(100)
    pair.restart_slave()
    pair.run(3000)
    assert pair.slave.connected
    assert pair.slave.statistics.take_overs == 0


def of_newest_packets(pair: Pair) -> list[int]:
    """Return the session that each side's newest packet belongs to."""
    return [decode_header(tap.sent[-1]).session for tap in (pair.master_tap, pair.slave_tap)]


def test_the_keys_are_renewed_while_the_session_goes_on() -> None:
    pair = Pair(there=Impairment(30 * MS), back=Impairment(30 * MS))
    pair.run(200)
    chain, first = pair.master.session_id, of_newest_packets(pair)
    pair.now += sessions.REKEY_AFTER_NS
    pair.master.sessions.accepted_ns = pair.slave.sessions.accepted_ns = pair.now
    applied = pair.slave.motion.target
    for _ in range(300):
        pair.step()
        assert pair.slave.motion.target >= applied
        assert pair.master.connected
        applied = pair.slave.motion.target
    assert pair.master.session_id == pair.slave.session_id == chain
    now = of_newest_packets(pair)
    assert len(set(now)) == 1
    assert now != first
    assert applied >= pair.sent - 32
    assert pair.slave.statistics.take_overs == 0
    assert pair.slave.statistics.lost == pair.master.statistics.lost == 0


def test_keys_that_are_never_renewed_are_given_up() -> None:
    pair = Pair()
    pair.run(100)
    pair.now += sessions.REJECT_AFTER_NS
    pair.slave.poll()
    assert not pair.slave.connected
    pair.slave_tap.sent.clear()
    pair.slave.send(StateMessage(0.0, 0.0, 0, in_contact=False))
    assert pair.slave_tap.sent == []


def hello_of(key: PeerKey, now: int) -> bytes:
    return Caller(key).hello(1000, 0, now)


def test_strangers_cost_a_hash_and_are_never_answered() -> None:
    pair = Pair()
    for _ in range(2000):
        pair.slave_tap.injected.append(hello_of(PeerKey("?", b"?" * 32), pair.now)[:-1] + b"x")
        pair.slave_tap.injected.append(bytes(200))
    while pair.slave_tap.injected:
        pair.slave.poll()
    assert pair.slave_tap.sent == []
    pair.run(10)
    assert pair.slave.connected, "a flood of strangers keeps no peer out"


def test_under_load_a_hello_is_answered_by_a_cookie_and_who_shows_it_is_served() -> None:
    pair = Pair()
    pair.slave.poll()
    olds = [hello_of(SHARED[0], pair.now) for _ in range(40)]  # recorded ones, played again
    for old in olds:
        pair.slave_tap.injected.append(old)
        pair.slave.poll()
    answers = kinds(pair.slave_tap.sent)
    assert answers.count(Kind.WELCOME) == 4
    assert 10 <= answers.count(Kind.RETRY) <= 36
    pair.now += 1000 * MS
    pair.run(300)
    assert pair.slave.connected
    assert Kind.RETRY in kinds(pair.slave_tap.sent[len(answers) :])
    assert all(len(a) <= len(olds[0]) for a in pair.slave_tap.sent[: len(answers)]), "no gain"


def test_a_cookie_serves_the_address_that_received_it_alone() -> None:
    pair = Pair()
    pair.slave.poll()
    pair.slave_tap.inner.sender = ("10.0.0.1", 1000)
    for _ in range(4):
        pair.slave_tap.injected.append(hello_of(SHARED[0], pair.now))
        pair.slave.poll()
    caller = Caller(SHARED[0])
    pair.slave_tap.injected.append(caller.hello(1000, 0, pair.now))
    pair.slave.poll()
    retry = pair.slave_tap.sent[-1]
    assert decode_header(retry).kind is Kind.RETRY
    caller.take_retry(retry, pair.now)
    with_cookie = caller.hello(1000, 0, pair.now)
    for address, kind in (
        (("10.0.0.2", 1000), Kind.RETRY),
        (("10.0.0.1", 1001), Kind.RETRY),
        (("10.0.0.1", 1000), Kind.WELCOME),
    ):
        pair.slave_tap.inner.sender = address
        pair.slave_tap.injected.append(with_cookie)
        pair.slave.poll()
        assert decode_header(pair.slave_tap.sent[-1]).kind is kind


def test_cookies_are_bounded_however_many_addresses_ask() -> None:
    pair = Pair()
    pair.slave.poll()
    hello = hello_of(SHARED[0], pair.now)
    for hosts, cookies in ((1, RETRIES_PER_HOST), (3, RETRIES_PER_S)):
        for number in range(5000):
            pair.slave_tap.inner.sender = (f"10.0.0.{number % hosts}", 1024 + number)
            pair.slave_tap.injected.append(hello)
            pair.slave.poll()
        assert kinds(pair.slave_tap.sent).count(Kind.RETRY) == cookies
    assert kinds(pair.slave_tap.sent).count(Kind.WELCOME) == HANDSHAKES_PER_S
    assert len(pair.slave._answerer.retried) <= ADDRESSES  # memory: nothing else shows it


def test_handshakes_under_way_are_bounded_and_a_poll_works_one() -> None:
    pair = Pair()
    for count in range(3 * MOST_PENDING):
        pair.slave_tap.injected.extend(hello_of(SHARED[0], pair.now) for _ in range(5))
        sent = len(pair.slave_tap.sent)
        pair.slave.poll()
        assert kinds(pair.slave_tap.sent[sent:]).count(Kind.WELCOME) <= 1, count
        pair.now += 200 * MS
    assert len(pair.slave._answerer.pending) <= MOST_PENDING  # memory, as above


def test_a_reflected_packet_of_any_kind_is_no_message() -> None:
    pair = Pair()
    pair.run(50)
    session, motion = pair.slave.session_id, pair.slave.motion
    for end, tap, own in (
        (pair.slave, pair.slave_tap, pair.slave_tap.sent),
        (pair.master, pair.master_tap, pair.master_tap.sent),
    ):
        received = end.statistics.received
        tap.injected.extend(own)
        while tap.injected:
            end.poll()
        assert end.statistics.received <= received + 1  # the packet under way
    assert pair.slave.session_id == session
    assert pair.slave.motion.target >= motion.target


def test_the_body_of_every_packet_is_sealed() -> None:
    pair = Pair()
    pair.run(200)
    seen = {packet[HEADER_BYTES:] for packet in pair.master_tap.sent}
    assert len(seen) == len([p for p in pair.master_tap.sent if decode_header(p).session]) + 1
