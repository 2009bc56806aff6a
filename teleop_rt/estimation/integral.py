"""The integral error criterion (3.14): least squares by the normal matrix, with a test of it."""

from __future__ import annotations

import math

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation.layout import (
    COUNT,
    COVARIANCE,
    ERROR,
    FORGETTING,
    GAIN,
    GRADIENT,
    MAX_PARAMETERS,
    PROPAGATED,
    PSI,
    READY,
    SCRATCH,
    SENSITIVITY,
    THETA,
)
from teleop_rt.estimation.solvers import propagate_noise
from teleop_rt.kernels.jit import inlined_kernel, kernel

LARGEST_INFORMATION = 1e15
"""Trace of the information matrix at which it is scaled down, before numbers overflow."""
LEAST_PIVOT = 1e-12
"""Scaled pivot below which the matrix is singular in double precision."""
LEAST_INFORMATION = 1e-100
"""Diagonal below which a parameter is not excited at all."""


@kernel
def factorise(S: Vector, n: int) -> bool:
    """Put the Cholesky factor of the normal matrix, scaled to unit diagonal, in GRADIENT.

    Its diagonal is kept inverted, and the scale in SCRATCH.

    Returns false when a scaled pivot falls below LEAST_PIVOT: the conditioning test that (3.14)
    needs, singular as it is at t0.
    """
    R, C, scale = COVARIANCE, GRADIENT, SCRATCH
    for i in range(n):
        if not S[R + i * MAX_PARAMETERS + i] > LEAST_INFORMATION:
            return False
        S[scale + i] = 1.0 / math.sqrt(S[R + i * MAX_PARAMETERS + i])
        for j in range(i + 1):
            total = S[R + i * MAX_PARAMETERS + j] * S[scale + i] * S[scale + j]
            for k in range(j):
                total -= S[C + i * MAX_PARAMETERS + k] * S[C + j * MAX_PARAMETERS + k]
            if j < i:
                S[C + i * MAX_PARAMETERS + j] = total * S[C + j * MAX_PARAMETERS + j]
            elif total > LEAST_PIVOT:
                S[C + i * MAX_PARAMETERS + i] = 1.0 / math.sqrt(total)
            else:
                return False
    return True


@kernel
def invert_factor(S: Vector, n: int) -> None:
    """Turn the factor in GRADIENT into the inverse of the normal matrix, in place."""
    C, scale = GRADIENT, SCRATCH
    for i in range(n):
        for j in range(i):
            total = 0.0
            for k in range(j, i):
                total -= S[C + i * MAX_PARAMETERS + k] * S[C + k * MAX_PARAMETERS + j]
            S[C + i * MAX_PARAMETERS + j] = total * S[C + i * MAX_PARAMETERS + i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += S[C + k * MAX_PARAMETERS + i] * S[C + k * MAX_PARAMETERS + j]
            S[C + j * MAX_PARAMETERS + i] = total * S[scale + i] * S[scale + j]
    for i in range(n):
        for j in range(i):
            S[C + i * MAX_PARAMETERS + j] = S[C + j * MAX_PARAMETERS + i]


@kernel
def accumulate(S: Vector, phi: Vector, y: float, lever: float, forgetting: float, n: int) -> None:
    """Add a sample to the normal matrix (COVARIANCE) and right-hand side (PSI), bounded.

    SENSITIVITY is the right-hand side that an offset in y alone would make.
    """
    trace = 0.0
    for i in range(n):
        for j in range(i + 1):
            value = forgetting * S[COVARIANCE + i * MAX_PARAMETERS + j] + phi[i] * phi[j]
            S[COVARIANCE + i * MAX_PARAMETERS + j] = value
            S[COVARIANCE + j * MAX_PARAMETERS + i] = value
        S[PSI + i] = forgetting * S[PSI + i] + phi[i] * y
        S[SENSITIVITY + i] = forgetting * S[SENSITIVITY + i] + phi[i] * lever
        trace += S[COVARIANCE + i * MAX_PARAMETERS + i]
    if trace > LARGEST_INFORMATION:
        for i in range(MAX_PARAMETERS * MAX_PARAMETERS):
            S[COVARIANCE + i] *= 0.5
        for i in range(n):
            S[PSI + i] *= 0.5
            S[SENSITIVITY + i] *= 0.5


@inlined_kernel
def integral_step(S: Vector, W: Vector, phi: Vector, y: float, lever: float, n: int) -> bool:
    """Advance the integral error criterion (3.14) by one sample, forgetting where asked.

    theta changes only when the normal matrix passes its conditioning test; returns whether.
    """
    e = y
    for i in range(n):
        e -= phi[i] * S[THETA + i]
    S[ERROR] = e
    accumulate(S, phi, y, lever, W[FORGETTING], n)
    if not factorise(S, n):
        S[READY] = 0.0
        return False
    invert_factor(S, n)
    for i in range(n):
        total = 0.0
        gain = 0.0
        for j in range(n):
            total += S[GRADIENT + i * MAX_PARAMETERS + j] * S[PSI + j]
            gain += S[GRADIENT + i * MAX_PARAMETERS + j] * phi[j]
        S[THETA + i] = total
        S[GAIN + i] = gain
    if W[FORGETTING] < 1.0:
        if S[COUNT] == 0.0:
            for i in range(MAX_PARAMETERS * MAX_PARAMETERS):
                S[PROPAGATED + i] = S[GRADIENT + i]
        else:
            propagate_noise(S, phi, n)
    return True
