"""Stepwise search of sets of up to four effects, for a force that no law explains completely.

Real bodies lack three or four effects at once, and no law is exact. A set grows by the effect that
lowers the error on inner blocks most. An effect that a later one makes unnecessary is removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.criteria import LEAST_GAIN
from teleop_rt.diagnosis.inference.coarse import Coarse, at_lower_rates
from teleop_rt.diagnosis.inference.inner_blocks import blind_energy
from teleop_rt.diagnosis.inference.pairs import fit_without
from teleop_rt.diagnosis.inference.screening import screen_coarsely
from teleop_rt.diagnosis.inference.search import best_by_name, fit_start, with_other_clamp
from teleop_rt.diagnosis.inference.unsupported import unsupported
from teleop_rt.diagnosis.models.fit import Fit, Problem

MOST_EFFECTS = 4  # a fifth lowers no error of a measured recording by as much as `LEAST_GAIN`
OF_TIME = frozenset({"drift", "periodic"})  # families whose laws hold for one recording alone
_STARTS = 10  # laws fitted at each step, of those that promise most
_FIRSTS = 3  # single effects from which pairs are sought
_RECLAMPED = 3  # best fits of each step that are fitted with another clamp as well
_EVALUATIONS = 8  # of a descent at a lower rate; sets are compared by their error
_LAST_EVALUATIONS = 3  # of the likeliest fits at the full rate, from the optimum at the lower one


@dataclass(frozen=True)
class Scored:
    """A fitted set; `energies` [force^2] on inner blocks: of the base, then after each effect.

    `bound` states that a shape lies at a bound, or fits as well at its neutral value. Such a law
    approximates another effect, and its name is not reported.
    """

    fit: Fit
    energies: tuple[float, ...]
    bound: bool = False

    @property
    def energy(self) -> float:
        """Mean square [force^2] of the residual on inner blocks."""
        return self.energies[-1]

    @property
    def laws_of_time(self) -> frozenset[str]:
        """The effects whose laws depend on time and hold for this recording alone."""
        return frozenset(e.name for e in self.fit.model.effects if e.family in OF_TIME)

    @property
    def names(self) -> frozenset[str]:
        """The effects, in no order."""
        return frozenset(self.fit.names)

    @property
    def shares(self) -> tuple[float, ...]:
        """Share of the base's energy that each effect explains beyond the effects before it."""
        steps = zip(self.energies[:-1], self.energies[1:], strict=True)
        return tuple((before - after) / self.energies[0] for before, after in steps)


def search_sets(problem: Problem, base: Fit, effects: tuple[Effect, ...]) -> list[Scored]:
    """Return all sets tried, the base alone among them, the least energy on inner blocks first.

    If the best set has a law of time, sets without such laws are searched as well: in a periodic
    motion a tone may explain the force of another effect, on that recording alone.
    """
    tried = _stepwise(problem, base, effects)
    if tried[0].laws_of_time:
        tried += _stepwise(problem, base, tuple(e for e in effects if e.family not in OF_TIME))
    return sorted(tried, key=lambda one: one.energy)


def _stepwise(problem: Problem, base: Fit, effects: tuple[Effect, ...]) -> list[Scored]:
    """Return the sets tried forward and backward, the least energy first."""
    tried = [Scored(base, (blind_energy(problem, base),))]
    level, lower = tried, at_lower_rates(problem)
    for number in range(MOST_EFFECTS):
        firsts = level[: _FIRSTS if number == 1 else 1]
        longer = [
            one for first in firsts for one in _extended(problem, lower, base, first, effects)
        ]
        if not longer:
            break
        level = sorted(_without_idle_members(problem, base, longer), key=lambda one: one.energy)
        best = min(tried, key=lambda one: one.energy).energy
        tried += level
        if level[0].energy > (1.0 - LEAST_GAIN) * best:
            break
    return sorted(tried, key=lambda one: one.energy)


def _extended(
    problem: Problem,
    lower: tuple[Coarse, Coarse],
    base: Fit,
    first: Scored,
    effects: tuple[Effect, ...],
) -> list[Scored]:
    """Return the set extended by one effect, per effect with its best law.

    The laws are fitted at the higher of the `lower` rates. The likeliest are then fitted at the
    full one, which the others only get their linear parameters from. If the best law cannot be
    named (`bound` in `Scored`), the best law that can be is returned as well: the first may
    predict, the second may be named.
    """
    others = tuple(e for e in effects if e.name not in first.names)
    starts = screen_coarsely(problem, lower, first.fit, others)[:_STARTS]
    near, _ = lower[0].around(problem, first.fit)
    alone = near.solve(base.model, base.zeta, base.theta)
    fits = [fit_start(near, start, _EVALUATIONS) for start in starts]
    likely = best_by_name(fits)[:_RECLAMPED]
    fits += [with_other_clamp(near, fit) for fit in likely if len(fit.model.clamps) > 1]
    bare = [unsupported(near, alone, fit) for fit in fits]
    within = best_by_name([fit for fit, without in zip(fits, bare, strict=True) if not without])
    least = {fit.names: (1.0 - LEAST_GAIN) * fit.chi2 for fit in within}
    bent = best_by_name([fit for fit, without in zip(fits, bare, strict=True) if without])
    bent = [fit for fit in bent if fit.chi2 < least.get(fit.names, np.inf)]
    best = min((fit.chi2 for fit in fits), default=0.0)
    found = []
    for fit in (*within, *bent):
        refined = near.motion.dt > problem.motion.dt and (1.0 - LEAST_GAIN) * fit.chi2 < best
        fine = (
            problem.refine(fit.model, fit.zeta, _LAST_EVALUATIONS)
            if refined
            else (problem.solve(fit.model, fit.zeta, fit.theta))
        )
        found.append(_scored(problem, base, fine, first.energies))
    return found


def _scored(problem: Problem, base: Fit, fit: Fit, before: Sequence[float]) -> Scored:
    energies = (*before, blind_energy(problem, fit))
    return Scored(fit, energies, unsupported(problem, base, fit))


def _without_idle_members(problem: Problem, base: Fit, sets: list[Scored]) -> list[Scored]:
    """Return the sets, and the best of them without each of its unnecessary members."""
    best = min(sets, key=lambda one: one.energy)
    found = list(sets)
    if len(best.fit.names) < 3:
        return found
    for member in range(len(best.fit.names) - 1):
        less = _scored(problem, base, fit_without(problem, best.fit, member), best.energies[:1])
        if less.energy < best.energy / (1.0 - LEAST_GAIN):
            found.append(less)
    return found
