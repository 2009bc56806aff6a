"""What candidates are ranked by: their gain, what they leave, and what the encoder made of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teleop_rt.contact.effect import Effect, Shape
from teleop_rt.diagnosis.fit import Fit, Problem
from teleop_rt.diagnosis.motion import Motion
from teleop_rt.diagnosis.pairs import both_needed, search_pairs
from teleop_rt.diagnosis.structure import (
    Flexible,
    LackOfFit,
    input_floor,
    lack_of_fit,
    tangent_space,
    uneven_share,
    within_a_step,
)
from teleop_rt.diagnosis.verdict import (
    SAME_SHARE,
    SECOND_SHARE,
    Ranked,
    certain,
    excess_of,
    something_left,
)
from teleop_rt.diagnosis.whiten import Matrix

_DITHERS = 3
_FAR_ABOVE = 10.0
_MOST_PAIRS = 6


@dataclass(frozen=True)
class Ranking:
    """Ranks fits against the base alone; `errors` are motions as the encoder could have told them.

    `step` is the encoder's [rig unit].
    """

    problem: Problem
    base: Fit
    flexible: Flexible
    errors: list[Motion]
    step: float

    @cached_property
    def rows(self) -> Matrix:
        """The whitened force errors that the base makes of the encoder's."""
        return input_floor(self.problem, self.base, self.errors)

    @cached_property
    def floor(self) -> float:
        """Energy that encoder errors put into the structure that the base leaves."""
        return self._into_structure(self.base, self.rows)

    def floor_of(self, fit: Fit) -> float:
        """Return the same for a fit: a mass makes more of these errors than a spring."""
        return self._into_structure(fit, input_floor(self.problem, fit, self.errors[:_DITHERS]))

    def _into_structure(self, fit: Fit, rows: Matrix) -> float:
        own = tangent_space(self.problem, fit)
        return float(np.max(self.flexible.energy(rows, own)[0]))

    def __call__(self, fit: Fit) -> Ranked:
        """Return the fit with what it gains and leaves."""
        fit = within_a_step(self.problem, fit, self.step)
        spared = self._spared(fit)
        left = lack_of_fit(self.problem, fit, self.flexible)
        uneven = uneven_share(self.problem, self.base, fit, self.rows)
        gain, gain_by_bic = self.base.chi2 - fit.chi2, self.base.bic - fit.bic
        hollow = self._hollow(fit)
        return Ranked(fit, gain - spared, gain_by_bic - spared, left, uneven, hollow)

    def _hollow(self, fit: Fit) -> bool:
        """Tell whether a shape at its neutral value costs less than what is worth a distinction."""
        for place, coordinate in enumerate(fit.model.coordinates):
            shape = coordinate.shape
            if isinstance(shape, Shape) and shape.neutral is not None:
                zeta = fit.zeta.copy()
                zeta[place] = shape.neutral * self.problem.motion.scales[shape.relative_to]
                lost = self.problem.solve(fit.model, zeta, fit.theta).chi2 - fit.chi2
                if lost < SAME_SHARE * (self.base.chi2 - fit.chi2):
                    return True
        return False

    def _spared(self, fit: Fit) -> float:
        """Return what of its gain a fit owes to making less force of the encoder's errors.

        A model that reads the position late smooths it, which is no merit of an effect. Not looked
        at where the gain is far above all that the errors make.
        """
        passed = float(np.mean(np.sum(self.rows**2, axis=1)))
        if self.base.chi2 - fit.chi2 > _FAR_ABOVE * passed:
            return 0.0
        rows = input_floor(self.problem, fit, self.errors[:_DITHERS])
        return max(passed - float(np.mean(np.sum(rows**2, axis=1))), 0.0)


def needed_pairs(
    rank: Ranking, left: LackOfFit, singles: list[Ranked], effects: tuple[Effect, ...]
) -> list[Ranked]:
    """Search pairs where the best single effect leaves structure; keep those that need both.

    `left` is what the base alone leaves.
    """
    if not singles or not certain(singles[0], rank.floor):
        return []
    floor = max(rank.floor, rank.floor_of(singles[0].fit))
    if not something_left(singles[0].left, floor):
        return []
    leftover = max(singles[0].left.excess, singles[0].fit.chi2 - singles[0].fit.effective)
    if leftover < SECOND_SHARE * excess_of(left, singles[0]):
        return []
    fits = search_pairs(rank.problem, rank.base, [r.fit for r in singles], effects)
    ranked = [rank(fit) for fit in fits[:_MOST_PAIRS]]
    excess = excess_of(left, min([*ranked, *singles], key=lambda r: r.fit.bic))
    by_name = {r.fit.names[0]: r for r in singles}
    return [r for r in ranked if both_needed(rank.problem, r, by_name, excess, floor)]
