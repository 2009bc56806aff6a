"""Sets of up to four effects, sought step by step for a force that no law explains to its noise.

Real bodies lack three or four things at once, and no law is exact. A set grows by the effect that
lowers the error on inner blocks most, and is freed of each that a later one has made idle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.criteria import LEAST_GAIN
from teleop_rt.diagnosis.inference.coarse import at_lower_rates
from teleop_rt.diagnosis.inference.inner_blocks import blind_energy
from teleop_rt.diagnosis.inference.pairs import fit_without
from teleop_rt.diagnosis.inference.screening import look
from teleop_rt.diagnosis.inference.search import best_by_name, fit_start, otherwise_clamped
from teleop_rt.diagnosis.inference.unsupported import unsupported
from teleop_rt.diagnosis.models.fit import Fit, Problem

MOST_EFFECTS = 4  # a fifth lowers no error of a measured recording by as much as `LEAST_GAIN`
OF_THE_CLOCK = frozenset({"drift", "periodic"})  # families whose laws hold of one recording alone
_STARTS = 10  # laws fitted at each step, of those that promise most
_FIRSTS = 3  # single effects from which pairs are sought
_RECLAMPED = 3  # of the best fits at each step: what lets go of the tool is fitted again
_EVALUATIONS = 8  # of a descent; sets are compared by their error, not to the last digit


@dataclass(frozen=True)
class Scored:
    """A fitted set; `energies` [force^2] on inner blocks: of the base, then after each effect.

    `bound` where a shape lies at a bound, or at its neutral value as well as anywhere: it stands in
    for something else, and is no name.
    """

    fit: Fit
    energies: tuple[float, ...]
    bound: bool = False

    @property
    def energy(self) -> float:
        """Mean square that the set leaves of inner blocks."""
        return self.energies[-1]

    @property
    def by_clock(self) -> frozenset[str]:
        """The effects that say what happened while this recording ran, and no other."""
        return frozenset(e.name for e in self.fit.model.effects if e.family in OF_THE_CLOCK)

    @property
    def names(self) -> frozenset[str]:
        """The effects, in no order."""
        return frozenset(self.fit.names)

    @property
    def shares(self) -> tuple[float, ...]:
        """Share of the base's energy that each effect takes, beyond those before it."""
        steps = zip(self.energies[:-1], self.energies[1:], strict=True)
        return tuple((before - after) / self.energies[0] for before, after in steps)


def search_sets(problem: Problem, base: Fit, effects: tuple[Effect, ...]) -> list[Scored]:
    """Return all sets tried, the base alone among them, the least energy on inner blocks first.

    Where the best of them has a law of the clock, sets are sought without such laws as well: what a
    periodic motion repeats, a tone may explain on that recording alone.
    """
    tried = _stepwise(problem, base, effects)
    if tried[0].by_clock:
        tried += _stepwise(problem, base, tuple(e for e in effects if e.family not in OF_THE_CLOCK))
    return sorted(tried, key=lambda one: one.energy)


def _stepwise(problem: Problem, base: Fit, effects: tuple[Effect, ...]) -> list[Scored]:
    """Return the sets tried forward and backward, the least energy first."""
    tried = [Scored(base, (blind_energy(problem, base),))]
    level = tried
    for number in range(MOST_EFFECTS):
        firsts = level[: _FIRSTS if number == 1 else 1]
        longer = [one for first in firsts for one in _extended(problem, base, first, effects)]
        if not longer:
            break
        level = sorted(_freed(problem, base, longer), key=lambda one: one.energy)
        best = min(tried, key=lambda one: one.energy).energy
        tried += level
        if level[0].energy > (1.0 - LEAST_GAIN) * best:
            break
    return sorted(tried, key=lambda one: one.energy)


def _extended(
    problem: Problem, base: Fit, first: Scored, effects: tuple[Effect, ...]
) -> list[Scored]:
    """Return a set with one more effect, by its best law and, if that wins no name, by two.

    Such a law (see `Scored`) may predict; a name rests on the best law of the others.
    """
    others = tuple(e for e in effects if e.name not in first.names)
    starts = look(problem, at_lower_rates(problem), first.fit, others)[:_STARTS]
    fits = [fit_start(problem, start, _EVALUATIONS) for start in starts]
    likely = best_by_name(fits)[:_RECLAMPED]
    fits += [otherwise_clamped(problem, fit) for fit in likely if len(fit.model.clamps) > 1]
    bare = [unsupported(problem, base, fit) for fit in fits]
    within = best_by_name([fit for fit, without in zip(fits, bare, strict=True) if not without])
    least = {fit.names: (1.0 - LEAST_GAIN) * fit.chi2 for fit in within}
    bent = best_by_name([fit for fit, without in zip(fits, bare, strict=True) if without])
    bent = [fit for fit in bent if fit.chi2 < least.get(fit.names, np.inf)]
    return [_scored(problem, base, fit, first.energies) for fit in (*within, *bent)]


def _scored(problem: Problem, base: Fit, fit: Fit, before: Sequence[float]) -> Scored:
    energies = (*before, blind_energy(problem, fit))
    return Scored(fit, energies, unsupported(problem, base, fit))


def _freed(problem: Problem, base: Fit, sets: list[Scored]) -> list[Scored]:
    """Return the sets, and the best of them without each member that it does not need."""
    best = min(sets, key=lambda one: one.energy)
    found = list(sets)
    if len(best.fit.names) < 3:
        return found
    for member in range(len(best.fit.names) - 1):
        less = _scored(problem, base, fit_without(problem, best.fit, member), best.energies[:1])
        if less.energy < best.energy / (1.0 - LEAST_GAIN):
            found.append(less)
    return found
