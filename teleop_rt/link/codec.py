"""The messages of the link as bytes: pure functions between bytes and named tuples.

A packet is `header | body | tag`. The header goes in clear and is authenticated; the body is
sealed by the channel. Numbers are little-endian. A body with a number that is not finite, an
unknown code or a wrong length is refused.
"""

from __future__ import annotations

import functools
import math
from struct import Struct

from teleop_rt.config.trial import ModelId
from teleop_rt.contact.effect import MOST_SHAPES
from teleop_rt.link.messages import (
    MOST_EFFECTS,
    Header,
    Kind,
    Message,
    MessageError,
    ModelEffect,
    ModelMessage,
    MotionMessage,
    StateMessage,
    TakenOver,
)

MAGIC = b"TR"
VERSION = 8
"""Of the packets' layout; a peer of another version is refused."""

WIRE_CODES: dict[ModelId, int] = {
    "mass": 1,
    "kelvin-voigt": 2,
    "kelvin-voigt-unilateral": 3,
    "mass-spring-damper": 4,
    "hunt-crossley": 5,
}
MODEL_OF_CODE = {code: model for model, code in WIRE_CODES.items()}

_HEADER = Struct("<2sBBQQqqq")
_MOTION = Struct("<dddddQBBBB")
_MODEL = Struct("<QQBBdddddddddB")
_EFFECT = Struct(f"<Id{MOST_SHAPES}d")
_STATE = Struct("<dddddQBBBBB")
_TAKEN = Struct("<32s")
HEADER_BYTES, MOTION_BYTES, STATE_BYTES = _HEADER.size, _MOTION.size, _STATE.size
VERSION_AT, KIND_AT, SESSION_AT, SEQUENCE_AT, STAMP_AT, ECHO_AT, HELD_AT = 2, 3, 4, 12, 20, 28, 36
"""Bytes of a header where its fields begin."""


pack_header = functools.partial(_HEADER.pack, MAGIC, VERSION)
"""The 44 bytes of a header, from the fields of a `Header` in its order."""


motion_body = _MOTION.pack
"""The body of a motion from its numbers: target, velocity, surface, force, energy_J, contact_id,
and the flags engaged, wall, provisional and faulted.
"""


def encode_header(header: Header) -> bytes:
    """Return the 44 bytes of a header."""
    return pack_header(*header)


def decode_header(packet: bytes) -> Header:
    """Read the header of a packet; raises MessageError if it is not of this protocol."""
    if len(packet) < HEADER_BYTES:
        raise MessageError("length")
    magic, version, code, session, sequence, stamp_ns, echo_ns, held_ns = _HEADER.unpack_from(
        packet
    )
    if magic != MAGIC:
        raise MessageError("magic")
    if version != VERSION:
        raise MessageError("version")
    kind = _KIND_OF.get(code)
    if kind is None:
        raise MessageError("kind")
    return Header(kind, session, sequence, stamp_ns, echo_ns, held_ns)


def kind_of(message: Message) -> Kind:
    """Return the kind of packet that carries `message`."""
    return _KINDS[type(message)]


def encode(message: Message) -> bytes:
    """Return the body of `message`."""
    match message:
        case MotionMessage():
            return _encode_motion(message)
        case StateMessage():
            return _encode_state(message)
        case ModelMessage():
            return _encode_model(message)
        case TakenOver():
            return _TAKEN.pack(message.peer.encode("ascii"))


def _encode_motion(message: MotionMessage) -> bytes:
    return motion_body(
        message.target,
        message.velocity,
        message.surface,
        message.force,
        message.energy_J,
        message.contact_id,
        message.engaged,
        message.wall,
        message.provisional,
        message.faulted,
    )


def _encode_state(message: StateMessage) -> bytes:
    return _STATE.pack(
        message.position,
        message.force,
        message.verified_free,
        message.velocity,
        message.energy_J,
        message.contact_id,
        message.in_contact,
        message.following,
        message.safety_state,
        message.fault,
        message.inadequate,
    )


def _encode_model(message: ModelMessage) -> bytes:
    effects = b"".join(_EFFECT.pack(e.code, e.amplitude, *e.shape) for e in message.effects)
    return _MODEL.pack(
        message.model_sequence,
        message.contact_id,
        WIRE_CODES[message.model],
        message.surface_known,
        message.surface,
        message.k,
        message.b,
        message.n,
        message.m,
        message.offset,
        message.force_std,
        message.time_s,
        message.surface_velocity,
        len(message.effects),
    ) + effects.ljust(MOST_EFFECTS * _EFFECT.size, b"\0")


def decode(kind: Kind, body: bytes) -> Message:
    """Read the body of a packet of this kind; raises MessageError where it is refused."""
    if len(body) != _SIZES.get(kind):
        raise MessageError("length")
    match kind:
        case Kind.MOTION:
            return _decode_motion(body)
        case Kind.STATE:
            return _decode_state(body)
        case Kind.MODEL:
            return _decode_model(body)
        case Kind.TAKEN:
            return _decode_taken(body)
    raise MessageError("kind")


def _decode_motion(body: bytes) -> MotionMessage:
    *numbers, _, engaged, wall, provisional, faulted = _MOTION.unpack(body)
    _require_finite(*numbers)
    _require_flags(engaged, wall, provisional, faulted)
    return read_motion(body)


def read_motion(body: bytes) -> MotionMessage:
    """Read the body of a motion that was found to be in order."""
    numbers = _MOTION.unpack(body)
    target, velocity, surface, force, energy_J, contact_id, engaged, wall, *rest = numbers
    provisional, faulted = rest
    return MotionMessage(
        target,
        velocity,
        contact_id,
        engaged == 1,
        wall == 1,
        surface,
        force,
        energy_J,
        provisional == 1,
        faulted == 1,
    )


def _decode_state(body: bytes) -> StateMessage:
    *numbers, _, in_contact, following, _, _, inadequate = _STATE.unpack(body)
    _require_finite(*numbers)
    _require_flags(in_contact, following, inadequate)
    return read_state(body)


def read_state(body: bytes) -> StateMessage:
    """Read the body of a state that was found to be in order."""
    numbers = _STATE.unpack(body)
    position, force, free, velocity, energy_J, contact_id, in_contact, following, *rest = numbers
    state, fault, inadequate = rest
    return StateMessage(
        position,
        force,
        contact_id,
        in_contact == 1,
        following == 1,
        state,
        fault,
        free,
        velocity,
        energy_J,
        inadequate == 1,
    )


def _decode_model(body: bytes) -> ModelMessage:
    sequence, contact_id, code, known, *numbers, count = _MODEL.unpack_from(body)
    _require_finite(*numbers)
    _require_flags(known)
    if code not in MODEL_OF_CODE:
        raise MessageError("model")
    if count > MOST_EFFECTS or any(body[_MODEL.size + count * _EFFECT.size :]):
        raise MessageError("effects")
    surface, k, b, n, m, offset, force_std, time_s, surface_velocity = numbers
    return ModelMessage(
        MODEL_OF_CODE[code],
        sequence,
        contact_id,
        surface,
        bool(known),
        k,
        b,
        n,
        m,
        offset,
        force_std,
        tuple(_decode_effect(body, index) for index in range(count)),
        time_s,
        surface_velocity,
    )


def _decode_effect(body: bytes, index: int) -> ModelEffect:
    code, amplitude, *shape = _EFFECT.unpack_from(body, _MODEL.size + index * _EFFECT.size)
    _require_finite(amplitude, *shape)
    return ModelEffect(code, amplitude, tuple(shape))


def _decode_taken(body: bytes) -> TakenOver:
    try:
        return TakenOver(_TAKEN.unpack(body)[0].rstrip(b"\0").decode("ascii"))
    except UnicodeDecodeError:
        raise MessageError("name") from None


def _require_finite(*numbers: float) -> None:
    if not all(map(math.isfinite, numbers)):
        raise MessageError("not finite")


def _require_flags(*flags: int) -> None:
    if max(flags) > 1:
        raise MessageError("flag")


_SIZES = {
    Kind.MOTION: _MOTION.size,
    Kind.MODEL: _MODEL.size + MOST_EFFECTS * _EFFECT.size,
    Kind.STATE: _STATE.size,
    Kind.TAKEN: _TAKEN.size,
}
_KIND_OF = {int(kind): kind for kind in Kind}
_KINDS: dict[type[Message], Kind] = {
    MotionMessage: Kind.MOTION,
    ModelMessage: Kind.MODEL,
    StateMessage: Kind.STATE,
    TakenOver: Kind.TAKEN,
}
