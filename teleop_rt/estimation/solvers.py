"""The recursive solvers of chapter 3 as kernels on one row of packed state.

A row holds, for N parameters at most: theta (N), psi (N), P (N x N), M (N x N), C (N x N) and
scalars. All solve y = phi^T theta; n <= N parameters are in use. The kernels see only phi and y.
For `iec` the slots are: P the normal matrix, psi its right-hand side, M its inverse.
C is the covariance of theta per unit of noise variance, propagated through whatever gain the
solver uses, so that it holds for perturbed and variable-forgetting rows alike.
"""

from __future__ import annotations

import math

from teleop_rt.contact.effect import Vector
from teleop_rt.jit import kernel

RLS, SPRLS, NI_SPRLS, GN_VFF_RLS, IEC = range(5)

# Columns of the settings of a row.
(
    SOLVER,
    FORGETTING,
    PRIOR,
    CEILING,
    BETA,
    GAMMA,
    NOISE_VARIANCE,
    RHO,
    ALPHA,
    LAMBDA_MIN,
    LAMBDA_MAX,
    DELTA_START,
    BLOCK,
    WARM_UP,
    N_SETTINGS,
) = range(15)

# Scalars at the head of a row's state, before the arrays.
(
    LAMBDA,
    DELTA,
    MEAN_SQUARE,
    COUNT,
    RESTARTS,
    STATUS,
    ERROR,
    READY,
    BLOCK_COUNT,
    BLOCKS,
    REJECTED,
    GRADIENT_RESTARTS,
    N_SCALARS,
) = range(13)

LARGEST_THETA = 1e9
LARGEST_GRADIENT = 1e12
LARGEST_INPUT = 1e12
LARGEST_INFORMATION = 1e15
LEAST_PIVOT = 1e-12
DELTA_FLOOR = 1e-12


@kernel
def covariance_step(
    P: Vector, L: Vector, u: Vector, phi: Vector, forgetting: float, ceiling: float, n: int
) -> bool:
    """Advance P by (3.5) given u = P phi; forget only while the trace stays below `ceiling`.

    Without that bound plain RLS winds up under missing excitation. L receives (3.3).
    Returns false when P has lost its positive diagonal.
    """
    spread = forgetting
    for i in range(n):
        spread += phi[i] * u[i]
    trace = 0.0
    for i in range(n):
        L[i] = u[i] / spread
        for j in range(i + 1):
            value = P[i * n + j] - L[i] * u[j]
            P[i * n + j] = value
            P[j * n + i] = value
        trace += P[i * n + i]
    if forgetting < 1.0 and trace < ceiling * forgetting:
        for i in range(n * n):
            P[i] /= forgetting
    healthy = math.isfinite(trace)
    for i in range(n):
        healthy = healthy and P[i * n + i] > 0.0
    return healthy


@kernel
def perturb(P: Vector, amount: float, ceiling: float, n: int) -> None:
    """Add `amount` to the diagonal of P (3.6), no further than the trace `ceiling`."""
    trace = 0.0
    for i in range(n):
        trace += P[i * n + i]
    room = (ceiling - trace) / n
    added = min(amount, room)
    if added > 0.0:
        for i in range(n):
            P[i * n + i] += added


@kernel
def propagate_noise(C: Vector, L: Vector, phi: Vector, c: Vector, n: int) -> None:
    """Advance C = (I - L phi^T) C (I - phi L^T) + L L^T; c is scratch of n."""
    spread = 1.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += C[i * n + j] * phi[j]
        c[i] = total
        spread += phi[i] * total
    for i in range(n):
        for j in range(i + 1):
            value = C[i * n + j] - L[i] * c[j] - c[i] * L[j] + spread * L[i] * L[j]
            C[i * n + j] = value
            C[j * n + i] = value


@kernel
def gradient_step(
    M: Vector,
    psi: Vector,
    P: Vector,
    L: Vector,
    phi: Vector,
    m: Vector,
    e: float,
    forgetting: float,
    n: int,
) -> bool:
    """Advance M = dP/d lambda (3.12) and psi = d theta/d lambda (3.13, corrected: M phi e).

    P is the new one; m is scratch of n. Returns false when M or psi has left its bounds.
    """
    spread = 1.0
    slope = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += M[i * n + j] * phi[j]
        m[i] = total
        spread += phi[i] * total
        slope += phi[i] * psi[i]
    largest = 0.0
    for i in range(n):
        for j in range(i + 1):
            value = M[i * n + j] - L[i] * m[j] - m[i] * L[j] + spread * L[i] * L[j]
            value = (value - P[i * n + j]) / forgetting
            M[i * n + j] = value
            M[j * n + i] = value
            largest = max(largest, abs(value))
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += M[i * n + j] * phi[j]
        psi[i] = psi[i] - L[i] * slope + total * e
        largest = max(largest, abs(psi[i]))
    return largest < LARGEST_GRADIENT


@kernel
def invert(R: Vector, inverse: Vector, n: int) -> bool:
    """Invert a symmetric positive definite matrix by Cholesky, after scaling it to unit diagonal.

    Returns false, leaving `inverse` undefined, when a scaled pivot falls below LEAST_PIVOT: the
    conditioning test that (3.14) needs near t0.
    """
    for i in range(n):
        if not R[i * n + i] > 0.0:
            return False
    # The lower triangle of `inverse` becomes the Cholesky factor, then its inverse.
    for i in range(n):
        for j in range(i + 1):
            total = R[i * n + j] / math.sqrt(R[i * n + i] * R[j * n + j])
            for k in range(j):
                total -= inverse[i * n + k] * inverse[j * n + k]
            if i == j:
                if not total > LEAST_PIVOT:
                    return False
                inverse[i * n + i] = math.sqrt(total)
            else:
                inverse[i * n + j] = total / inverse[j * n + j]
    for i in range(n):
        inverse[i * n + i] = 1.0 / inverse[i * n + i]
        for j in range(i):
            total = 0.0
            for k in range(j, i):
                total -= inverse[i * n + k] * inverse[k * n + j]
            inverse[i * n + j] = total * inverse[i * n + i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += inverse[k * n + i] * inverse[k * n + j]
            inverse[j * n + i] = total / math.sqrt(R[i * n + i] * R[j * n + j])
    for i in range(n):
        for j in range(i):
            inverse[i * n + j] = inverse[j * n + i]
    return True
