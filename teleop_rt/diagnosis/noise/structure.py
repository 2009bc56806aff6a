"""Lack of fit of a model: the structure in its residual, by the flexible description."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import bounds
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.noise import whiten
from teleop_rt.diagnosis.noise.level import level_of
from teleop_rt.diagnosis.noise.saturated import orthonormal
from teleop_rt.diagnosis.noise.whiten import Whitener

FREE_AIR = 0.05  # of the samples; less free air does not show the noise
_NEAR_SURFACE = 0.1  # of the travel, within which a sample counts neither as air nor as contact
_AT_BOUND = 1e-6  # of a parameter's range
_EVEN_LOG_RATIO = float(np.log(1.2))  # of powers in contact and in air; less is no difference
_CHANCE_SIGMAS = 3.0  # standard deviations of that ratio, or of encoder errors, by chance


@dataclass(frozen=True)
class LackOfFit:
    """Energy of the residual in the flexible description, above that of the noise.

    `noise_per_direction` is the energy of the noise in each of the `rank` directions, `scatter` the
    deviation of its energy in all of them.
    """

    excess: float
    rank: int
    doubt: float = 0.0
    noise_per_direction: float = 1.0
    scatter: float = 0.0

    @property
    def deviation(self) -> float:
        """Standard deviation of the excess where nothing is missing.

        It combines chance and the relative uncertainty (`doubt`) of the subtracted noise.
        """
        rank = max(self.rank, 1)
        by_chance = max(self.noise_per_direction * float(np.sqrt(2.0 * rank)), self.scatter)
        return float(np.hypot(by_chance, self.noise_per_direction * self.doubt * rank))


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
        low, high = bounds(coordinate.shape, problem.motion.scales)
        step = 1e-3 * (high - low)
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
    return LackOfFit(
        inside - expected,
        rank,
        _doubt(problem.whitener),
        expected / max(rank, 1),
        float(np.std(by_chance)),
    )


@dataclass(frozen=True)
class AirContactNoise:
    """Samples in contact and in free air, and the statistics of noise alone in both.

    `air` and `touch` are the samples; `typical` and `scatter` are mean and standard deviation of
    the logarithm of the sensor noise's power in contact over that in free air, `errors` and
    `errors_scatter` those of the power [force^2] that the errors of encoder and converter have in
    contact; `steady` is the largest power of the converter's in free air, where they are always the
    same.
    """

    air: NDArray[np.bool_]
    touch: NDArray[np.bool_]
    typical: float
    scatter: float
    errors: float
    errors_scatter: float
    steady: float


def air_and_contact(problem: Problem) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which of the samples in use are surely in free air, and which in contact."""
    used, x = problem.whitener.mask > 0.0, problem.motion.x
    margin = _NEAR_SURFACE * problem.motion.scales["travel"]
    return used & (x < -margin), used & (x > margin)


def pressed_all_along(problem: Problem) -> bool:
    """Return whether too few samples are in free air to show the forces there."""
    air, _ = air_and_contact(problem)
    return bool(np.count_nonzero(air) < FREE_AIR * air.size)


def louder_in_contact(problem: Problem) -> float:
    """Return the power of the noise in contact over that in free air, at least 1.

    It is larger where the noise grows with the force.
    """
    air, touch = (np.mean(problem.whitener.level[one] ** 2) for one in air_and_contact(problem))
    return max(float(touch / air), 1.0)


def air_contact_noise(problem: Problem, floor: Matrix, noise: Matrix) -> AirContactNoise | None:
    """Return the statistics of the difference between contact and free air by chance.

    `noise` are whitened draws of the noise, of which the sensor's is at its `level` in both; errors
    of the encoder (`floor`, see `input_floor`) are felt in contact, and so are those of the steps
    in which a force is read that in the air is always the same. Of slow noise a stretch of free air
    holds few independent values, so the ratio is drawn. None without enough free air.
    """
    whitener = problem.whitener
    air, touch = air_and_contact(problem)
    if min(np.count_nonzero(air), np.count_nonzero(touch)) < FREE_AIR * air.size:
        return None
    sensor = np.tile(np.sqrt(np.maximum(1.0 - whitener.known / whitener.density, 1e-6)), 2)
    drawn = [power_in_time(problem, row * sensor) for row in noise]
    ratios = [float(np.log(np.mean(row[touch]) / np.mean(row[air]))) for row in drawn]
    errors = [float(np.mean(power_in_time(problem, row)[touch])) for row in floor]
    by_steps = problem.force_step**2 / 12.0
    return AirContactNoise(
        air,
        touch,
        float(np.mean(ratios)),
        float(np.std(ratios)),
        float(np.mean(errors)) + by_steps,
        float(np.std(errors)),
        3.0 * by_steps,
    )


def air_contact_mismatch(problem: Problem, base: Fit, fit: Fit, chance: AirContactNoise) -> float:
    """Return the excess difference between contact and free air, as a share of the base's residual.

    A difference above chance is structure, even if the flexible description misses it and the noise
    model absorbs it as coloured noise. An increase of the residual in one of the two also counts.
    """
    left, first = power_in_time(problem, fit.residual), power_in_time(problem, base.residual)
    whole = float(np.sum(first))
    air, touch = chance.air, chance.touch
    # An effect that improves contact must not increase the residual in free air, and vice versa.
    spoilt = max(float(np.sum((left - first)[where])) / whole for where in (air, touch))
    in_air, in_touch = float(np.mean(left[air])), float(np.mean(left[touch]))
    beyond = in_air - chance.steady
    typical, most = (
        np.exp(chance.typical),
        np.exp(_EVEN_LOG_RATIO + _CHANCE_SIGMAS * chance.scatter),
    )
    extra = 0.0
    if in_touch - chance.errors - _CHANCE_SIGMAS * chance.errors_scatter > typical * most * in_air:
        extra = (in_touch - chance.errors - typical * in_air) * np.count_nonzero(touch)
    elif typical * beyond > most * in_touch:
        extra = (beyond - in_touch / typical) * np.count_nonzero(air)
    return max(float(extra) / whole, spoilt, 0.0)


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
    found = whiten.estimate(whiten.Left(left, taken), whole, problem.whitener, problem.motion.dt)
    clean = fit.force_on(problem.motion)
    growing = np.array([clean, problem.motion.v])
    return replace(found, level=level_of(problem.force - clean, growing, found.mask > 0.0))
