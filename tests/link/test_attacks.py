from __future__ import annotations

import numpy as np
from link_pair import Pair

from teleop_rt.link.messages import HEADER_BYTES, Motion, decode_header, encode, encode_header
from teleop_rt.link.security import Session

ATTACKS = 100_000


def flipped(packet: bytes, bit: int) -> bytes:
    changed = bytearray(packet)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def foreign(rng: np.random.Generator, genuine: bytes, session: Session) -> bytes:
    """A well-formed packet of the running session, sealed under another key."""
    header = decode_header(genuine)
    clear = genuine[:HEADER_BYTES]
    assert encode_header(header) == clear
    body = bytes(16) + encode(Motion(float(rng.normal()), 0.0, 9, engaged=True))
    return session.outgoing.seal(clear, body, header.sequence)


def test_no_replayed_flipped_or_foreign_packet_is_accepted() -> None:
    pair = Pair(seed=3)
    pair.run(1500)
    genuine = pair.master_tap.sent[:-1]
    rng = np.random.default_rng(4)
    foreign_session = Session.derive(b"f" * 32, rng.bytes(32), rng.bytes(32), "master")
    pair.master.send(Motion(1.0, 0.0, 0, engaged=True))
    unseen = pair.master_tap.sent[-1]
    while pair.slave_tap.inner.receive() is not None:
        pass
    received, motion = pair.slave.statistics.received, pair.slave.motion
    rejected = sum(pair.slave.statistics.rejected.values())
    session_id = pair.slave.session_id

    for attack in range(ATTACKS):
        packet = genuine[int(rng.integers(len(genuine)))]
        match attack % 4:
            case 1:
                packet = flipped(packet, int(rng.integers(8 * len(packet))))
            case 2:
                packet = flipped(unseen, int(rng.integers(8 * len(unseen))))
            case 3:
                packet = foreign(rng, unseen, foreign_session)
        pair.slave_tap.injected.append(packet)
        if attack % 100 == 99:
            pair.slave.poll()

    assert not pair.slave_tap.injected
    assert pair.slave.motion is motion
    assert pair.slave.statistics.received == received
    hellos = sum(decode_header(packet).kind == 1 for packet in genuine)
    assert hellos < 3
    refused = sum(pair.slave.statistics.rejected.values()) - rejected
    assert refused >= ATTACKS * (1 - 2 * hellos / len(genuine))
    assert pair.slave.session_id == session_id

    pair.slave_tap.injected.append(unseen)
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
