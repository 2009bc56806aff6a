"""The messages of the link, as named tuples; `codec` turns them into bytes and back.

Positions, velocities and forces are in the rig's units, in the slave's axis coordinates; stamps
are the sender's monotonic nanoseconds.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from teleop_rt.config.trial import ModelId
from teleop_rt.contact.effect import MOST_SHAPES

MOST_EFFECTS = 2
"""Effects of the environment beside a streamed model."""


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
    found there needs no hold, for the operator feels it already. Without `engaged` the slave is not
    led; `faulted` says that this is so for good, because the operator's device was let go.
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
    faulted: bool = False


class ModelEffect(NamedTuple):
    """An effect of the environment beside a model: which (`fitted.code_of`), how much, its shape.

    Entries of `shape` (MOST_SHAPES,) that the effect does not have are 0.
    """

    code: int
    amplitude: float
    shape: tuple[float, ...] = (0.0,) * MOST_SHAPES


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
    without the force of the rig's own effects, as far as they are known.
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


class TakenOver(NamedTuple):
    """Another master has taken the slave over; `peer` holds the name of whose key it used."""

    peer: str


Message = MotionMessage | ModelMessage | StateMessage | TakenOver
