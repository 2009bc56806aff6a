"""Kernels that advance all rows of the bank and keep each of them finite and bounded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation.integral import integral_step
from teleop_rt.estimation.layout import (
    BLOCK,
    BLOCK_COUNT,
    BLOCKS,
    COUNT,
    COVARIANCE,
    CROSSED,
    DELTA,
    DELTA_START,
    ERROR,
    ESTIMATED,
    EXCITATION,
    FORGETTING,
    GN_VFF_RLS,
    GRADIENT,
    GRADIENT_RESTARTS,
    HELD,
    IEC,
    INFO,
    INFO_POWER,
    INTERCEPT,
    LAMBDA,
    LAMBDA_MAX,
    MAX_PARAMETERS,
    PRIOR,
    PROPAGATED,
    PSI,
    READY,
    REJECTED,
    RESTARTED,
    RESTARTS,
    SCORE,
    SCORE_POWER,
    SENSITIVITY,
    SHIFTED,
    SINCE_RESTART,
    SOLVER,
    STATUS,
    THETA,
    WARM_UP,
    WARMING_UP,
    Whole,
)
from teleop_rt.estimation.solvers import recursive_step
from teleop_rt.kernels.jit import inlined_kernel, kernel

Matrix = NDArray[np.float64]
Flags = NDArray[np.uint8]
Counts = NDArray[np.int64]

LARGEST_THETA = 1e9
"""Magnitude of a parameter, scaled, from which an estimate is out of bounds."""
LARGEST_INPUT = 1e12
"""Magnitude of y or Phi from which a sample is no measurement."""
# The memory of the spread of block scores, in blocks, and that of the regressors, in samples.
BLOCK_MEMORY = 0.995
EXCITATION_MEMORY = 4e-3
# Readiness is judged at every so many samples: it changes slowly.
JUDGED_EVERY = 4
# A row is ready once each parameter is known to this share of the noise, times its regressor;
# and no longer when that share has grown out of bounds.
READY_BELOW = 0.05
READY_UNTIL = 10.0
RESTARTED_FOR = 1000.0
"""Samples after a restart for which a row is reported as restarted."""
LEAST_SQUARE = 1e-30
"""Least mean square of an intercept that is divided by: far below any that was excited."""


@kernel
def forget_row(S: Vector, W: Vector, n: int) -> None:
    """Forget the past of a row, and start over from its present theta."""
    restarts, rejected, gradients = S[RESTARTS], S[REJECTED], S[GRADIENT_RESTARTS]
    since = S[SINCE_RESTART]
    for i in range(THETA):
        S[i] = 0.0
    for i in range(PSI, len(S)):
        S[i] = 0.0
    S[RESTARTS], S[REJECTED], S[GRADIENT_RESTARTS] = restarts, rejected, gradients
    S[SINCE_RESTART] = since
    S[LAMBDA] = W[LAMBDA_MAX] if int(W[SOLVER]) == GN_VFF_RLS else W[FORGETTING]
    S[DELTA] = W[DELTA_START]
    if int(W[SOLVER]) != IEC:
        for i in range(n):
            S[COVARIANCE + i * MAX_PARAMETERS + i] = W[PRIOR]
            S[PROPAGATED + i * MAX_PARAMETERS + i] = W[PRIOR]


@kernel
def soften_row(S: Vector, W: Vector, error_power: float, n: int) -> None:
    """Trust a row's past less: it was off by an error of this power, per unit of noise variance.

    The error may act on any one parameter alone, so each variance grows by that case.
    """
    if S[COUNT] == 0.0:
        return
    if int(W[SOLVER]) == IEC:
        share = 1.0 / (1.0 + error_power * S[COUNT])
        for i in range(MAX_PARAMETERS * MAX_PARAMETERS):
            S[COVARIANCE + i] *= share
        for i in range(n):
            S[PSI + i] *= share
            S[SENSITIVITY + i] *= share
        return
    for i in range(n):
        added = min(error_power / max(S[EXCITATION + i], 1e-30), W[PRIOR])
        S[COVARIANCE + i * MAX_PARAMETERS + i] += added
        S[PROPAGATED + i * MAX_PARAMETERS + i] += added


@kernel
def reset_row(S: Vector, W: Vector, n: int) -> None:
    """Forget the past of a row and its theta."""
    for i in range(MAX_PARAMETERS):
        S[THETA + i] = 0.0
    forget_row(S, W, n)


@kernel
def score_step(S: Vector, W: Vector, phi: Vector, n: int) -> None:
    """Gather sums of scores phi e over blocks (batch means).

    The ratio of their spread to that of white noise is the factor by which correlation in time
    widens the standard deviations.
    """
    e = S[ERROR]
    for i in range(n):
        S[SCORE + i] += phi[i] * e
        S[INFO + i] += phi[i] * phi[i]
    S[BLOCK_COUNT] += 1.0
    if S[BLOCK_COUNT] >= W[BLOCK]:
        for i in range(n):
            score = S[SCORE + i]
            S[SCORE_POWER + i] = BLOCK_MEMORY * S[SCORE_POWER + i] + score * score
            S[INFO_POWER + i] = BLOCK_MEMORY * S[INFO_POWER + i] + S[INFO + i]
            S[SCORE + i] = 0.0
            S[INFO + i] = 0.0
        S[BLOCK_COUNT] = 0.0
        S[BLOCKS] += 1.0


@kernel
def unknown_share(S: Vector, W: Vector, variance: int, i: int) -> float:
    """Return the variance of a parameter per unit of noise, times its regressor's mean square.

    The origin of the SHIFTED regressor is arbitrary (for ln x, the unit of x), and a motion far
    from it is as informative: only its part beside the intercept counts, and the intercept with
    its variance in the middle of the data.
    """
    intercept, shifted = int(W[INTERCEPT]), int(W[SHIFTED])
    own = S[variance + i * MAX_PARAMETERS + i]
    if shifted < 0 or i not in (intercept, shifted):
        return float(own * S[EXCITATION + i])
    square = max(S[EXCITATION + intercept], LEAST_SQUARE)
    middle = S[CROSSED] / square
    if i == shifted:
        return float(own * max(S[EXCITATION + i] - middle * S[CROSSED], 0.0))
    own += 2.0 * middle * S[variance + i * MAX_PARAMETERS + shifted]
    own += middle * middle * S[variance + shifted * MAX_PARAMETERS + shifted]
    return float(own * square)


@kernel
def judge_readiness(S: Vector, W: Vector, phi: Vector, variance: int, n: int) -> bool:
    """Decide whether a row may be called estimated; return whether theta is within bounds.

    `variance` is the slot of the matrix whose diagonal is theta's variance per unit of noise.
    """
    bounded = True
    for i in range(n):
        bounded = bounded and abs(S[THETA + i]) < LARGEST_THETA
    if bounded and int(S[COUNT]) % JUDGED_EVERY != 0:
        return True
    memory = max(JUDGED_EVERY / (S[COUNT] + JUDGED_EVERY), EXCITATION_MEMORY)
    for i in range(n):
        S[EXCITATION + i] += memory * (phi[i] * phi[i] - S[EXCITATION + i])
    if W[SHIFTED] >= 0.0:
        product = phi[int(W[SHIFTED])] * phi[int(W[INTERCEPT])]
        S[CROSSED] += memory * (product - S[CROSSED])
    worst = 0.0
    for i in range(n):
        worst = max(worst, unknown_share(S, W, variance, i))
    if S[COUNT] < W[WARM_UP]:
        S[READY] = 0.0
    elif S[READY] > 0.0:
        S[READY] = 1.0 if worst < READY_UNTIL else 0.0
    else:
        S[READY] = 1.0 if worst < READY_BELOW else 0.0
    return bounded


@inlined_kernel
def row_step(
    S: Vector, W: Vector, phi: Vector, y: float, lever: float, n: int, whole: Whole
) -> None:
    """Advance one row by one sample and keep it finite: skip wild input, restart when ill."""
    sound = abs(y) < LARGEST_INPUT
    size = 0.0
    for i in range(n):
        sound = sound and abs(phi[i]) < LARGEST_INPUT
        size += abs(phi[i])
    if not sound:
        S[REJECTED] += 1.0
        return
    if size == 0.0:
        return
    if whole is not None and int(W[SOLVER]) == IEC:
        if not integral_step(S, W, phi, y, lever, n):
            return
        healthy = True
        variance = GRADIENT
    else:
        healthy = recursive_step(S, W, phi, y, lever, n, whole)
        variance = COVARIANCE
    S[COUNT] += 1.0
    S[SINCE_RESTART] += 1.0
    if not (judge_readiness(S, W, phi, variance, n) and healthy):
        S[RESTARTS] += 1.0
        S[SINCE_RESTART] = 0.0
        reset_row(S, W, n)
    elif S[READY] > 0.0:
        score_step(S, W, phi, n)


# Written out for the usual sizes, so that the compiler unrolls the loops over n; a bank that is not
# whole has too few rows to earn their compile time. Each is a kernel of its own, on rows: bank_step
# is compiled for each place where a bank may lie, these only once.
@kernel
def step_of_two(S: Vector, W: Vector, phi: Vector, y: float, lever: float, whole: Whole) -> None:
    """Advance a row of two parameters."""
    row_step(S, W, phi, y, lever, 2, whole)


@kernel
def step_of_three(S: Vector, W: Vector, phi: Vector, y: float, lever: float, whole: Whole) -> None:
    """Advance a row of three parameters."""
    row_step(S, W, phi, y, lever, 3, whole)


@kernel
def step_of_any(
    S: Vector, W: Vector, phi: Vector, y: float, lever: float, n: int, whole: Whole
) -> None:
    """Advance a row of n parameters."""
    row_step(S, W, phi, y, lever, n, whole)


@kernel
def bank_step(
    state: Matrix,
    settings: Matrix,
    active: Counts,
    phi: Matrix,
    y: Vector,
    lever: Vector,
    live: Flags,
    whole: Whole,
) -> None:
    """Advance every live row of the bank by one sample and set every row's status.

    state (rows, ROW_SIZE), settings (rows, N_SETTINGS), active (rows,) parameters in use,
    phi (rows, up to MAX_PARAMETERS), y, live (rows,), and lever (rows,): the change of y by a
    unit of an error that all samples share.
    """
    for r in range(len(y)):
        S = state[r]
        if live[r]:
            n = active[r]
            if whole is not None and n == 2:
                step_of_two(S, settings[r], phi[r], y[r], lever[r], whole)
            elif whole is not None and n == 3:
                step_of_three(S, settings[r], phi[r], y[r], lever[r], whole)
            else:
                step_of_any(S, settings[r], phi[r], y[r], lever[r], n, whole)
        if S[RESTARTS] > 0.0 and S[SINCE_RESTART] < RESTARTED_FOR:
            S[STATUS] = RESTARTED
        elif S[READY] > 0.0:
            S[STATUS] = ESTIMATED if live[r] else HELD
        else:
            S[STATUS] = WARMING_UP
