"""Ranking of candidates by gain, remainder, and the encoder's share of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.criteria import CERTAIN_BIC, NAMED_SHARE, SEARCHED, SECOND_SHARE
from teleop_rt.diagnosis.inference.pairs import exchanged, fit_without, search_pairs
from teleop_rt.diagnosis.inference.second import both_needed, shows_apart
from teleop_rt.diagnosis.inference.unsupported import lacks_property
from teleop_rt.diagnosis.inference.verdict import Ranked, certain, excess_of, something_left
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.encoder import errors_without_jumps, input_floor, within_a_step
from teleop_rt.diagnosis.noise.structure import (
    Evenness,
    LackOfFit,
    at_bounds,
    evenness,
    lack_of_fit,
    tangent_space,
    uneven_share,
)
from teleop_rt.diagnosis.noise.whiten import Matrix
from teleop_rt.diagnosis.samples.motion import Motion

_DITHERS = 3  # draws of the encoder's errors for each candidate; all ten for the likeliest
_FAR_ABOVE = 10.0  # times what the encoder makes; such a gain owes it nothing
_MOST_PAIRS = 6  # pairs that are ranked, of all fitted
_NEAR = 1000.0  # of chi-square; what is farther from the best is in no class


@dataclass(frozen=True)
class Ranking:
    """Ranks fits against the base alone; `errors` are motions as the encoder could have read them.

    `step` is the encoder's [rig unit].
    """

    problem: Problem
    base: Fit
    errors: list[Motion]
    step: float

    @cached_property
    def rows(self) -> Matrix:
        """The whitened force errors that the base makes of the encoder's."""
        return input_floor(self.problem, self.base, self.errors)

    @cached_property
    def floor(self) -> float:
        """Energy that encoder errors put into the structure that the base leaves."""
        return self._into_structure(self.rows, self._own)

    def floor_of(self, fit: Fit) -> float:
        """Return the same for a fit: a mass makes more of these errors than a spring."""
        rows = input_floor(self.problem, fit, self.errors[:_DITHERS])
        return self._into_structure(rows, tangent_space(self.problem, fit))

    def _into_structure(self, rows: Matrix, own: Matrix) -> float:
        return float(np.max(self.problem.flexible.energy(rows, own)[0]))

    def __call__(self, fit: Fit) -> Ranked:
        """Return the fit with what it gains and leaves."""
        own = tangent_space(self.problem, fit)
        fit = within_a_step(self.problem, fit, self.step, own)
        spared = self._spared(fit)
        left = lack_of_fit(self.problem, fit, own)
        evenly = self._evenness
        uneven = uneven_share(self.problem, self.base, fit, evenly) if evenly else 0.0
        gain, gain_by_bic = self.base.chi2 - fit.chi2, self.base.bic - fit.bic
        bound = np.any(at_bounds(self.problem, fit))
        searched = tangent_space(self.problem, fit, searched=True) if bound else own
        bare, along = lacks_property(self.problem, self.base, fit), self._along(fit, searched)
        passed = self._passed(fit, own) if left.excess > left.deviation else 0.0
        apart = shows_apart(self.problem, fit, self.errors[:_DITHERS])
        return Ranked(fit, gain - spared, gain_by_bic - spared, left, uneven, bare, along, passed,
                      apart=apart, chance=self._chance(fit, own))  # fmt: skip

    def _chance(self, fit: Fit, own: Matrix) -> float | None:
        """Return what noise puts into each direction that a fit adds; None if a shape was searched.

        Of red noise more than elsewhere where it is slow, and what a search finds in it is more.
        `own` is the fit's tangent space.
        """
        added = own.shape[1] - self._own.shape[1]
        if added < 1 or any(effect.shapes for effect in fit.model.effects):
            return None
        noise = self.problem.flexible.noise
        energy = np.sum((noise @ own) ** 2) - np.sum((noise @ self._own) ** 2)
        return float(max(energy / (added * len(noise)), 1.0))

    def _passed(self, fit: Fit, own: Matrix) -> float:
        """Return the energy of what the effects alone make of the encoder's errors.

        What the base makes of them is known, and no merit of an effect that bends its parameters.
        `own` is the fit's tangent space.
        """
        few = self.errors[:_DITHERS]
        plain = replace(fit.model, effects=(), past=False)
        theta, zeta = fit.theta[: len(plain.linear)], fit.zeta[: len(plain.coordinates)]
        alone = replace(fit, model=plain, theta=theta, zeta=zeta)
        rows = errors_without_jumps(self.problem, fit, few)
        rows -= errors_without_jumps(self.problem, alone, few)
        return self._into_structure(rows, own)

    def with_errors(self, ranked: list[Ranked], least: float) -> list[Ranked]:
        """Return the fits, those near the best chi-square with what encoder errors make of them."""

        def near(one: Ranked) -> bool:
            return one.fit.chi2 < least + _NEAR + _FAR_ABOVE * max(one.passed, self.floor)

        return [replace(r, by_encoder=self._beside(r.fit)) if near(r) else r for r in ranked]

    def _beside(self, fit: Fit) -> tuple[float, ...]:
        """Return the energies that encoder errors put beside a fit, one for each draw of them."""
        rows = errors_without_jumps(self.problem, fit, self.errors)
        own = tangent_space(self.problem, fit)
        return tuple(np.sum(rows**2, axis=1) - np.sum((rows @ own) ** 2, axis=1))

    def _along(self, fit: Fit, own: Matrix) -> float:
        """Return the energy of the encoder's errors along what the fit adds to the base.

        `own` is the fit's tangent space, with all that was searched. A shape that is searched finds
        more of them than the slopes at its place show.
        """
        by_fit = self.rows @ own
        by_base = self.rows @ self._own
        added = float(np.max(np.sum(by_fit**2, axis=1) - np.sum(by_base**2, axis=1)))
        searched = any(effect.shapes for effect in fit.model.effects)
        return max(added, 0.0) * (SEARCHED if searched else 1.0)

    @cached_property
    def _evenness(self) -> Evenness | None:
        if not self.base.model.base.touches:
            return None
        return evenness(self.problem, self.rows, self.problem.flexible.noise)

    @cached_property
    def _own(self) -> Matrix:
        return tangent_space(self.problem, self.base)

    def _spared(self, fit: Fit) -> float:
        """Return what of its gain a fit owes to making less force of the encoder's errors.

        A model that reads the position late smooths it, which is no merit of an effect. Not looked
        at where the gain is far above all that the errors make.
        """
        if self.base.chi2 - fit.chi2 > _FAR_ABOVE * self._made_by_base:
            return 0.0
        rows = errors_without_jumps(self.problem, fit, self.errors[:_DITHERS])
        return max(self._made_by_base - float(np.mean(np.sum(rows**2, axis=1))), 0.0)

    @cached_property
    def _made_by_base(self) -> float:
        """Energy that the base makes of the encoder's errors, without jumps."""
        rows = errors_without_jumps(self.problem, self.base, self.errors[:_DITHERS])
        return float(np.mean(np.sum(rows**2, axis=1)))


def needed_pairs(
    rank: Ranking, left: LackOfFit, singles: list[Ranked], effects: tuple[Effect, ...]
) -> tuple[list[Ranked], list[Ranked]]:
    """Search pairs where the best single effect leaves structure; keep those that need both.

    `left` is what the base alone leaves. Returned with the single effects, best first: a pair
    whose second member does nothing is a better descent of the first, and counts as that.
    """
    if not singles or not certain(singles[0], rank.floor):
        return [], singles
    floor = max(rank.floor, rank.floor_of(singles[0].fit))
    if not singles[0].apart and singles[0].uneven <= 1.0 - NAMED_SHARE:
        leftover = max(singles[0].left.excess, singles[0].fit.chi2 - singles[0].fit.effective)
        least = SECOND_SHARE * excess_of(left, singles[0])
        if not something_left(singles[0].left, floor) or leftover < least:
            return [], singles
    ranked = _likeliest_pairs(rank, singles, effects, floor)
    excess = excess_of(left, min([*ranked, *singles], key=lambda r: r.fit.bic))
    known = {r.fit.names[0]: r for r in singles}

    def needed(pair: Ranked) -> bool:
        # Nor where one effect alone does as well, whatever its name.
        alone = min(r.fit.bic for r in known.values())
        better = pair.fit.bic < alone - CERTAIN_BIC
        return better and both_needed(rank.problem, pair, known, excess, floor)

    for pair in filter(needed, ranked):
        _learn_from(rank, pair.fit, known)
    return list(filter(needed, ranked)), sorted(known.values(), key=lambda r: r.fit.bic)


def weighed_errors(
    rank: Ranking, singles: list[Ranked], pairs: list[Ranked]
) -> tuple[list[Ranked], list[Ranked]]:
    """Return single effects and pairs, those near the best with what encoder errors make."""
    least = min((r.fit.chi2 for r in [*singles, *pairs]), default=0.0)
    return rank.with_errors(singles, least), rank.with_errors(pairs, least)


def _likeliest_pairs(
    rank: Ranking,
    singles: list[Ranked],
    effects: tuple[Effect, ...],
    floor: float,
) -> list[Ranked]:
    """Return the likeliest pairs; where the first leaves structure, with other companions too."""
    fits = search_pairs(rank.problem, rank.base, [r.fit for r in singles], effects)
    ranked = [rank(fit) for fit in fits[:_MOST_PAIRS]]
    if not ranked or not something_left(ranked[0].left, floor):
        return ranked
    known = {frozenset(r.fit.names) for r in ranked}
    others = exchanged(rank.problem, ranked[0].fit, effects)
    fresh = [fit for fit in others if frozenset(fit.names) not in known]
    return sorted([*ranked, *map(rank, fresh[:_MOST_PAIRS])], key=lambda r: r.fit.bic)


def _learn_from(rank: Ranking, pair: Fit, known: dict[str, Ranked]) -> None:
    """Put a pair's members alone, descended from where it is, in the place of worse ones."""
    for member, effect in enumerate(pair.model.effects):
        if effect.name in known:
            alone = fit_without(rank.problem, pair, 1 - member)
            if alone.chi2 < known[effect.name].fit.chi2 - CERTAIN_BIC:
                known[effect.name] = rank(alone)
