"""Regressions of one row, in scaled units that keep every regressor near one.

Position is counted in units of L, velocity of V, acceleration of A (columns of the cycle's
settings); forces stay in the rig's unit, so errors are forces. `report.py` undoes the scaling.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import rows as rw
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
from teleop_rt.jit import kernel


class Motion(NamedTuple):
    """Filtered signals that belong to one instant, scaled.

    x/L, v/V, a/A, max(v, 0)/V, force, ln(x/L), ln f, and the force that weights logarithms.
    """

    x: float
    v: float
    a: float
    v_in: float
    force: float
    log_x: float
    log_f: float
    weight: float


@kernel
def direct_row(code: int, motion: Motion, phi: Vector) -> float:
    """Fill phi with a model's own regressors and return y (2.1 to 2.3, 2.6, 3.15)."""
    if code == rw.KELVIN_VOIGT:
        phi[0], phi[1] = motion.x, motion.v
    elif code == rw.UNILATERAL:
        phi[0], phi[1] = motion.x, motion.v_in
    elif code == rw.MASS_SPRING_DAMPER:
        phi[0], phi[1], phi[2] = motion.a, motion.x, motion.v
    elif code == rw.MASS:
        phi[0] = motion.a
    elif code == rw.MASS_DAMPER:
        phi[0], phi[1] = motion.a, motion.v
    else:
        phi[0] = motion.weight
        phi[1] = motion.weight * motion.v
        phi[2] = motion.weight * motion.log_x
        return motion.weight * motion.log_f
    return motion.force


@kernel
def algebraic_row(code: int, window: Vector, log_window: Vector, phi: Vector, time: float) -> float:
    """Fill phi with a model's algebraic regressors and return y (3.20, 3.24, 3.28, 3.31).

    The windows hold positions in units of L; `time` is T = L / V [s], and A = V / T.
    """
    if code == rw.HUNT_CROSSLEY:
        t = log_window[L_T]
        phi[0] = 0.5 * t * t
        phi[1] = (t * log_window[L_LAST_X] - log_window[L_J_X]) * time
        phi[2] = log_window[L_J_TLX]
        return float(log_window[L_J_TLF])
    if code == rw.KELVIN_VOIGT:
        y = kelvin_voigt_regression(window, phi)
        phi[1] *= time
        return y
    if code == rw.MASS_SPRING_DAMPER:
        y = mass_spring_damper_regression(window, phi)
        phi[0] *= time * time
        phi[2] *= time
        return y
    y = mass_regression(window, phi)
    phi[0] *= time * time
    return y


@kernel
def model_force(code: int, theta: Vector, motion: Motion) -> float:
    """Return the force that scaled parameters predict for a motion (open loop)."""
    if code == rw.KELVIN_VOIGT:
        return float(theta[0] * motion.x + theta[1] * motion.v)
    if code == rw.UNILATERAL:
        return float(theta[0] * motion.x + theta[1] * motion.v_in)
    if code == rw.MASS_SPRING_DAMPER:
        return float(theta[0] * motion.a + theta[1] * motion.x + theta[2] * motion.v)
    if code == rw.MASS:
        return float(theta[0] * motion.a)
    if code == rw.MASS_DAMPER:
        return float(theta[0] * motion.a + theta[1] * motion.v)
    if motion.x <= 0.0:
        return 0.0
    exponent = theta[0] + theta[2] * math.log(motion.x)
    value = math.exp(min(max(exponent, -50.0), 50.0)) * (1.0 + theta[1] * motion.v)
    return float(max(value, 0.0))
