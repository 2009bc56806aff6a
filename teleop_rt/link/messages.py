"""The messages of the link: pure functions between bytes and named tuples.

A packet is `header | body | tag`. The header goes in clear and is authenticated; the body is
sealed by the channel. Numbers are little-endian; positions, velocities and forces are in the
rig's units, in the slave's axis coordinates; stamps are the sender's monotonic nanoseconds.
A body with a number that is not finite, an unknown code or a wrong length is refused.
"""

from __future__ import annotations

import math
from enum import IntEnum
from struct import Struct
from typing import NamedTuple

from teleop_rt.config import ModelId

MAGIC = b"TR"
VERSION = 6

MODEL_CODES: dict[ModelId, int] = {
    "mass": 1,
    "kelvin-voigt": 2,
    "kelvin-voigt-unilateral": 3,
    "mass-spring-damper": 4,
    "hunt-crossley": 5,
}
MODEL_OF_CODE = {code: model for model, code in MODEL_CODES.items()}

_HEADER = Struct("<2sBBQQqqq")
_MOTION = Struct("<dddddQBBB")
_MODEL = Struct("<QQBBdddddddddB")
_EFFECT = Struct("<Idddd")
MOST_EFFECTS = 2
"""Effects of the environment beside a streamed model."""
SHAPES = 3
"""Shape parameters that an effect may have."""
_STATE = Struct("<dddddQBBBBB")
_TAKEN = Struct("<32s")
HEADER_BYTES, MOTION_BYTES, STATE_BYTES = _HEADER.size, _MOTION.size, _STATE.size


class MessageError(ValueError):
    """Bytes that are no message of this protocol; `reason` is the counter's name."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Kind(IntEnum):
    """The kind of a packet's content."""

    HELLO = 1
    WELCOME = 2
    MOTION = 3
    MODEL = 4
    STATE = 5
    RETRY = 6
    TAKEN = 7


class Header(NamedTuple):
    """The clear part of a packet.

    `stamp_ns` is the sender's clock when it was sent; `echo_ns` the newest stamp that the sender
    has of the peer (0 before the first), and `held_ns` how long ago it came.
    """

    kind: Kind
    session: int
    sequence: int
    stamp_ns: int
    echo_ns: int = 0
    held_ns: int = 0


class MotionMessage(NamedTuple):
    """The master's motion, each tick.

    `target` is x_m - o. `contact_id` is the newest contact whose wall the master has adopted.
    `wall` says that the master renders a wall at `surface` (0 where it renders none): a contact
    found there needs no hold, for the operator feels it already.
    """

    target: float
    velocity: float
    contact_id: int
    engaged: bool
    wall: bool = False
    surface: float = 0.0
    force: float = 0.0
    energy_J: float = 0.0
    provisional: bool = False


class ModelEffect(NamedTuple):
    """An effect of the environment beside a model: which (`fitted.code_of`), how much, its shape.

    Of `shape` (SHAPES,) what the effect does not have is 0.
    """

    code: int
    amplitude: float
    shape: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ModelMessage(NamedTuple):
    """The selected model of the environment, with its surface.

    Without a known surface `surface` is the position from which x is counted and `offset` is
    the force there; with one, `offset` is 0. `force_std` is the deviation of measured force
    from the model. Parameters that the model does not have are 0 (`n` is 1). `time_s` is the time
    that the effects see, when it was sent. The surface is where it was then, and has moved at
    `surface_velocity` since.
    """

    model: ModelId
    model_sequence: int
    contact_id: int
    surface: float
    surface_known: bool = True
    k: float = 0.0
    b: float = 0.0
    n: float = 1.0
    m: float = 0.0
    offset: float = 0.0
    force_std: float = 0.0
    effects: tuple[ModelEffect, ...] = ()
    time_s: float = 0.0
    surface_velocity: float = 0.0


class StateMessage(NamedTuple):
    """Measured state of the slave, sent each tick.

    `verified_free` is the deepest position found without contact; `following` is true while
    the slave executes the master's motion; `energy_J` all that the environment has put into
    the coupling so far; `inadequate` that the model leaves structure in the force. The force is
    without what the rig's own effects add, as far as they are known.
    """

    position: float
    force: float
    contact_id: int
    in_contact: bool
    following: bool = True
    safety_state: int = 0
    fault: int = 0
    verified_free: float = 0.0
    velocity: float = 0.0
    energy_J: float = 0.0
    inadequate: bool = False


class Taken(NamedTuple):
    """Another master has taken the slave over; `peer` holds the name of whose key it used."""

    peer: str


Message = MotionMessage | ModelMessage | StateMessage | Taken


def encode_header(header: Header | tuple[int, int, int, int, int, int]) -> bytes:
    """Return the 44 bytes of a header."""
    return _HEADER.pack(MAGIC, VERSION, *header)


def decode_header(packet: bytes) -> Header:
    """Read the header of a packet; raises MessageError where it is none of this protocol."""
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
        case Taken():
            return _TAKEN.pack(message.peer.encode("ascii"))


def _encode_motion(message: MotionMessage) -> bytes:
    return _MOTION.pack(
        message.target,
        message.velocity,
        message.surface,
        message.force,
        message.energy_J,
        message.contact_id,
        message.engaged,
        message.wall,
        message.provisional,
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
        MODEL_CODES[message.model],
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
    *numbers, _, engaged, wall, provisional = _MOTION.unpack(body)
    _require_finite(*numbers)
    _require_flags(engaged, wall, provisional)
    return read_motion(body)


def read_motion(body: bytes) -> MotionMessage:
    """Read the body of a motion that was found to be in order."""
    numbers = _MOTION.unpack(body)
    target, velocity, surface, force, energy_J, contact_id, engaged, wall, provisional = numbers
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
    first, second, third = shape
    return ModelEffect(code, amplitude, (first, second, third))


def _decode_taken(body: bytes) -> Taken:
    try:
        return Taken(_TAKEN.unpack(body)[0].rstrip(b"\0").decode("ascii"))
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
    Taken: Kind.TAKEN,
}
