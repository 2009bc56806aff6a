"""The choice of the model to stream: by force error of frozen parameters, with hysteresis."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation.layout import MAX_PARAMETERS, THETA
from teleop_rt.kernels.jit import kernel

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
    COMPARED,
) = range(7)
FROZEN = 7
"""First column of the frozen parameters in a record; PENDING follows."""
PENDING = FROZEN + MAX_PARAMETERS
N_RECORD = PENDING + MAX_PARAMETERS
# Whether a row may be chosen: not where it is not ready, or its mass or stiffness is not surely
# positive; a mass beside a stiffness need not differ significantly from zero: then it is possible.
# A model of no stiffness, or of an exponent that no law has, the master would refuse.
REFUSED, IMPOSSIBLE, POSSIBLE, IDENTIFIED = range(4)
# The choice itself.
SELECTED, RIVAL, RIVAL_TICKS, N_CHOICE = range(4)

# A rival must be better by this factor in force error for this long [s of contact].
ADVANTAGE = 0.8
DWELL_S = 0.5
# Memory of the compared error, and the least of it before a row may be chosen [s of contact].
SCORE_MEMORY_S = 1.0
LEAST_SCORED_S = 0.2


@kernel
def freeze(record: Vector, S: Vector, n: int) -> None:
    """Pass an excursion's end: pending parameters become the frozen ones that predict.

    So predictions are by parameters at least one whole excursion or contact old: one-step errors
    would reward fast forgetting. S is the row's state in the bank.
    """
    if record[HAS_PENDING] > 0.0:
        for i in range(n):
            record[FROZEN + i] = record[PENDING + i]
        record[HAS_FROZEN] = 1.0
    for i in range(n):
        record[PENDING + i] = S[THETA + i]
    record[HAS_PENDING] = 1.0


@kernel
def score(record: Vector, error: float, compared: bool, dt: float) -> None:
    """Add one open-loop force error to a row's record; `compared` with those of the other rows.

    Errors in free air, where the other rows predict nothing, are not a reason to choose a row.
    """
    record[TOTAL_POWER] += error * error
    record[SCORED] += 1.0
    if compared:
        memory = max(1.0 / (record[COMPARED] + 1.0), dt / SCORE_MEMORY_S)
        record[ERROR_POWER] += memory * (error * error - record[ERROR_POWER])
        record[COMPARED] += 1.0


@kernel
def first_possible(possible: Flags, regressions: Counts) -> int:
    """Return the first possible direct row, or -1; algebraic ones count if there are no other.

    Algebraic rows are ready sooner, but their first estimates are the less steady ones.
    """
    any_direct = False
    for r in range(len(possible)):
        if regressions[r] == 0:
            any_direct = True
            if possible[r] > IMPOSSIBLE:
                return r
    if not any_direct:
        for r in range(len(possible)):
            if possible[r] > IMPOSSIBLE:
                return r
    return -1


@kernel
def best_scored(records: Matrix, possible: Flags, least: int, dt: float) -> int:
    """Return the row of least force error among those scored long enough, else -1.

    Of rows that are possible to at least the level `least`.
    """
    best = -1
    for r in range(len(possible)):
        scored = possible[r] >= least and records[r, COMPARED] * dt >= LEAST_SCORED_S
        if scored and (best < 0 or records[r, ERROR_POWER] < records[best, ERROR_POWER]):
            best = r
    return best


@kernel
def best_to_stream(records: Matrix, possible: Flags, noise: float, dt: float) -> int:
    """Return the row of least force error, an identified one where it predicts as well, else -1."""
    best = best_scored(records, possible, POSSIBLE, dt)
    whole = best_scored(records, possible, IDENTIFIED, dt)
    if best < 0 or whole < 0:
        return best
    least, rival = math.sqrt(records[best, ERROR_POWER]), math.sqrt(records[whole, ERROR_POWER])
    return whole if no_better(least, rival, noise) else best


@kernel
def no_better(error: float, larger: float, noise: float) -> bool:
    """Return whether a force error is no better than a larger one in any way that counts."""
    return error > ADVANTAGE * larger or larger - error < 0.5 * noise


@kernel
def choose(
    choice: Vector, records: Matrix, possible: Flags, regressions: Counts, noise: float, dt: float
) -> None:
    """Advance the choice by one tick of contact; noise is the force sensor's.

    The first possible row is streamed until rows have scores. Then a rival takes over only after it
    has been better by ADVANTAGE, and by half the noise, for DWELL_S, so that the operator
    never feels rapid switching, and no imperceptible gain changes the model. A row without a score,
    because the surface was found again, is not replaced by a row that has one. A model that would
    be refused is left at once: the operator would go on to feel the wall before it.
    """
    selected = int(choice[SELECTED])
    best = best_to_stream(records, possible, noise, dt)
    if selected < 0 or possible[selected] == REFUSED:
        other = best if best >= 0 else first_possible(possible, regressions)
        choice[SELECTED] = other if other >= 0 else selected
        choice[RIVAL_TICKS] = 0.0
        return
    if best < 0 or best == selected:
        choice[RIVAL_TICKS] = 0.0
        return
    error = math.sqrt(records[selected, ERROR_POWER])
    rival = math.sqrt(records[best, ERROR_POWER])
    scored = records[selected, COMPARED] * dt >= LEAST_SCORED_S
    if possible[selected] >= possible[best] and (not scored or no_better(rival, error, noise)):
        choice[RIVAL_TICKS] = 0.0
        return
    if int(choice[RIVAL]) != best:
        choice[RIVAL] = best
        choice[RIVAL_TICKS] = 0.0
    choice[RIVAL_TICKS] += 1.0
    if choice[RIVAL_TICKS] * dt >= DWELL_S:
        choice[SELECTED] = best
        choice[RIVAL_TICKS] = 0.0
