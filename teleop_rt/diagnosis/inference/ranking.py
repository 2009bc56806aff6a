"""Ranking of candidates by gain and residual, corrected for encoder errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from teleop_rt.contact.effect import Matrix
from teleop_rt.diagnosis.criteria import (
    SEARCHED_SHAPE_FACTOR,
)
from teleop_rt.diagnosis.inference.ranked import Ranked
from teleop_rt.diagnosis.inference.tones import (
    noise_beside_tone,
    shows_tone_or_air_force,
)
from teleop_rt.diagnosis.inference.unsupported import at_wrong_bound, lacks_named_property
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.encoder import (
    converter_errors,
    errors_without_jumps,
    input_floor,
    within_a_step,
)
from teleop_rt.diagnosis.noise.structure import (
    AirContactNoise,
    LackOfFit,
    air_contact_mismatch,
    air_contact_noise,
    at_bounds,
    lack_of_fit,
    power_in_time,
    tangent_space,
)
from teleop_rt.diagnosis.samples.motion import RecordedMotion

_ENCODER_DRAWS = 3  # draws of the encoder's errors for each candidate; all ten for the likeliest
_FAR_ABOVE_ENCODER = 10.0  # times the encoder errors; smoothing them cannot explain a larger gain
_CLASS_CHI2 = 1000.0  # chi-square from the best fit; no set farther away joins a class


@dataclass(frozen=True)
class Ranking:
    """Ranks fits against the base alone; `errors` are motions with simulated encoder errors.

    `step` is the encoder's [rig unit].
    """

    problem: Problem
    base: Fit
    errors: list[RecordedMotion]
    step: float

    @cached_property
    def rows(self) -> Matrix:
        """The whitened force errors that encoder errors cause through the base."""
        return input_floor(self.problem, self.base, self.errors)

    @cached_property
    def _reading_errors(self) -> Matrix:
        """The same with the mean errors of the steps in which the force is read."""
        steps = converter_errors(self.problem, self.base, len(self.rows))
        return self.rows + self.problem.whitener(steps)

    @cached_property
    def floor(self) -> float:
        """Energy of reading errors in the structure of the base's residual."""
        return self._structure_energy(self._reading_errors, self._base_tangent_space)

    def floor_of(self, fit: Fit) -> float:
        """Return the same energy for a fit: a mass amplifies encoder errors more than a spring."""
        rows = input_floor(self.problem, fit, self.errors[:_ENCODER_DRAWS])
        return self._structure_energy(rows, tangent_space(self.problem, fit))

    def _structure_energy(self, rows: Matrix, own: Matrix) -> float:
        return float(np.max(self.problem.flexible.energy(rows, own)[0]))

    def __call__(self, fit: Fit) -> Ranked:
        """Return the fit with its gain over the base and the structure in its residual."""
        own = tangent_space(self.problem, fit)
        fit = within_a_step(self.problem, fit, self.step, own)
        spared = self._smoothing_gain(fit)
        left = lack_of_fit(self.problem, fit, own)
        chance = self._noise_ratio
        air_mismatch = air_contact_mismatch(self.problem, self.base, fit, chance) if chance else 0.0
        gain, gain_by_bic = self.base.chi2 - fit.chi2, self.base.bic - fit.bic
        bound = np.any(at_bounds(self.problem, fit))
        searched = tangent_space(self.problem, fit, searched=True) if bound else own
        bare, along = (
            bool(lacks_named_property(self.problem, self.base, fit)),
            self._encoder_energy_along(fit, searched),
        )
        separate = shows_tone_or_air_force(self.problem, fit, self.errors[:_ENCODER_DRAWS])
        return Ranked(
            fit,
            gain - spared,
            gain_by_bic - spared,
            left,
            air_mismatch,
            bare,
            at_wrong_bound(self.problem, fit),
            along,
            tone_or_air_force=separate,
            noise_per_direction=self._noise_per_direction(fit, own, left),
        )

    def _noise_per_direction(self, fit: Fit, own: Matrix, left: LackOfFit) -> float:
        """Return the noise energy in each direction that a fit adds.

        Red noise has more energy along slow directions, and a searched shape finds more of it: the
        mean of all directions counts then, at the level of the noise where the effect acts. Beside
        a tone the residual itself shows it, and draws where noise of a resonance leaks through gaps
        as the tone does. `own` is the fit's tangent space.
        """
        if (beside := noise_beside_tone(self.problem, fit)) is not None:
            return max(beside, self._drawn_along(own))
        added = own.shape[1] - self._base_tangent_space.shape[1]
        if added < 1 or any(effect.shapes for effect in fit.model.effects):
            return left.noise_per_direction * self._louder_along(own)
        return self._drawn_along(own)

    def _drawn_along(self, own: Matrix) -> float:
        """Return the mean energy of draws of noise in each added direction; at least 1."""
        noise, base = self.problem.flexible.noise, self._base_tangent_space
        added = max(own.shape[1] - base.shape[1], 1)
        energy = np.sum((noise @ own) ** 2) - np.sum((noise @ base) ** 2)
        return float(max(energy / (added * len(noise)), 1.0))

    def _louder_along(self, own: Matrix) -> float:
        """Return the power of the noise along the added directions, over that of all; at least 1.

        `own` is the tangent space of a fit, of which the base's is no part.
        """
        level = self.problem.whitener.level
        base = self._base_tangent_space
        added = own - base @ (base.T @ own)
        if np.all(level == 1.0) or not np.any(added):  # a fit without an amplitude adds none
            return 1.0
        along, usual = (
            np.average(level**2, weights=sum(power_in_time(self.problem, row) for row in rows.T))
            for rows in (added, self.problem.flexible.directions)
        )
        return max(float(along / usual), 1.0)

    def with_errors(self, ranked: list[Ranked], least: float) -> list[Ranked]:
        """Return the fits; those near the best chi-square get their `encoder_misfits`."""

        def near(one: Ranked) -> bool:
            return one.fit.chi2 < least + _CLASS_CHI2 + _FAR_ABOVE_ENCODER * self.floor

        return [
            replace(r, encoder_misfits=self._encoder_misfits(r.fit)) if near(r) else r
            for r in ranked
        ]

    def _encoder_misfits(self, fit: Fit) -> tuple[float, ...]:
        """Return the energies of encoder errors outside a fit's tangent space, one per draw."""
        rows = errors_without_jumps(self.problem, fit, self.errors)
        own = tangent_space(self.problem, fit)
        return tuple(np.sum(rows**2, axis=1) - np.sum((rows @ own) ** 2, axis=1))

    def _encoder_energy_along(self, fit: Fit, own: Matrix) -> float:
        """Return the energy of the encoder errors in the directions that the fit adds to the base.

        `own` is the fit's tangent space with all searched parameters. The search of a shape fits
        more of these errors than its derivatives at the optimum show (`SEARCHED_SHAPE_FACTOR`).
        """
        by_fit = self._reading_errors @ own
        by_base = self._reading_errors @ self._base_tangent_space
        added = float(np.max(np.sum(by_fit**2, axis=1) - np.sum(by_base**2, axis=1)))
        searched = any(effect.shapes for effect in fit.model.effects)
        return max(added, 0.0) * (SEARCHED_SHAPE_FACTOR if searched else 1.0)

    @cached_property
    def _noise_ratio(self) -> AirContactNoise | None:
        if not self.base.model.base.touches:
            return None
        return air_contact_noise(self.problem, self.rows, self.problem.flexible.noise)

    @cached_property
    def _base_tangent_space(self) -> Matrix:
        return tangent_space(self.problem, self.base)

    def _smoothing_gain(self, fit: Fit) -> float:
        """Return the part of a fit's gain that comes from smoothing the encoder errors.

        A model that delays the position also smooths it, which is no evidence for its effect. The
        result is 0 without a computation if the gain is far above all encoder errors.
        """
        if self.base.chi2 - fit.chi2 > _FAR_ABOVE_ENCODER * self._encoder_energy_of_base:
            return 0.0
        rows = errors_without_jumps(self.problem, fit, self.errors[:_ENCODER_DRAWS])
        return max(self._encoder_energy_of_base - float(np.mean(np.sum(rows**2, axis=1))), 0.0)

    @cached_property
    def _encoder_energy_of_base(self) -> float:
        """Energy of encoder errors through the base, without jumps at the surface."""
        rows = errors_without_jumps(self.problem, self.base, self.errors[:_ENCODER_DRAWS])
        return float(np.mean(np.sum(rows**2, axis=1)))


def weighed_errors(
    rank: Ranking, singles: list[Ranked], sets: list[Ranked]
) -> tuple[list[Ranked], list[Ranked]]:
    """Return single effects and sets; those near the best get their `encoder_misfits`."""
    least = min((r.fit.chi2 for r in [*singles, *sets]), default=0.0)
    return rank.with_errors(singles, least), rank.with_errors(sets, least)
