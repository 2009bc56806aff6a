"""Hostile packets to the slave: replayed, with a bit flipped, sealed under a foreign key."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from teleop_rt.link.codec import HEADER_BYTES, decode_header, encode, encode_header
from teleop_rt.link.messages import MotionMessage
from teleop_rt.link.noise import Initiator, Responder, SessionKeys
from teleop_rt.link.session import Session
from teleop_rt_dev.link.pair import Pair

AT_ONCE = 100  # packets that wait for a poll
HELLO = 1  # kind of a packet, as `handshake` has it


def flipped(packet: bytes, bit: int) -> bytes:
    changed = bytearray(packet)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def handshake(psk: bytes) -> SessionKeys:
    """The keys of a caller after a handshake under this pre-shared key."""
    initiator = Initiator(psk, b"", b"")
    message, _ = Responder(psk, b"", initiator.message).answer(b"")
    return initiator.read(message)[1]


def foreign(rng: np.random.Generator, genuine: bytes, session: Session) -> bytes:
    """A well-formed packet of the running session, sealed under another key."""
    header = decode_header(genuine)
    clear = genuine[:HEADER_BYTES]
    assert encode_header(header) == clear
    body = bytes(16) + encode(MotionMessage(float(rng.normal()), 0.0, 9, engaged=True))
    return session.seal(clear, body, header.sequence)


@dataclass(frozen=True)
class Attacked:
    """The outcome of an attack; `unseen` is a genuine packet that was withheld from the slave."""

    accepted: int
    refused: int
    moved: bool
    hello_share: float
    unseen: bytes


def attack(pair: Pair, count: int, seed: int) -> Attacked:
    """Let both ends talk for a while, then send the slave so many hostile packets."""
    pair.run(1500)
    genuine = pair.master_tap.sent[:-1]
    rng = np.random.default_rng(seed)
    strange = Session.of(handshake(b"f" * 32), "strange", 0, 1000)
    pair.master.send(MotionMessage(1.0, 0.0, 0, engaged=True))
    unseen = pair.master_tap.sent[-1]
    while pair.slave_tap.inner.receive() is not None:
        pass
    slave = pair.slave
    received, motion = slave.statistics.received, slave.motion
    refused = sum(slave.statistics.rejected.values())
    for number in range(count):
        packet = genuine[int(rng.integers(len(genuine)))]
        match number % 4:
            case 1:
                packet = flipped(packet, int(rng.integers(8 * len(packet))))
            case 2:
                packet = flipped(unseen, int(rng.integers(8 * len(unseen))))
            case 3:
                packet = foreign(rng, unseen, strange)
        pair.slave_tap.injected.append(packet)
        if number % AT_ONCE == AT_ONCE - 1:
            slave.poll()
    while pair.slave_tap.injected:
        slave.poll()
    hellos = sum(decode_header(packet).kind == HELLO for packet in genuine)
    return Attacked(
        slave.statistics.received - received,
        sum(slave.statistics.rejected.values()) - refused,
        slave.motion is not motion,
        hellos / len(genuine),
        unseen,
    )
