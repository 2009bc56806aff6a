"""A row's estimate in rig units, all of it by one kernel, from places computed once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import layout
from teleop_rt.estimation import state as index
from teleop_rt.estimation.physical import NONE, write_hunt_crossley, write_linear
from teleop_rt.kernels.jit import kernel

Matrix = NDArray[np.float64]
StoredPlaces = NDArray[np.record]

MOST_NAMES = layout.MAX_PARAMETERS + 1
STAMP, STATUS, FORGETTING_FACTOR, RESTARTS, LEADING = range(5)
"""Columns of a logged estimate before its parameters and their deviations."""


class Places:
    """Where a row's estimate comes from; see `physical` for slot, place and companion.

    An error `lag_s` of the force's lag moves damping by stiffness and mass by damping, wherever
    those are among the names (`k_at`, `b_at`, `m_at`, else NONE); friction left in the force adds
    `friction_k` and `friction_b` to the deviations.
    """

    row: int
    names: int
    linear: int
    slot: int
    place: int
    integral: int
    scaled: int
    scales: Vector
    companion: int
    companion_slot: int
    k_at: int
    b_at: int
    m_at: int
    lag_s: float
    friction_k: float
    friction_b: float


_KINDS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "float": (np.float64, ()),
    "int": (np.int64, ()),
    "Vector": (np.float64, (MOST_NAMES,)),
}
PLACES_TYPE = np.dtype([(name, *_KINDS[kind]) for name, kind in Places.__annotations__.items()])


def new_places(rows: int) -> StoredPlaces:
    """Return zeroed places of so many rows."""
    return np.zeros(rows, np.dtype((np.record, PLACES_TYPE)))


@kernel
def widen(deviations: Vector, at: int, by: float) -> None:
    """Add an error that does not average out to the deviation of a parameter that is there."""
    if at != NONE and by != 0.0:
        deviations[at] = math.hypot(deviations[at], by)


@kernel
def write_estimate(
    one: index.StateArray,
    places: StoredPlaces,
    room: Matrix,
    r: int,
    values: Vector,
    deviations: Vector,
) -> bool:
    """Write a row's values and deviations (names,); return whether the deviations are known.

    Values that are not estimated are NaN. room (MAX_PARAMETERS, MAX_PARAMETERS) is to work in.
    """
    place: Any = places[r]
    scales = place.scales[: place.scaled]
    where = (place.row, place.slot, place.place, place.integral > 0)
    if place.linear > 0:
        known = write_linear(one, *where, scales, room, values, deviations)
    else:
        beside = (place.companion, place.companion_slot)
        known = write_hunt_crossley(one, *where, scales, *beside, room, values, deviations)
    if place.lag_s > 0.0 and place.k_at != NONE:
        widen(deviations, place.b_at, values[place.k_at] * place.lag_s)
    if place.lag_s > 0.0 and place.b_at != NONE:
        widen(deviations, place.m_at, values[place.b_at] * place.lag_s)
    widen(deviations, place.k_at, place.friction_k)
    widen(deviations, place.b_at, place.friction_b)
    return known


@kernel
def write_logged(
    one: index.StateArray,
    places: StoredPlaces,
    room: Matrix,
    row: Vector,
    r: int,
    stamp_ns: int,
) -> None:
    """Write an estimator's current state to the row of a log (LEADING + 2 MOST_NAMES or more,)."""
    names, state = places[r].names, one[0].bank[r]
    row[STAMP], row[STATUS] = stamp_ns, state[layout.STATUS]
    row[FORGETTING_FACTOR], row[RESTARTS] = state[layout.LAMBDA], state[layout.RESTARTS]
    middle = LEADING + names
    write_estimate(one, places, room, r, row[LEADING:middle], row[middle : middle + names])
