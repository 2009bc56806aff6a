"""The choice of the model to stream: by force error of frozen parameters, with hysteresis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation.layout import MOST, THETA
from teleop_rt.jit import kernel

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
def choose(
    choice: Vector, records: NDArray[np.float64], ready: NDArray[np.uint8], dt: float
) -> None:
    """Advance the choice by one tick of contact.

    The first ready row is streamed until rows have scores; then a rival takes over only after it
    has been better by ADVANTAGE for DWELL_S, so the operator's hand never feels it flap.
    """
    rows = len(ready)
    selected = int(choice[SELECTED])
    if selected < 0:
        for r in range(rows):
            if ready[r]:
                choice[SELECTED] = r
                return
        return
    best = -1
    for r in range(rows):
        scored = records[r, SCORED] * dt >= LEAST_SCORED_S and ready[r]
        if scored and (best < 0 or records[r, ERROR_POWER] < records[best, ERROR_POWER]):
            best = r
    if best < 0 or best == selected:
        choice[RIVAL_TICKS] = 0.0
        return
    unscored = records[selected, SCORED] * dt < LEAST_SCORED_S
    limit = ADVANTAGE * ADVANTAGE * records[selected, ERROR_POWER]
    if not unscored and records[best, ERROR_POWER] > limit:
        choice[RIVAL_TICKS] = 0.0
        return
    if int(choice[RIVAL]) != best:
        choice[RIVAL] = best
        choice[RIVAL_TICKS] = 0.0
    choice[RIVAL_TICKS] += 1.0
    if choice[RIVAL_TICKS] * dt >= DWELL_S:
        choice[SELECTED] = best
        choice[RIVAL_TICKS] = 0.0
