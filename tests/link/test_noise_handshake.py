"""The handshake against published vectors, and the parts that no attacker may change."""

from __future__ import annotations

from typing import NamedTuple

import pytest
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from teleop_rt.link.noise import DH_BYTES, Initiator, NoiseError, Responder, SessionKeys

PSK, PROLOGUE = b"k" * 32, b"teleop-rt test"


class Vector(NamedTuple):
    """A published handshake: each message's payload and bytes, alternately of either end."""

    psk: str
    prologue: str
    initiator_ephemeral: str
    responder_ephemeral: str
    messages: tuple[tuple[str, str], ...]


CACOPHONY = Vector(
    "54686973206973206d7920417573747269616e20706572737065637469766521",
    "4a6f686e2047616c74",
    "893e28b9dc6ca8d611ab664754b8ceb7bac5117349a4439a6b0569da977c464a",
    "bbdb4cdbd309f1a1f2e1456967fe288cadd6f712d65dc7b7793d5e63da6b375b",
    (
        (
            "4c756477696720766f6e204d69736573",
            (
                "ca35def5ae56cec33dc2036731ab14896bc4c75dbb07a61f879f8e3afa4c794479b962b8aff8485742ac32"
                "f905ba45369e2465fb59e138a93d67a0d1266b6a54"
            ),
        ),
        (
            "4d757272617920526f746862617264",
            (
                "95ebc60d2b1fa672c1f46a8aa265ef51bfe38e7ccb39ec5be34069f144808843d6062704d5a9c422a8e834"
                "423f8c1feada7e8d0d910a1a2cd030fb584221e3"
            ),
        ),
        (
            "462e20412e20486179656b",
            "e632c3763d7669067383433197a3baddf146e9e70ad4b4e9e59e0f",
        ),
        (
            "4361726c204d656e676572",
            "64c6bee32ea91c8474bb4c21d7a700109ad45af77b29764ba5eb1e",
        ),
        (
            "4a65616e2d426170746973746520536179",
            "e2fa0bed0603b62d3ccac2ecabbf3fe33f3e86514909b323361626266cb2471cc8",
        ),
        (
            "457567656e2042f6686d20766f6e2042617765726b",
            "0c01dc9cec1fe4ddd692e8dd32188aa351088dc91183639a53b57aa4692b5ebdef8b8ca111",
        ),
    ),
)
"""Noise_NNpsk0_25519_ChaChaPoly_SHA256 of cacophony (Galt), as snow keeps it in tests/vectors."""
HANDSHAKE_HASH = "f4d03dc34495c95729ea6de9e1b59004b59733102488b3e24bc441e0be208eaf"
"""Of the same handshake, by the Python package noiseprotocol 0.3.1."""


def private(key: str) -> X25519PrivateKey:
    return X25519PrivateKey.from_private_bytes(bytes.fromhex(key))


def test_handshake_and_transport_follow_the_published_vector() -> None:
    vector = CACOPHONY
    payloads, packets = zip(*[map(bytes.fromhex, pair) for pair in vector.messages], strict=True)
    psk, prologue = bytes.fromhex(vector.psk), bytes.fromhex(vector.prologue)
    initiator = Initiator(psk, prologue, payloads[0], private(vector.initiator_ephemeral))
    assert initiator.message == packets[0]
    responder = Responder(psk, prologue, packets[0])
    assert responder.payload == payloads[0]
    answer, theirs = responder.answer(payloads[1], private(vector.responder_ephemeral))
    assert answer == packets[1]
    payload, ours = initiator.read(answer)
    assert payload == payloads[1]
    assert ours.handshake_hash.hex() == theirs.handshake_hash.hex() == HANDSHAKE_HASH
    for index, (clear, packet) in enumerate(zip(payloads[2:], packets[2:], strict=True)):
        end, other = (ours, theirs) if index % 2 == 0 else (theirs, ours)
        assert end.sending.encrypt(index // 2, b"", clear) == packet
        assert other.receiving.decrypt(index // 2, b"", packet) == clear


def shaken() -> tuple[SessionKeys, SessionKeys]:
    initiator = Initiator(PSK, PROLOGUE, b"hello")
    answer, theirs = Responder(PSK, PROLOGUE, initiator.message).answer(b"welcome")
    return initiator.read(answer)[1], theirs


def test_each_handshake_gives_keys_that_no_other_has() -> None:
    one, other = shaken()[0], shaken()[0]
    assert one.sending.encrypt(1, b"", b"body") != other.sending.encrypt(1, b"", b"body")
    assert one.sending.encrypt(1, b"", b"body") != one.receiving.encrypt(1, b"", b"body")


def test_each_end_takes_a_fresh_ephemeral_key_also_for_what_it_has_answered_before() -> None:
    """An attacker can make either end alone begin again: its own key must be new each time."""
    calls = [Initiator(PSK, PROLOGUE, b"") for _ in range(4)]
    assert len({call.message[:DH_BYTES] for call in calls}) == 4
    answers = [Responder(PSK, PROLOGUE, calls[0].message).answer(b"") for _ in range(4)]
    assert len({message[:DH_BYTES] for message, _ in answers}) == 4
    assert len({keys.sending.encrypt(1, b"", b"body") for _, keys in answers}) == 4


def test_a_handshake_gives_its_keys_once() -> None:
    initiator = Initiator(PSK, PROLOGUE, b"")
    responder = Responder(PSK, PROLOGUE, initiator.message)
    answer, _ = responder.answer(b"")
    initiator.read(answer)
    with pytest.raises(NoiseError, match="has given"):
        initiator.read(answer)


@given(st.data())
def test_no_changed_message_is_taken_and_the_genuine_one_still_is(data: st.DataObject) -> None:
    initiator = Initiator(PSK, PROLOGUE, b"hello")
    first = initiator.message
    answer, _ = Responder(PSK, PROLOGUE, first).answer(b"welcome")
    for message, read in ((first, lambda m: Responder(PSK, PROLOGUE, m)), (answer, initiator.read)):
        bit = data.draw(st.integers(0, 8 * len(message) - 1))
        changed = bytearray(message)
        changed[bit // 8] ^= 1 << bit % 8
        cut = message[: data.draw(st.integers(0, len(message) - 1))]
        for wrong in (bytes(changed), cut):
            with pytest.raises(NoiseError):
                read(wrong)
    assert initiator.read(answer)[0] == b"welcome"


@pytest.mark.parametrize("point", [bytes(32), b"\x01" + bytes(31)])
def test_a_peer_whose_key_makes_the_product_zero_gets_no_session(point: bytes) -> None:
    initiator = Initiator(PSK, PROLOGUE, b"hello")
    with pytest.raises(NoiseError, match="of no use"):
        initiator.read(point + bytes(16))


@pytest.mark.parametrize(("psk", "prologue"), [(b"x" * 32, PROLOGUE), (PSK, b"another")])
def test_another_key_or_another_protocol_is_no_peer(psk: bytes, prologue: bytes) -> None:
    with pytest.raises(NoiseError):
        Responder(psk, prologue, Initiator(PSK, PROLOGUE, b"").message)
