from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from teleop_rt.contact.effect import MOST_SHAPES
from teleop_rt.link.codec import (
    HEADER_BYTES,
    WIRE_CODES,
    decode,
    decode_header,
    encode,
    encode_header,
    kind_of,
)
from teleop_rt.link.messages import (
    Header,
    Kind,
    MessageError,
    ModelEffect,
    ModelMessage,
    MotionMessage,
    StateMessage,
    TakenOver,
)

FINITE = st.floats(allow_nan=False, allow_infinity=False)
U64 = st.integers(0, 2**64 - 1)
I64 = st.integers(-(2**63), 2**63 - 1)
U8 = st.integers(0, 255)
EFFECTS = st.lists(
    st.builds(ModelEffect, st.integers(0, 2**32 - 1), FINITE, st.tuples(*MOST_SHAPES * [FINITE])),
    max_size=2,
).map(tuple)
MESSAGES = st.one_of(
    st.builds(TakenOver, st.from_regex(r"[A-Za-z0-9_.-]{1,32}", fullmatch=True)),
    st.builds(
        MotionMessage,
        FINITE,
        FINITE,
        U64,
        st.booleans(),
        st.booleans(),
        *[FINITE] * 3,
        st.booleans(),
        st.booleans(),
    ),
    st.builds(
        StateMessage,
        FINITE,
        FINITE,
        U64,
        st.booleans(),
        st.booleans(),
        U8,
        U8,
        *[FINITE] * 3,
        st.booleans(),
    ),
    st.builds(
        ModelMessage,
        st.sampled_from(sorted(WIRE_CODES)),
        U64,
        U64,
        FINITE,
        st.booleans(),
        *[FINITE] * 6,
        EFFECTS,
        FINITE,
        FINITE,
    ),
)
SAMPLES = (
    MotionMessage(
        0.0137,
        0.04,
        3,
        engaged=True,
        wall=True,
        surface=0.0136,
        force=1.5,
        energy_J=0.2,
        faulted=True,
    ),
    StateMessage(0.0137, 1.5, 3, in_contact=True, safety_state=4, fault=0, verified_free=0.0135),
    ModelMessage("hunt-crossley", 7, 3, 0.0136, k=1500.0, b=50.0, n=1.5, force_std=0.05),
)


@given(MESSAGES)
def test_every_message_comes_back_from_its_bytes(message) -> None:
    assert decode(kind_of(message), encode(message)) == message


@given(st.builds(Header, st.sampled_from(list(Kind)), U64, U64, I64, I64, I64))
def test_a_header_comes_back_from_its_bytes(header: Header) -> None:
    encoded = encode_header(header)
    assert len(encoded) == HEADER_BYTES
    assert decode_header(encoded + b"body") == header


@pytest.mark.parametrize("message", SAMPLES, ids=lambda message: type(message).__name__)
@pytest.mark.parametrize("wild", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_refused_in_every_field(message, wild: float) -> None:
    names = [name for name, value in message._asdict().items() if isinstance(value, float)]
    assert len(names) >= 3
    for name in names:
        with pytest.raises(MessageError, match="not finite"):
            decode(kind_of(message), encode(message._replace(**{name: wild})))


@given(st.sampled_from(list(Kind)), st.binary(max_size=400))
def test_arbitrary_bytes_are_a_message_or_are_refused(kind: Kind, body: bytes) -> None:
    try:
        message = decode(kind, body)
    except MessageError:
        return
    assert encode(message) == body


@pytest.mark.parametrize("message", SAMPLES, ids=lambda message: type(message).__name__)
def test_a_body_of_another_length_is_refused(message) -> None:
    body = encode(message)
    for wrong in (body[:-1], body + b"\0", b""):
        with pytest.raises(MessageError, match="length"):
            decode(kind_of(message), wrong)


def test_an_unknown_model_code_is_refused() -> None:
    body = bytearray(encode(SAMPLES[2]))
    body[16] = 99
    with pytest.raises(MessageError, match="model"):
        decode(Kind.MODEL, bytes(body))


@pytest.mark.parametrize(
    ("offset", "value", "reason"), [(0, 0x00, "magic"), (2, 1, "version"), (3, 0, "kind")]
)
def test_a_foreign_header_is_refused_with_its_reason(offset: int, value: int, reason: str) -> None:
    packet = bytearray(encode_header(Header(Kind.STATE, 1, 2, 3)))
    packet[offset] = value
    with pytest.raises(MessageError, match=reason):
        decode_header(bytes(packet))
    with pytest.raises(MessageError, match="length"):
        decode_header(bytes(packet[:-1]))


def test_the_layout_of_the_wire_is_fixed() -> None:
    assert encode_header(Header(Kind.MOTION, 1, 2, 3, 4, 5)) == struct.pack(
        "<2sBBQQqqq", b"TR", 8, 3, 1, 2, 3, 4, 5
    )
    assert encode(SAMPLES[0]) == struct.pack(
        "<dddddQBBBB", 0.0137, 0.04, 0.0136, 1.5, 0.2, 3, 1, 1, 0, 1
    )
