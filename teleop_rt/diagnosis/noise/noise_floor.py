"""The noise floor: the error of a perfect model, from force noise and encoder errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.encoder import input_errors, input_floor, knowing_encoder
from teleop_rt.diagnosis.noise.structure import (
    air_and_contact,
    louder_in_contact,
    noise_from,
    pressed_all_along,
)
from teleop_rt.diagnosis.noise.whiten import power_of
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.recordings.recording import Recording
from teleop_rt.recordings.rows import force_noise, robust_deviation

_QUICK_S = 0.1  # s; slower forces in free air may be those of an effect
_STILL = 0.1  # of the motion's time scale, in which the force of a law changes by little
_FAST_OF_PINK = 1.29  # the integral of (2 sin(pi u))^6 / (20 u) up to u = 1/2
_LARGEST_SLOW_NOISE = 0.05  # of the force's deviation; no sensor or amplifier drifts by more


def with_own_noise(problem: Problem, fit: Fit, recording: Recording) -> tuple[Problem, Matrix]:
    """Return the problem of another recording with its noise, and its encoder's errors.

    Both are estimated from the residual of `fit` there, with its linear parameters fitted again.
    """
    errors = input_errors(problem.motion, recording)
    problem = knowing_encoder(problem, fit, errors)
    for _ in range(2):
        again = problem.solve(fit.model, fit.zeta, fit.theta)
        whitener = noise_from(problem, again)
        problem = replace(problem, whitener=whitener)
    return problem, input_floor(problem, fit, errors)


@dataclass(frozen=True)
class NoiseLevels:
    """Deviations [rig's force] that noise may have beside a fit.

    `floor` are the whitened force errors of the encoder (see `input_floor`), which act `where` the
    error counts.
    """

    problem: Problem
    fit: Fit
    floor: Matrix
    where: Vector

    @cached_property
    def fast(self) -> float:
        """That of the force's fastest noise, and of the encoder's errors.

        A larger residual is slow noise or an unknown law.
        """
        step = self.problem.force_step
        fastest = force_noise(self.problem.force, step) ** 2
        return float(np.sqrt(max(fastest, step**2 / 12.0) + self._encoder))

    @cached_property
    def quick(self) -> float:
        """That of noise that changes faster than the motion.

        It is the change of the residual while the motion changes by `_STILL`, and at least the
        `fast` noise. An amplifier's noise is weaker there than at slightly lower frequencies.
        """
        used = (self.where > 0.0) & (self.problem.whitener.mask > 0.0)
        return max(self.fast, self._changes(used, _STILL * _time_scale(self.problem.motion)))

    @cached_property
    def in_air(self) -> float:
        """That of the noise that free air shows; 0 without free air.

        The part of the residual there that changes within `_QUICK_S` is noise of any colour, and
        so is 1/f noise with the fast noise of this force. The rest may be an effect, such as a
        friction.
        """
        air = float(np.sqrt(_in_free_air(self.problem, self.fit)))
        if not np.isfinite(air):
            return 0.0
        quick = self._changes(air_and_contact(self.problem)[0], _QUICK_S)
        louder = float(np.sqrt(louder_in_contact(self.problem)))
        return min(air, max(_pink_noise(self.problem), quick * louder))

    @property
    def known(self) -> float:
        """That which the fastest differences or free air show to be noise."""
        return max(self.fast, self.in_air)

    @property
    def lawless(self) -> float:
        """That of noise that no law of the motion can cause: it is quick, or free air shows it."""
        return max(self.quick, self.in_air)

    def bounded(self, known: float) -> float:
        """Return the largest deviation that noise may have in this recording.

        A model of slow noise may absorb a slow effect. Its estimate is therefore bounded by
        `_LARGEST_SLOW_NOISE` or the `known` deviation, whichever is larger.
        """
        slow = _LARGEST_SLOW_NOISE * float(np.std(self.problem.force[self.where > 0.0]))
        return min(max(slow, known), self.perfect((self.fit,)))

    def perfect(self, in_air: Sequence[Fit] = ()) -> float:
        """Return the deviation of a perfect model's residual.

        Below the band's edge the noise is that of the whitener: white, coloured or 1/f, without
        structure. Above it, the whole residual is noise. If the model does not explain the force,
        both may contain structure; the noise is therefore bounded by the smallest residual of the
        fits `in_air`, where a material has no force.
        """
        whitener = self.problem.whitener
        size, weight = self.problem.force.size, max(float(np.sum(whitener.mask**2)), 1.0)
        rest = np.fft.rfft(self._rest * whitener.mask)
        above = 2.0 * float(np.sum(np.abs(rest[whitener.bins :]) ** 2))
        below = 2.0 * float(np.sum(whitener.density - whitener.known))
        noise = above / (size * weight) + below / size**2
        noise = min([noise, *(_in_free_air(self.problem, each) for each in in_air)])
        return float(np.sqrt(noise + self._encoder))

    @cached_property
    def _rest(self) -> Vector:
        return self.problem.residual(self.fit)

    @cached_property
    def _encoder(self) -> float:
        """Mean square of the encoder's errors before whitening, over both signs of frequency."""
        energy = float(np.mean(power_of(self.floor) @ self.problem.whitener.density))
        return energy / max(float(np.mean(self.where)), 1e-9) / self.problem.force.size**2

    def _changes(self, used: NDArray[np.bool_], within: float) -> float:
        """Return the deviation of the residual's changes `within` a time, of the `used` samples.

        Medians of its differences at several distances [s] leave out rare jumps, as at reversals.
        """
        rest, longest = self._rest, int(within / self.problem.motion.dt)
        lags = 2 ** np.arange(longest.bit_length())  # none if not even one sample lies within it
        pairs = ((used[lag:] & used[:-lag], rest[lag:] - rest[:-lag]) for lag in lags.tolist())
        changes = [robust_deviation(change[both]) for both, change in pairs if np.any(both)]
        return max(changes, default=0.0) / float(np.sqrt(2.0))


def _time_scale(motion: RecordedMotion) -> float:
    """Return the time [s] in which the motion, or its speed, changes by its own deviation."""
    x, v, a = (float(np.std(row)) for row in (motion.x, motion.v, motion.a))
    return min(x / v, v / a) if min(v, a) > 0.0 else 0.0


def _pink_noise(problem: Problem) -> float:
    """Return the deviation [rig's force] of 1/f noise with the fast noise of this force.

    Of a density c/f between 1/T and half the rate, the variance of n samples is c log(n/2), and
    their third differences show `_FAST_OF_PINK` c.
    """
    octaves = np.log(max(problem.force.size / 2.0, 2.0)) / _FAST_OF_PINK
    return float(force_noise(problem.force, problem.force_step) * np.sqrt(octaves))


def _in_free_air(problem: Problem, fit: Fit) -> float:
    """Return the mean square of the noise in contact that free air shows; infinite without it.

    It is that of the model's residual in free air, times the ratio of its levels, and at least the
    quantisation error of the force, which may be constant in free air.
    """
    if not fit.model.base.touches or pressed_all_along(problem):
        return float(np.inf)
    left = problem.mean_square(fit, air_and_contact(problem)[0])
    return max(left * louder_in_contact(problem), problem.force_step**2 / 12.0)
