"""The recursive solvers of chapter 3 as kernels on one row S of packed state (`layout.py`).

All solve y = phi^T theta for the n parameters in use, and see nothing but phi and y.
"""

from __future__ import annotations

import math

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation.layout import (
    ALPHA,
    BETA,
    CEILING,
    COVARIANCE,
    DELTA,
    DELTA_START,
    ERROR,
    FORGETTING,
    GAIN,
    GAMMA,
    GN_VFF_RLS,
    GRADIENT,
    GRADIENT_RESTARTS,
    LAMBDA,
    LAMBDA_MAX,
    LAMBDA_MIN,
    MAX_PARAMETERS,
    MEAN_SQUARE,
    NI_SPRLS,
    NOISE_VARIANCE,
    ONE_SIDED,
    PRIOR,
    PROPAGATED,
    PSI,
    RHO,
    RLS,
    SCRATCH,
    SENSITIVITY,
    SOLVER,
    SPRLS,
    THETA,
    Whole,
)
from teleop_rt.kernels.jit import inlined_kernel, kernel

LARGEST_GRADIENT = 1e12
"""Magnitude of the gradient by lambda from which it restarts."""
DELTA_FLOOR = 1e-12
"""Least mean square of that gradient: it divides the step."""


@inlined_kernel
def covariance_step(S: Vector, phi: Vector, forgetting: float, ceiling: float, n: int) -> bool:
    """Advance gain (3.3) and P (3.5), given P phi in SCRATCH.

    P is divided by the forgetting factor only while its trace stays below `ceiling`: without that
    bound plain RLS winds up under missing excitation. Returns false when P is no longer positive.
    """
    spread = forgetting
    for i in range(n):
        spread += phi[i] * S[SCRATCH + i]
    trace = 0.0
    healthy = True
    for i in range(n):
        gain = S[SCRATCH + i] / spread
        S[GAIN + i] = gain
        for j in range(i + 1):
            value = S[COVARIANCE + i * MAX_PARAMETERS + j] - gain * S[SCRATCH + j]
            S[COVARIANCE + i * MAX_PARAMETERS + j] = value
            S[COVARIANCE + j * MAX_PARAMETERS + i] = value
        trace += S[COVARIANCE + i * MAX_PARAMETERS + i]
        healthy = healthy and S[COVARIANCE + i * MAX_PARAMETERS + i] > 0.0
    if forgetting < 1.0 and trace < ceiling * forgetting:
        for i in range(n):
            for j in range(n):
                S[COVARIANCE + i * MAX_PARAMETERS + j] /= forgetting
    return healthy and math.isfinite(trace)


@kernel
def perturb(S: Vector, amount: float, ceiling: float, n: int) -> None:
    """Add `amount` to the diagonal of P (3.6), no further than the trace `ceiling`."""
    if not amount > 0.0:
        return
    trace = 0.0
    for i in range(n):
        trace += S[COVARIANCE + i * MAX_PARAMETERS + i]
    added = min(amount, (ceiling - trace) / n)
    if added > 0.0:
        for i in range(n):
            S[COVARIANCE + i * MAX_PARAMETERS + i] += added


@inlined_kernel
def propagate_noise(S: Vector, phi: Vector, n: int) -> None:
    """Advance C = (I - L phi^T) C (I - phi L^T) + L L^T, the effect of unit noise on theta.

    It holds for whatever gain L is in GAIN, so for perturbed and for variable forgetting.
    """
    spread = 1.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += S[PROPAGATED + i * MAX_PARAMETERS + j] * phi[j]
        S[SCRATCH + i] = total
        spread += phi[i] * total
    for i in range(n):
        gain, c = S[GAIN + i], S[SCRATCH + i]
        for j in range(i + 1):
            value = S[PROPAGATED + i * MAX_PARAMETERS + j] - gain * S[SCRATCH + j]
            value += (spread * gain - c) * S[GAIN + j]
            S[PROPAGATED + i * MAX_PARAMETERS + j] = value
            S[PROPAGATED + j * MAX_PARAMETERS + i] = value


@kernel
def forgetting_step(S: Vector, W: Vector, phi: Vector, e: float, n: int) -> float:
    """Advance and return lambda by the Gauss-Newton rule (3.9 to 3.11), clipped to its bounds."""
    g = 0.0
    for i in range(n):
        g += S[PSI + i] * phi[i]
    alpha = W[ALPHA]
    S[DELTA] = max((1.0 - alpha) * S[DELTA] + alpha * g * g, DELTA_FLOOR)
    forgetting = S[LAMBDA] + alpha * g * e / S[DELTA]
    S[LAMBDA] = min(max(forgetting, W[LAMBDA_MIN]), W[LAMBDA_MAX])
    return float(S[LAMBDA])


@kernel
def gradient_step(S: Vector, W: Vector, phi: Vector, e: float, n: int) -> None:
    """Advance M = dP/d lambda (3.12) and psi = d theta/d lambda (3.13, corrected: M phi e).

    M and psi amplify round-off without limit, so they are reset beyond a bound; theta, which
    depends on them only through lambda, is kept.
    """
    forgetting = S[LAMBDA]
    spread = 1.0
    slope = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += S[GRADIENT + i * MAX_PARAMETERS + j] * phi[j]
        S[SCRATCH + i] = total
        spread += phi[i] * total
        slope += phi[i] * S[PSI + i]
    largest = 0.0
    for i in range(n):
        gain, m = S[GAIN + i], S[SCRATCH + i]
        for j in range(i + 1):
            value = S[GRADIENT + i * MAX_PARAMETERS + j] - gain * S[SCRATCH + j]
            value += (spread * gain - m) * S[GAIN + j] - S[COVARIANCE + i * MAX_PARAMETERS + j]
            value /= forgetting
            S[GRADIENT + i * MAX_PARAMETERS + j] = value
            S[GRADIENT + j * MAX_PARAMETERS + i] = value
            largest = max(largest, abs(value))
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += S[GRADIENT + i * MAX_PARAMETERS + j] * phi[j]
        S[PSI + i] += total * e - S[GAIN + i] * slope
        largest = max(largest, abs(S[PSI + i]))
    if not largest < LARGEST_GRADIENT:
        for i in range(MAX_PARAMETERS * MAX_PARAMETERS):
            S[GRADIENT + i] = 0.0
        for i in range(n):
            S[PSI + i] = 0.0
        S[DELTA] = W[DELTA_START]
        S[GRADIENT_RESTARTS] += 1.0


@kernel
def perturbation(S: Vector, W: Vector, e: float) -> float:
    """Return the increase of P's diagonal by a self-perturbing solver (3.6; 3.7 and 3.8).

    Noise-immunised, with the sign of (3.8) corrected; one-sided, it ignores errors below the
    noise, where the report's absolute value perturbs as well.
    """
    if int(W[SOLVER]) == SPRLS:
        return float(W[BETA] * np.rint(W[GAMMA] * e * e))
    S[MEAN_SQUARE] = W[RHO] * S[MEAN_SQUARE] + (1.0 - W[RHO]) * e * e
    excess = S[MEAN_SQUARE] / W[NOISE_VARIANCE] - 1.0
    excess = max(excess, 0.0) if W[ONE_SIDED] > 0.0 else abs(excess)
    return float(W[BETA] * np.rint(W[GAMMA] * excess))


@inlined_kernel
def propagate_offset(S: Vector, phi: Vector, lever: float, n: int) -> None:
    """Advance d theta / d u as theta itself advances: d += L (lever - phi^T d), with L in GAIN."""
    change = lever
    for i in range(n):
        change -= phi[i] * S[SENSITIVITY + i]
    for i in range(n):
        S[SENSITIVITY + i] += S[GAIN + i] * change


@inlined_kernel
def recursive_step(
    S: Vector, W: Vector, phi: Vector, y: float, lever: float, n: int, whole: Whole
) -> bool:
    """Advance one recursive row by one sample (3.2 to 3.13); return whether it is healthy."""
    solver = int(W[SOLVER])
    ceiling = W[CEILING] * W[PRIOR] * n
    e = y
    for i in range(n):
        e -= phi[i] * S[THETA + i]
        total = 0.0
        for j in range(n):
            total += S[COVARIANCE + i * MAX_PARAMETERS + j] * phi[j]
        S[SCRATCH + i] = total
    S[ERROR] = e
    forgetting = S[LAMBDA]
    if whole is not None and solver == GN_VFF_RLS:
        forgetting = forgetting_step(S, W, phi, e, n)
    healthy = covariance_step(S, phi, forgetting, ceiling, n)
    for i in range(n):
        S[THETA + i] += S[GAIN + i] * e
    propagate_offset(S, phi, lever, n)
    if solver == RLS and W[FORGETTING] == 1.0:
        return healthy
    if whole is not None:
        if solver in (SPRLS, NI_SPRLS):
            perturb(S, perturbation(S, W, e), ceiling, n)
        elif solver == GN_VFF_RLS:
            gradient_step(S, W, phi, e, n)
    propagate_noise(S, phi, n)
    return healthy
