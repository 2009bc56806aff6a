"""The choice of the model to stream: by force error of frozen parameters, with hysteresis."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation.layout import MOST, THETA
from teleop_rt.jit import kernel

Matrix = NDArray[np.float64]
Flags = NDArray[np.uint8]
Counts = NDArray[np.int64]

# Scalars of a row's record; frozen and pending parameters follow.
(
    HAS_PENDING,
    HAS_FROZEN,
    ERROR_POWER,
    SCORED,
    TOTAL_POWER,
    PREDICTED,
    ANCHOR,
    ANCHOR_TIME,
    ANCHORED,
    LIVE_TIME,
) = range(10)
FROZEN = 10
PENDING = FROZEN + MOST
N_RECORD = PENDING + MOST
# The choice itself.
SELECTED, RIVAL, RIVAL_TICKS, N_CHOICE = range(4)

# A rival must be better by this factor in force error for this long [s of contact].
ADVANTAGE = 0.8
DWELL_S = 0.5
SCORE_MEMORY_S = 1.0
LEAST_SCORED_S = 0.2
SETTLING_BAND = 0.02


@kernel
def freeze(record: Vector, S: Vector, n: int) -> None:
    """Pass an excursion's end: pending parameters become the frozen ones that predict.

    So what predicts is always at least one whole excursion or contact old: one-step errors would
    reward fast forgetting. S is the row's state in the bank.
    """
    if record[HAS_PENDING] > 0.0:
        for i in range(n):
            record[FROZEN + i] = record[PENDING + i]
        record[HAS_FROZEN] = 1.0
    for i in range(n):
        record[PENDING + i] = S[THETA + i]
    record[HAS_PENDING] = 1.0


@kernel
def score(record: Vector, error: float, dt: float) -> None:
    """Add one open-loop force error to a row's record."""
    memory = max(1.0 / (record[SCORED] + 1.0), dt / SCORE_MEMORY_S)
    record[ERROR_POWER] += memory * (error * error - record[ERROR_POWER])
    record[TOTAL_POWER] += error * error
    record[SCORED] += 1.0


@kernel
def settle(record: Vector, value: float, band: float, dt: float) -> None:
    """Remember when the leading parameter last left a band about where it is."""
    record[LIVE_TIME] += dt
    if record[ANCHORED] == 0.0 or abs(value - record[ANCHOR]) > band:
        record[ANCHOR] = value
        record[ANCHOR_TIME] = record[LIVE_TIME]
        record[ANCHORED] = 1.0


@kernel
def first_ready(ready: Flags, regressions: Counts) -> int:
    """Return the first direct row that is ready, or -1; algebraic ones count if there are no other.

    Algebraic rows are ready sooner, but their first estimates are the less steady ones.
    """
    any_direct = False
    for r in range(len(ready)):
        if regressions[r] == 0:
            any_direct = True
            if ready[r]:
                return r
    if not any_direct:
        for r in range(len(ready)):
            if ready[r]:
                return r
    return -1


@kernel
def best_scored(records: Matrix, ready: Flags, dt: float) -> int:
    """Return the ready row of least force error among those scored long enough, else -1."""
    best = -1
    for r in range(len(ready)):
        scored = ready[r] and records[r, SCORED] * dt >= LEAST_SCORED_S
        if scored and (best < 0 or records[r, ERROR_POWER] < records[best, ERROR_POWER]):
            best = r
    return best


@kernel
def choose(
    choice: Vector, records: Matrix, ready: Flags, regressions: Counts, noise: float, dt: float
) -> None:
    """Advance the choice by one tick of contact; noise is the force sensor's.

    The first ready row is streamed until rows have scores. Then a rival takes over only after it
    has been better by ADVANTAGE, and by half the noise, for DWELL_S, so that the operator's hand
    never feels it flap, and no model is changed for what no hand could feel.
    """
    selected = int(choice[SELECTED])
    if selected < 0:
        choice[SELECTED] = first_ready(ready, regressions)
        return
    best = best_scored(records, ready, dt)
    if best < 0 or best == selected:
        choice[RIVAL_TICKS] = 0.0
        return
    error = math.sqrt(records[selected, ERROR_POWER])
    rival = math.sqrt(records[best, ERROR_POWER])
    scored = records[selected, SCORED] * dt >= LEAST_SCORED_S
    if scored and ready[selected] and (rival > ADVANTAGE * error or error - rival < 0.5 * noise):
        choice[RIVAL_TICKS] = 0.0
        return
    if int(choice[RIVAL]) != best:
        choice[RIVAL] = best
        choice[RIVAL_TICKS] = 0.0
    choice[RIVAL_TICKS] += 1.0
    if choice[RIVAL_TICKS] * dt >= DWELL_S:
        choice[SELECTED] = best
        choice[RIVAL_TICKS] = 0.0
