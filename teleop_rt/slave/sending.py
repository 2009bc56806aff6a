"""Sending a model, as kernels: the last look, whether a new model would be felt, its message."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.estimation import rows
from teleop_rt.estimation.walls import (
    AMPLITUDES,
    COUNT,
    FORCE_STD,
    MODEL,
    OFFSET,
    SURFACE,
    SURFACE_VELOCITY,
    TIME,
    B,
    K,
    M,
    N,
)
from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.record import record_type
from teleop_rt.link.codec import WIRE_CODES
from teleop_rt.link.messages import MOST_EFFECTS
from teleop_rt.slave.depth import HUNT_CROSSLEY, LINEAR
from teleop_rt.slave.felt import NEW, NO_MODEL, POSITION, SENT, VELOCITY, is_felt

if TYPE_CHECKING:
    from teleop_rt.contact.effect import Vector
    from teleop_rt.link.bodies import StoredModel
    from teleop_rt.slave.record import StoredTick, Tick

Matrix = NDArray[np.float64]

WINDOW = 32
"""Motions remembered, on which two walls are compared."""
MESSAGE, N_WALLS = 2, 3
"""A third wall, beside the new one and the one that the master has now: the one last sent."""
_HUNT_CROSSLEY = rows.HUNT_CROSSLEY
_NO_CODE = 0  # of a model that never goes over the link
_LINK_CODES = np.full(1 + max(rows.MODEL_CODES.values()), _NO_CODE)
for _name, _code in WIRE_CODES.items():
    _LINK_CODES[rows.MODEL_CODES[_name]] = _code


class Sending:
    """Fields of a sender's record: settings, and since when the last message is out."""

    keep_alive_ns: int
    every_tick: int
    noise: float
    noticeable_share: float
    slot: int
    sent_ns: int
    surface_moved_ns: int
    sequence: int
    models_sent: int


_SENDING = record_type(Sending)
StoredSending = NDArray[np.record]
_NAMES = list(Sending.__annotations__)


def place(field: str) -> int:
    """Return where a field is among the words of the record."""
    return _NAMES.index(field)


def new_sending(now_ns: int) -> StoredSending:
    """Return the record (1,) of a sender that has sent nothing until now."""
    stored: StoredSending = np.zeros(1, _SENDING)
    stored["sent_ns"] = stored["surface_moved_ns"] = now_ns
    return stored


def new_walls(room: int) -> Matrix:
    """Return walls (N_WALLS, room) of which none was sent."""
    made = np.zeros((N_WALLS, room))
    made[SENT, MODEL] = made[MESSAGE, MODEL] = NO_MODEL
    return made


@kernel
def note_seen(tick: Tick, seen: Matrix, slot: int, position: float) -> None:
    """Keep position and velocity of a tick; in free air no wall is felt."""
    seen[POSITION, slot] = position if tick.in_contact > 0 else math.nan
    seen[VELOCITY, slot] = tick.velocity


@kernel
def move_sent_surface(sending: Sending, sent: Vector, now_ns: int) -> None:
    """Move the surface of the wall last sent as the master does, to compare it."""
    if sent[SURFACE_VELOCITY] != 0.0:
        sent[SURFACE] += sent[SURFACE_VELOCITY] * ((now_ns - sending.surface_moved_ns) * 1e-9)
    sending.surface_moved_ns = now_ns


@kernel
def look(
    stored: StoredTick,
    stored_sending: StoredSending,
    walls: Matrix,
    seen: Matrix,
    position: float,
    now_ns: int,
    there: bool,
) -> bool:
    """Take in a look at an axis position; return whether the new wall, if `there`, is to be sent.

    walls (N_WALLS, numbers of a wall), seen (N_SEEN, WINDOW): see `is_felt`.
    """
    tick: Any = stored[0]
    sending: Any = stored_sending[0]
    note_seen(tick, seen, sending.slot, position)
    move_sent_surface(sending, walls[SENT], now_ns)
    if not there:
        return False
    if sending.every_tick > 0 or now_ns - sending.sent_ns >= sending.keep_alive_ns:
        return True
    return is_felt(walls, seen, sending.noise, sending.noticeable_share)


@kernel
def replaces(walls: Matrix) -> bool:
    """Put the new wall in the place of the two others; return whether it differs from the message.

    Not-a-number differs from itself.
    """
    other = False
    for i in range(walls.shape[1]):
        other = other or walls[NEW, i] != walls[MESSAGE, i]
        walls[MESSAGE, i] = walls[SENT, i] = walls[NEW, i]
    return other


@kernel
def write_body(tick: Tick, wall: Vector, effects: Matrix, sequence: int, body: Any) -> None:
    """Write the body of a model's message; effects (MOST_EFFECTS, 1 + MOST_SHAPES): code, shape."""
    code = int(wall[MODEL])
    body.model_sequence, body.contact_id = sequence, tick.contact_id
    body.model, body.surface_known = _LINK_CODES[code], tick.surface_known
    body.surface, body.k, body.b, body.n = wall[SURFACE], wall[K], wall[B], wall[N]
    body.m, body.offset, body.force_std = wall[M], wall[OFFSET], wall[FORCE_STD]
    body.time_s, body.surface_velocity = wall[TIME], wall[SURFACE_VELOCITY]
    body.count = min(int(wall[COUNT]), MOST_EFFECTS)
    for i in range(MOST_EFFECTS):
        effect, present = body.effects[i], i < body.count
        effect.code = int(effects[i, 0]) if present else 0
        effect.amplitude = wall[AMPLITUDES + i] if present else 0.0
        for j in range(len(effect.shape)):
            effect.shape[j] = effects[i, 1 + j] if present else 0.0


@kernel
def write_message(
    stored: StoredTick,
    stored_sending: StoredSending,
    walls: Matrix,
    effects: Matrix,
    bodies: StoredModel,
    now_ns: int,
) -> None:
    """Write the new wall's message, and note that it is sent; the tick's depth follows it."""
    tick: Any = stored[0]
    sending: Any = stored_sending[0]
    new = walls[NEW]
    if replaces(walls):
        sending.sequence += 1
    tick.model = HUNT_CROSSLEY if new[MODEL] == _HUNT_CROSSLEY else LINEAR
    tick.model_k, tick.model_b, tick.model_n, tick.model_added = new[K], new[B], new[N], 0.0
    write_body(tick, new, effects, sending.sequence, bodies[0])
    sending.sent_ns = now_ns
    sending.models_sent += 1
