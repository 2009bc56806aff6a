from __future__ import annotations

from link_attacks import attack
from link_pair import Pair

from teleop_rt.link.messages import Motion

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
    assert pair.slave.motion == Motion(1.0, 0.0, 0, engaged=True)


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
