"""Regressions of one row, in scaled units that keep every regressor near one.

Position is counted in units of L, velocity of V, acceleration of A (columns of the cycle's
settings); forces stay in the rig's unit, so errors are forces. `parameters.py` undoes the scaling.
"""

from __future__ import annotations

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import linear_force, spring_force_of_log, touches
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import state as index
from teleop_rt.estimation.algebraic import (
    L_J_TLF,
    L_J_TLX,
    L_J_X,
    L_LAST_X,
    L_T,
    kelvin_voigt_regression,
    mass_regression,
    mass_spring_damper_regression,
)
from teleop_rt.kernels.jit import kernel


@kernel
def direct_row(code: int, m: Vector, phi: Vector) -> float:
    """Fill phi with a model's own regressors and return y (2.1 to 2.3, 2.6, 3.15).

    m (N_MOTION,) holds the filtered signals of the instant.
    """
    if code == row_kinds.HUNT_CROSSLEY:
        phi[0] = m[index.M_WEIGHT]
        phi[1] = m[index.M_WEIGHT] * m[index.MV]
        phi[2] = m[index.M_WEIGHT] * m[index.M_LOG_X]
        return float(m[index.M_WEIGHT] * m[index.M_LOG_F])
    if code == row_kinds.KELVIN_VOIGT:
        phi[0], phi[1] = m[index.MX], m[index.MV]
    elif code == row_kinds.UNILATERAL:
        phi[0], phi[1] = m[index.MX], m[index.MV_IN]
    elif code == row_kinds.MASS_SPRING_DAMPER:
        phi[0], phi[1], phi[2] = m[index.MA], m[index.MX], m[index.MV]
    else:
        phi[0] = m[index.MA]
        if code == row_kinds.MASS_DAMPER:
            phi[1] = m[index.MV]
        return float(m[index.M_FREE])
    return float(m[index.MF])


@kernel
def by_surface(code: int, m: Vector) -> float:
    """Return the change of `direct_row`'s y by a surface less deep by L, per unit of k, or of n.

    A spring's force grows by k, its logarithm (2.6) by n / x.
    """
    if code == row_kinds.HUNT_CROSSLEY:
        return float(m[index.M_WEIGHT] / max(m[index.MX], 1e-3))
    return 0.0 if code in (row_kinds.MASS, row_kinds.MASS_DAMPER) else 1.0


@kernel
def algebraic_row(code: int, window: Vector, log_window: Vector, phi: Vector, time: float) -> float:
    """Fill phi with a model's algebraic regressors and return y (3.20, 3.24, 3.28, 3.31).

    The windows hold positions in units of L; `time` is T = L / V [s], and A = V / T.
    """
    if code == row_kinds.HUNT_CROSSLEY:
        t = log_window[L_T]
        phi[0] = 0.5 * t * t
        phi[1] = (t * log_window[L_LAST_X] - log_window[L_J_X]) * time
        phi[2] = log_window[L_J_TLX]
        return float(log_window[L_J_TLF])
    if code == row_kinds.KELVIN_VOIGT:
        y = kelvin_voigt_regression(window, phi)
        phi[1] *= time
        return y
    if code == row_kinds.MASS_SPRING_DAMPER:
        y = mass_spring_damper_regression(window, phi)
        phi[0] *= time * time
        phi[2] *= time
        return y
    y = mass_regression(window, phi)
    phi[0] *= time * time
    return y


@kernel
def model_force(code: int, theta: Vector, x: float, v: float, v_in: float, a: float) -> float:
    """Return the force that scaled parameters predict for a scaled motion (open loop).

    v_in is max(v, 0), filtered. Hunt-Crossley never pulls.
    """
    if code == row_kinds.HUNT_CROSSLEY:
        if not touches(x):
            return 0.0
        value = spring_force_of_log(x, theta[0], theta[2]) * (1.0 + theta[1] * v)
        return max(float(value), 0.0)
    if code == row_kinds.MASS_SPRING_DAMPER:
        return float(theta[0] * a + theta[1] * x + theta[2] * v)
    if code == row_kinds.MASS:
        return float(theta[0] * a)
    if code == row_kinds.MASS_DAMPER:
        return float(theta[0] * a + theta[1] * v)
    return linear_force(x, v_in if code == row_kinds.UNILATERAL else v, theta[0], theta[1])
