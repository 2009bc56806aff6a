"""Whether held-out blocks confirm a set: they have the last word on a name."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.answers.errors import Blocks, explained
from teleop_rt.diagnosis.criteria import CONFIRMED_SHARE, REDRAWN_NOISE_RATIO, SECOND_SHARE
from teleop_rt.diagnosis.inference.ranked import Ranked, leaves_structure
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.fit import Fit

_ONE_FOLD = 0.5
"""Of the energy of a set's force: if one fold hides more, the fit of that fold has not seen it."""


@dataclass(frozen=True)
class OnBlocks:
    """The judgement of sets by the `blocks` of a recording.

    `found` is the judgement, `plain` the one with equal weights on all frequencies, and `noise` the
    deviation that a perfect model would leave [rig's force].
    """

    found: Diagnosis
    plain: Diagnosis
    blocks: Blocks
    noise: float

    def confirm(self, ranked: Ranked) -> bool:
        """Return whether a set predicts blocks that its fit has not seen.

        A set that leaves less than the form error of any law needs no confirmation. Any other must
        keep half of its gain in whitened energy, and lower the error; a law that absorbs slow
        noise, or a tone that follows a narrow band of noise, does not. One that leaves structure
        must also explain half of the base's excess. A law that a single press shows is hidden from
        the fit with the block of that press; it needs no confirmation if it leaves no structure.
        """
        base, left = self.plain.left_by(self.plain.base), self.found.left_by(ranked.fit)
        if left**2 <= SECOND_SHARE * base**2:
            return True
        if leaves_structure(ranked.left, self.found.judgement.floor):
            explains = self._explains(ranked.fit)
            return explains >= CONFIRMED_SHARE and self._keeps_its_gain(ranked.fit)
        if self._acts_in_one_fold(ranked.fit):
            return True
        return self._lowers_the_error(ranked.fit) and self._keeps_its_gain(ranked.fit)

    def _explains(self, fit: Fit) -> float:
        """Return the share of the base's excess that the fit explains on blocks.

        Free air counts if an effect acts there, such as a weight, whose place the base takes in
        contact, and if the fit raises no error in contact, or the base leaves noise alone there.
        """
        unseen = self.blocks.predicted(fit, self.noise)
        share, before = explained(unseen), unseen.errors["before"]
        if all(effect.only_in_contact for effect in fit.model.effects):
            return share
        floor = unseen.errors["noise_floor"]
        noise_alone = before is not None and before < REDRAWN_NOISE_RATIO * floor
        if share < 0.0 and not noise_alone:
            return share
        everywhere = replace(unseen, where=self.found.problem.whitener.mask)
        return max(share, explained(everywhere))

    def _lowers_the_error(self, fit: Fit) -> bool:
        """Return whether the fit leaves less of all blocks; a bias shows in free air alone."""
        plain, problem = self.plain, self.found.problem
        predicted = self.blocks.force(plain.problem, plain.base), self.blocks.force(problem, fit)
        where = problem.whitener.mask > 0.0
        before, after = (np.sum((problem.force - one)[where] ** 2) for one in predicted)
        return bool(after < before)

    def _keeps_its_gain(self, fit: Fit) -> bool:
        problem, fits = self.found.problem, (self.found.base, fit)
        unseen = self._fall(*(self.blocks.force(problem, one) for one in fits))
        seen = self._fall(*(one.force_on(problem.motion) for one in fits))
        return unseen >= CONFIRMED_SHARE * seen

    def _fall(self, *predicted: Vector) -> float:
        """Return by how much less the second of two predictions leaves [chi-square]."""
        problem = self.found.problem
        before, after = (problem.whitener(problem.force - one) for one in predicted)
        return float(before @ before) - float(after @ after)

    def _acts_in_one_fold(self, fit: Fit) -> bool:
        problem = self.found.problem
        added, base = (one.force_on(problem.motion) for one in (fit, self.found.base))
        energy = (added - base) ** 2 * problem.whitener.mask
        by_fold = np.bincount(held_out.folds(energy.size), energy, held_out.FOLDS)
        return float(np.max(by_fold)) > _ONE_FOLD * float(np.sum(by_fold))
