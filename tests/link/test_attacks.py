from __future__ import annotations

from teleop_rt.link.codec import decode_header
from teleop_rt.link.impairment import Impairment
from teleop_rt.link.messages import Kind, MotionMessage
from teleop_rt_dev.link.attacks import attack
from teleop_rt_dev.link.pair import MS, Pair

ATTACKS = 100_000


def test_no_replayed_flipped_or_foreign_packet_is_accepted() -> None:
    pair = Pair(seed=3)
    found = attack(pair, ATTACKS, seed=4)
    assert (found.accepted, found.moved) == (0, False)
    assert found.hello_share < 3 / 1500
    assert found.refused >= ATTACKS * (1 - 2 * found.hello_share)
    assert pair.slave.session_id == pair.master.session_id

    pair.slave_tap.injected.append(found.unseen)
    pair.slave.poll()
    assert pair.slave.motion == MotionMessage(1.0, 0.0, 0, engaged=True)


def test_packets_of_an_earlier_session_are_not_accepted_in_the_next() -> None:
    first = Pair(seed=1)
    first.run(200)
    second = Pair(seed=2)
    second.run(200)
    motion, received = second.slave.motion, second.slave.statistics.received
    second.slave_tap.injected.extend(first.master_tap.sent[-100:])
    second.slave.poll()
    assert second.slave.statistics.rejected["session"] == 100
    assert second.slave.statistics.received <= received + 1
    assert motion is not None


def silent_master(seed: int) -> tuple[Pair, bytes]:
    """A session of 1.5 s, and its Welcome; the slave's later packets are lost for 2.5 s."""
    dark = Impairment(blackouts_ns=((1500 * MS, 4000 * MS),))
    pair = Pair(back=dark, seed=seed)
    pair.run(1500)
    kinds = {decode_header(packet).kind: packet for packet in pair.slave_tap.sent}
    return pair, kinds[Kind.WELCOME]


def test_a_welcome_played_again_at_any_moment_makes_no_nonce_come_twice() -> None:
    for at in (*range(1995, 2008), 2050, 2110):
        pair, welcome = silent_master(at)
        pair.run(at)
        pair.master_tap.injected.append(welcome)
        pair.run(300)
        headers = [decode_header(packet) for packet in pair.master_tap.sent]
        nonces = [(header.session, header.sequence) for header in headers if header.session]
        assert len(set(nonces)) == len(nonces)


def test_what_was_said_once_is_not_said_again_in_the_same_nonce_after_any_replay() -> None:
    """Whatever either side ever sent comes back to it, all of it, while the other is silent."""
    pair, _ = silent_master(1)
    pair.run(1990)
    for _ in range(200):
        pair.master_tap.injected.extend(pair.slave_tap.sent[:40])
        pair.slave_tap.injected.extend(pair.master_tap.sent[:40])
        pair.run(1)
    for tap in (pair.master_tap, pair.slave_tap):
        headers = [decode_header(packet) for packet in tap.sent]
        nonces = [(header.session, header.sequence) for header in headers if header.session]
        assert len(set(nonces)) == len(nonces)
