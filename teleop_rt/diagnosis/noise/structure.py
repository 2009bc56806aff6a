"""Lack of fit of a model: the structure in its residual, by the flexible description."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import bounds
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.noise import whiten
from teleop_rt.diagnosis.noise.saturated import orthonormal
from teleop_rt.diagnosis.noise.whiten import Matrix, Whitener

FREE_AIR = 0.05  # of the samples; less free air does not show the noise
_NEAR_SURFACE = 0.1  # of the travel, within which a sample counts neither as air nor as contact
_AT_BOUND = 1e-6  # of a parameter's range


@dataclass(frozen=True)
class LackOfFit:
    """Energy of the residual in the flexible description, above that of the noise.

    `noise_per_direction` is the energy of the noise in each of the `rank` directions.
    """

    excess: float
    rank: int
    doubt: float = 0.0
    noise_per_direction: float = 1.0

    @property
    def deviation(self) -> float:
        """Standard deviation of the excess where nothing is missing.

        It combines chance and the relative uncertainty (`doubt`) of the subtracted noise.
        """
        rank = max(self.rank, 1)
        return self.noise_per_direction * float(np.hypot(np.sqrt(2.0 * rank), self.doubt * rank))


def _doubt(whitener: Whitener) -> float:
    """Return the relative uncertainty of the noise at low frequency: little if it is white.

    A recording contains few periods of red noise at the frequencies of the motion, so its density
    there is extrapolated. The part due to encoder errors is known.
    """
    lowest = slice(max(3, whitener.bins // 50))
    low = float(np.mean((whitener.density - whitener.known)[lowest]))
    rise = np.log(max(low / float(np.median(whitener.density)), 1.0))
    return float(min(0.02 + 0.1 * rise, 0.35))


def jacobian(problem: Problem, fit: Fit) -> Matrix:
    """Return the derivatives of the whitened prediction: linear, then nonlinear parameters."""
    rows = [fit.columns]
    for i, coordinate in enumerate(fit.model.coordinates):
        scale = problem.motion.scales[coordinate.shape.relative_to]
        step = 1e-3 * (coordinate.shape.upper - coordinate.shape.lower) * scale
        step = min(step, 0.01 * abs(float(fit.zeta[i]))) if fit.zeta[i] != 0.0 else step
        ends = []
        for sign in (1.0, -1.0):
            zeta = fit.zeta.copy()
            zeta[i] += sign * step
            ends.append(force_of(fit.model, problem.motion, zeta, fit.theta))
        rows.append(problem.whitener(((ends[0] - ends[1]) / (2.0 * step))[None, :]))
    return np.concatenate(rows) if rows else fit.columns


def tangent_space(problem: Problem, fit: Fit, *, searched: bool = False) -> Matrix:
    """Return an orthonormal basis (columns) of the changes that the model's parameters allow.

    A parameter at its bound adds no direction, because it cannot go beyond. With `searched` it adds
    one: noise and encoder errors influenced its search.
    """
    slopes = jacobian(problem, fit)[len(fit.model.linear) :]
    if not searched:
        slopes = slopes[~at_bounds(problem, fit)]
    rows = np.concatenate([fit.free_columns, slopes])
    return orthonormal(rows) if rows.size else np.zeros((fit.residual.size, 0))


def at_bounds(problem: Problem, fit: Fit) -> NDArray[np.bool_]:
    """Return which nonlinear parameters lie at a bound, where they are not at an optimum."""
    limits = [bounds(c.shape, problem.motion.scales) for c in fit.model.coordinates]
    low, high = np.array(limits).reshape(-1, 2).T
    near = _AT_BOUND * (high - low)
    return np.asarray((fit.zeta <= low + near) | (fit.zeta >= high - near))


def lack_of_fit(problem: Problem, fit: Fit, own: Matrix) -> LackOfFit:
    """Return the structure in the model's residual, by the flexible description.

    `own` is the fit's tangent space.
    """
    inside, by_chance, rank = problem.flexible.energy_beside_noise(fit.residual, own)
    expected = max(float(np.mean(by_chance)), float(rank))
    return LackOfFit(inside - expected, rank, _doubt(problem.whitener), expected / max(rank, 1))


def air_and_contact(problem: Problem) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which of the samples in use are surely in free air, and which in contact."""
    used, x = problem.whitener.mask > 0.0, problem.motion.x
    margin = _NEAR_SURFACE * problem.motion.scales["travel"]
    return used & (x < -margin), used & (x > margin)


def power_in_time(problem: Problem, row: Vector) -> Vector:
    """Return the squares in time [force^2] of a whitened row."""
    whitener, size = problem.whitener, problem.force.size
    spectrum = np.zeros(size // 2 + 1, dtype=np.complex128)
    coloured = row[: whitener.bins] + 1j * row[whitener.bins :]
    spectrum[: whitener.bins] = coloured * np.sqrt(0.5 * whitener.density)
    spectrum[0] *= np.sqrt(2.0)
    return np.asarray(np.fft.irfft(spectrum, size) ** 2, dtype=np.float64)


def noise_from(problem: Problem, fit: Fit) -> Whitener:
    """Return the whitener of the residual that model and flexible description leave."""
    own = tangent_space(problem, fit)
    left, taken = problem.flexible.beside(fit.residual, own)
    whole = whiten.Left(fit.residual, np.sum(own**2, axis=1))
    return whiten.estimate(whiten.Left(left, taken), whole, problem.whitener, problem.motion.dt)
