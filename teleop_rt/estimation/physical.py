"""A row's estimate in rig units, with standard deviations, written into given arrays.

Standard deviations follow from the delta method; they are not-a-number where unknown.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact import detection
from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import layout
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import state as index
from teleop_rt.kernels.jit import kernel

Matrix = NDArray[np.float64]

NONE = -1
"""Place of a parameter that a model does not have."""


@kernel
def deviation(variance: float) -> float:
    """Return the root of a variance that rounding may have made negative."""
    return 0.0 if variance < 0.0 else math.sqrt(variance)


@kernel
def widening(S: Vector, i: int) -> float:
    """Return the factor on a deviation that accounts for noise coloured by filters."""
    return math.sqrt(S[layout.SCORE_POWER + i] / max(S[layout.INFO_POWER + i], 1e-300))


@kernel
def noise_covariance(S: Vector, n: int, slot: int, out: Matrix) -> bool:
    """Write the covariance (n, n) of theta caused by noise; return whether it is known.

    S is the row's state; `slot` holds the covariance per unit of noise. It is widened per parameter
    by the spread of block sums of scores, which a row has only once it was ready.
    """
    if slot == NONE or S[layout.BLOCKS] < layout.LEAST_SCORE_BLOCKS:
        return False
    for i in range(n):
        for j in range(n):
            out[i, j] = S[slot + i * layout.MAX_PARAMETERS + j] * widening(S, i) * widening(S, j)
            if not math.isfinite(out[i, j]):
                return False
    return True


@kernel
def moved_by_surface(S: Vector, n: int, i: int, integral: bool) -> float:
    """Return d theta_i / d u of a row to an error u that all its samples share.

    That of the integral criterion is its inverse times the sum that it keeps.
    """
    moved: float = S[layout.SENSITIVITY + i]
    if not integral:
        return moved
    moved = 0.0
    for j in range(n):
        moved += S[layout.GRADIENT + i * layout.MAX_PARAMETERS + j] * S[layout.SENSITIVITY + j]
    return moved


@kernel
def deviation_known(state: index.BankState, r: int) -> bool:
    """Return whether the standard deviations of a row's theta by noise are known."""
    slot = int(state.bank_settings[r, layout.VARIANCE_AT])
    return bool(slot != NONE and state.bank[r, layout.BLOCKS] >= layout.LEAST_SCORE_BLOCKS)


@kernel
def surely_positive(state: index.BankState, r: int, i: int, place: int) -> bool:
    """Return whether theta_i is above zero, by two deviations where these are known.

    `place` is that of the stiffness (or exponent), by which a wrong surface moves theta.
    """
    S, W = state.bank[r], state.bank_settings[r]
    if not deviation_known(state, r):
        return bool(S[layout.THETA + i] > 0.0)
    slot = int(W[layout.VARIANCE_AT])
    spread = widening(S, i)
    variance = S[slot + i * layout.MAX_PARAMETERS + i] * spread * spread
    if place != NONE:
        moved = moved_by_surface(S, state.active[r], i, W[layout.SOLVER] == layout.IEC)
        variance += moved * moved * force_variance_by_surface(state, r, place)
    return bool(S[layout.THETA + i] > 2.0 * deviation(variance))


@kernel
def force_variance_by_surface(state: index.BankState, r: int, place: int) -> float:
    """Return the variance of the force that all samples share, by the error of the surface."""
    detector = state.detector
    if detector[detection.SURFACE_KNOWN] == 0.0:
        return 0.0
    stiffness = state.bank[r, layout.THETA + place] / state.settings[index.LENGTH]
    curved = state.codes[r] == row_kinds.HUNT_CROSSLEY
    return float(detection.surface_variance(detector, curved) * stiffness * stiffness)


@kernel
def add_surface_error(
    state: index.BankState, r: int, n: int, place: int, integral: bool, out: Matrix
) -> None:
    """Add the effect of the error of a surface that had to be found: one error for all samples.

    So it does not average out as noise does: it moves theta by its sensitivity, times the stiffness
    (or exponent) that theta holds at `place`.
    """
    S = state.bank[r]
    if place == NONE:
        return
    variance = force_variance_by_surface(state, r, place)
    for i in range(n):
        for j in range(n):
            moved = moved_by_surface(S, n, i, integral) * moved_by_surface(S, n, j, integral)
            out[i, j] += moved * variance


@kernel
def row_covariance(
    state: index.BankState, r: int, slot: int, place: int, integral: bool, out: Matrix
) -> bool:
    """Write the whole covariance of a row's scaled theta; return whether it is known."""
    n = state.active[r]
    if not noise_covariance(state.bank[r], n, slot, out):
        return False
    add_surface_error(state, r, n, place, integral, out)
    return True


@kernel
def linear_values(state: index.BankState, r: int, scales: Vector, values: Vector) -> None:
    """Write a linear row's parameters, with the free offset; not-a-number for those it lacks."""
    values[:] = math.nan
    for i in range(min(state.active[r], len(values))):
        values[i] = state.bank[r, layout.THETA + i] * scales[i]


@kernel
def hunt_crossley(state: index.BankState, r: int) -> tuple[float, float, float]:
    """Return k, b, n of a row's [ln k', b'/k', n] (2.6, x in units of a length)."""
    S = state.bank[r]
    log_k = S[layout.THETA] - S[layout.THETA + 2] * math.log(state.settings[index.LENGTH])
    k = math.exp(min(max(log_k, -700.0), 700.0))
    return k, S[layout.THETA + 1] / state.settings[index.SPEED] * k, S[layout.THETA + 2]


@kernel
def hunt_crossley_values(
    state: index.BankState, r: int, scales: Vector, companion: int, values: Vector
) -> None:
    """Write k, b, n and amplitudes of effects: those of the companion row, times `scales`."""
    values[0], values[1], values[2] = hunt_crossley(state, r)
    for i in range(len(scales)):
        values[3 + i] = state.bank[companion, layout.THETA + 2 + i] * scales[i]


@kernel
def write_linear(
    one: index.StateArray,
    r: int,
    slot: int,
    place: int,
    integral: bool,
    scales: Vector,
    covariance: Matrix,
    values: Vector,
    deviations: Vector,
) -> bool:
    """Write parameters and deviations of a linear row; return whether the deviations are known.

    values, deviations: as long as the row's parameters, with the free offset; a parameter that is
    not estimated is not-a-number. covariance (MAX_PARAMETERS, MAX_PARAMETERS) is room to work in.
    """
    state = one[0]
    linear_values(state, r, scales, values)
    deviations[:] = math.nan
    known = row_covariance(state, r, slot, place, integral, covariance)
    if known:
        for i in range(min(state.active[r], len(values))):
            deviations[i] = deviation(scales[i] * covariance[i, i] * scales[i])
    return known


@kernel
def hunt_crossley_deviations(
    state: index.BankState, covariance: Matrix, values: Vector, deviations: Vector
) -> None:
    """Write the deviations of k, b and n from the covariance of ln k', the ratio b'/k' and n."""
    C, k, b = covariance, values[0], values[1]
    log_length = math.log(state.settings[index.LENGTH])
    by_ratio = k / state.settings[index.SPEED]
    # By ln k' and n alone: d ln k = d ln k' - ln(length) d n.
    of_log_k = C[0, 0] - 2.0 * log_length * C[0, 2] + log_length * log_length * C[2, 2]
    mixed = C[0, 1] - log_length * C[1, 2]
    deviations[0] = deviation(k * k * of_log_k)
    deviations[1] = deviation(
        b * b * of_log_k + 2.0 * b * by_ratio * mixed + by_ratio * by_ratio * C[1, 1]
    )
    deviations[2] = deviation(C[2, 2])


@kernel
def write_hunt_crossley(
    one: index.StateArray,
    r: int,
    slot: int,
    place: int,
    integral: bool,
    scales: Vector,
    companion: int,
    companion_slot: int,
    covariance: Matrix,
    values: Vector,
    deviations: Vector,
) -> bool:
    """Write parameters and deviations of a Hunt-Crossley row; see `write_linear`."""
    state = one[0]
    hunt_crossley_values(state, r, scales, companion, values)
    deviations[:] = math.nan
    known = row_covariance(state, r, slot, place, integral, covariance)
    if known:
        hunt_crossley_deviations(state, covariance, values, deviations)
    if len(scales) == 0:
        return known
    known = (
        noise_covariance(state.bank[companion], state.active[companion], companion_slot, covariance)
        and known
    )
    for i in range(len(scales)):
        deviations[3 + i] = deviation(covariance[2 + i, 2 + i]) * abs(scales[i])
    if not known:
        deviations[:] = math.nan
    return known
