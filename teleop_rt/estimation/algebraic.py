"""Algebraic regressions: iterated integrals that need no derivative and no initial condition.

A window is one vector of integrals over [0, t], advanced by trapezoids. Position may be in any
unit: phi is then per that unit.
"""

from __future__ import annotations

from teleop_rt.contact.effect import Vector
from teleop_rt.kernels.jit import kernel

# Integrals of a window: t, then single (J) and double (JJ) integrals of the named integrands.
(
    T,
    J_X,
    J_TX,
    J_T2X,
    J_TF,
    J_T2F,
    JJ_X,
    JJ_TX,
    JJ_T2X,
    JJ_T2F,
    LAST_X,
    LAST_F,
    N_LINEAR,
) = range(13)
# Integrals of an additive term phi: of t phi, of t^2 phi, and of the latter again.
J_TP, J_T2P, JJ_T2P, LAST_P, N_TERM = range(5)
# Integrals of the logarithmic window (Hunt-Crossley).
L_T, L_J_X, L_J_TLX, L_J_TLF, L_LAST_X, L_LAST_LX, L_LAST_LF, N_LOG = range(8)


@kernel
def start_linear(w: Vector, x: float, f: float) -> None:
    """Start a window at the sample x, f."""
    for i in range(N_LINEAR):
        w[i] = 0.0
    w[LAST_X] = x
    w[LAST_F] = f


@kernel
def advance_linear(w: Vector, x: float, f: float, dt: float) -> None:
    """Advance all integrals of a window by one trapezoid of dt [s]."""
    t0 = w[T]
    t1 = t0 + dt
    h = 0.5 * dt
    x0, f0 = w[LAST_X], w[LAST_F]
    j_x = w[J_X] + h * (x0 + x)
    j_tx = w[J_TX] + h * (t0 * x0 + t1 * x)
    j_t2x = w[J_T2X] + h * (t0 * t0 * x0 + t1 * t1 * x)
    j_t2f = w[J_T2F] + h * (t0 * t0 * f0 + t1 * t1 * f)
    w[JJ_X] += h * (w[J_X] + j_x)
    w[JJ_TX] += h * (w[J_TX] + j_tx)
    w[JJ_T2X] += h * (w[J_T2X] + j_t2x)
    w[JJ_T2F] += h * (w[J_T2F] + j_t2f)
    w[J_TF] += h * (t0 * f0 + t1 * f)
    w[J_X], w[J_TX], w[J_T2X], w[J_T2F] = j_x, j_tx, j_t2x, j_t2f
    w[T], w[LAST_X], w[LAST_F] = t1, x, f


@kernel
def start_term(w: Vector, value: float) -> None:
    """Start the integrals of an additive term."""
    w[J_TP] = w[J_T2P] = w[JJ_T2P] = 0.0
    w[LAST_P] = value


@kernel
def advance_term(w: Vector, value: float, t0: float, dt: float) -> None:
    """Advance the integrals of an additive term from t0 by one trapezoid of dt [s]."""
    t1 = t0 + dt
    h = 0.5 * dt
    w[J_TP] += h * (t0 * w[LAST_P] + t1 * value)
    j_t2p = w[J_T2P] + h * (t0 * t0 * w[LAST_P] + t1 * t1 * value)
    w[JJ_T2P] += h * (w[J_T2P] + j_t2p)
    w[J_T2P] = j_t2p
    w[LAST_P] = value


@kernel
def start_log(w: Vector, x: float, lx: float, lf: float) -> None:
    """Start a logarithmic window at penetration x, ln x and ln f."""
    for i in range(N_LOG):
        w[i] = 0.0
    w[L_LAST_X], w[L_LAST_LX], w[L_LAST_LF] = x, lx, lf


@kernel
def advance_log(w: Vector, x: float, lx: float, lf: float, dt: float) -> None:
    """Advance the integrals of a logarithmic window by one trapezoid of dt [s]."""
    t0 = w[L_T]
    t1 = t0 + dt
    h = 0.5 * dt
    w[L_J_X] += h * (w[L_LAST_X] + x)
    w[L_J_TLX] += h * (t0 * w[L_LAST_LX] + t1 * lx)
    w[L_J_TLF] += h * (t0 * w[L_LAST_LF] + t1 * lf)
    w[L_T], w[L_LAST_X], w[L_LAST_LX], w[L_LAST_LF] = t1, x, lx, lf


@kernel
def mass_regression(w: Vector, phi: Vector) -> float:
    """Fill phi for [m] and return y (3.20)."""
    t, x = w[T], w[LAST_X]
    phi[0] = t * t * x - 4.0 * w[J_TX] + 2.0 * w[JJ_X]
    return float(w[JJ_T2F])


@kernel
def kelvin_voigt_regression(w: Vector, phi: Vector) -> float:
    """Fill phi for [k, b] and return y (3.24)."""
    phi[0] = w[J_TX]
    phi[1] = w[T] * w[LAST_X] - w[J_X]
    return float(w[J_TF])


@kernel
def mass_spring_damper_regression(w: Vector, phi: Vector) -> float:
    """Fill phi for [m, k, b] and return y (3.28)."""
    t, x = w[T], w[LAST_X]
    phi[0] = t * t * x - 4.0 * w[J_TX] + 2.0 * w[JJ_X]
    phi[1] = w[JJ_T2X]
    phi[2] = w[J_T2X] - 2.0 * w[JJ_TX]
    return float(w[JJ_T2F])


@kernel
def hunt_crossley_regression(w: Vector, phi: Vector) -> float:
    """Fill phi for [ln k, b/k, n] and return y (3.31)."""
    t = w[L_T]
    phi[0] = 0.5 * t * t
    phi[1] = t * w[L_LAST_X] - w[L_J_X]
    phi[2] = w[L_J_TLX]
    return float(w[L_J_TLF])


@kernel
def constant_regressor(w: Vector, order: int) -> float:
    """Return the regressor of a constant force: of first order t^2/2, of second t^4/12."""
    t = w[T]
    return float(0.5 * t * t if order == 1 else t * t * t * t / 12.0)
