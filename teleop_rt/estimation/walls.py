"""The numbers of a model, laid out for kernels.

A wall is a vector: the model's code, its surface, k, b, n, offset and m, the open-loop error of its
force, the time that its effects see, the surface's velocity, how many amplitudes of effects it has,
and those. A plan (len(wall), N_PLAN) gives the source of each number: a row of
the bank, a place in its theta and a scale, or a constant that is not estimated.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact import detection
from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import layout, selection
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import state as index
from teleop_rt.estimation.physical import NONE, hunt_crossley
from teleop_rt.kernels.jit import kernel

Matrix = NDArray[np.float64]
Plans = NDArray[np.float64]

(
    MODEL,
    SURFACE,
    K,
    B,
    N,
    OFFSET,
    M,
    FORCE_STD,
    TIME,
    SURFACE_VELOCITY,
    COUNT,
    AMPLITUDES,
) = range(12)
NUMBERS = {"k": 0.0, "b": 0.0, "n": 1.0, "offset": 0.0, "m": 0.0}
"""Fields from K on, with their values in a model that lacks them."""
ROW, PLACE, SCALE, DEFAULT, N_PLAN = range(5)


@kernel
def lay_out(state: index.BankState, r: int, plan: Matrix, wall: Vector) -> None:
    """Write the wall of a row as it is estimated now; without a surface it has no effects."""
    known = state.detector[detection.SURFACE_KNOWN] > 0.0 and math.isfinite(
        state.detector[detection.SURFACE]
    )
    wall[MODEL] = state.codes[r]
    wall[SURFACE] = state.detector[detection.SURFACE] if known else state.q[index.SURFACE_USED]
    for i in range(K, min(len(plan), len(wall))):
        row, place = int(plan[i, ROW]), int(plan[i, PLACE])
        if place == NONE or place >= state.active[row]:
            wall[i] = plan[i, DEFAULT]
        else:
            wall[i] = state.bank[row, layout.THETA + place] * plan[i, SCALE]
    if state.codes[r] == row_kinds.HUNT_CROSSLEY:
        wall[K], wall[B], wall[N] = hunt_crossley(state, r)
    wall[FORCE_STD] = math.sqrt(state.records[r, selection.ERROR_POWER])
    wall[TIME] = state.q[index.TIME]
    if not known:
        wall[COUNT] = 0.0
        wall[AMPLITUDES:] = 0.0


@kernel
def write_selected(
    one: index.StateArray, plans: Plans, wall: Vector, shift: float, velocity: float
) -> bool:
    """Write the wall of the selected row: see `lay_out`; return whether one is selected.

    plans (rows, numbers of a wall, N_PLAN). The surface is where it is without its motion, which
    `shift` holds, and moves at `velocity`.
    """
    r = int(one[0].choice[selection.SELECTED])
    if r < 0:
        return False
    lay_out(one[0], r, plans[r], wall)
    wall[SURFACE] -= shift
    wall[SURFACE_VELOCITY] = velocity
    return True
