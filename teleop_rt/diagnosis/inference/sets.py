"""Stepwise search of sets of up to four effects, for a force that no law explains completely.

Real bodies lack three or four effects at once, and no law is exact. A set grows by the effect that
lowers the error on inner blocks most. An effect that a later one makes unnecessary is removed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.diagnosis.criteria import LEAST_GAIN
from teleop_rt.diagnosis.inference.coarse import Coarse, at_lower_rates
from teleop_rt.diagnosis.inference.inner_blocks import blind_energy
from teleop_rt.diagnosis.inference.laws import extended
from teleop_rt.diagnosis.inference.one_more import MOST_EFFECTS, fit_without
from teleop_rt.diagnosis.inference.screening import screen_coarsely
from teleop_rt.diagnosis.inference.search import best_by_name, fit_start, with_other_clamp
from teleop_rt.diagnosis.inference.unsupported import unsupported
from teleop_rt.diagnosis.inference.verdict import SPECIAL_CASE_OF
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import CandidateModel

OF_TIME = frozenset({"drift", "periodic"})  # families whose laws hold for one recording alone
_STARTS = 12  # laws fitted at each step, of those that promise most
_FIRSTS = 3  # single effects from which pairs are sought
_RECLAMPED = 3  # best fits of each step that are fitted with another clamp as well
# Of chi-square. Below it a second harmonic only adapts to forces that no law of the set describes:
# on measured recordings it took off up to 18 %, and the error on other blocks rose by half.
_LEAST_EXTENSION = 0.25
_EVALUATIONS = 8  # of a descent at a lower rate; sets are compared by their error
_LAST_EVALUATIONS = 3  # of the likeliest fits at the full rate, from the optimum at the lower one
_T = TypeVar("_T")


@dataclass(frozen=True)
class Scored:
    """A fitted set; `energies` [force^2] on inner blocks: of the base, then after each effect.

    `unsupported` are the effects with a shape at a bound, or that fit as well at its neutral value.
    Such a law approximates another effect, and its name is not reported.
    """

    fit: Fit
    energies: tuple[float, ...]
    unsupported: frozenset[str] = frozenset()

    @property
    def energy(self) -> float:
        """Mean square [force^2] of the residual on inner blocks."""
        return self.energies[-1]

    @property
    def nameable(self) -> bool:
        """Whether the data support the names of all its effects."""
        return not self.unsupported

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
    steps = _Steps(problem, base, at_lower_rates(problem))
    tried = _stepwise(steps, effects)
    if tried[0].laws_of_time:
        tried += _stepwise(steps, tuple(e for e in effects if e.family not in OF_TIME))
    return sorted(tried, key=lambda one: one.energy)


def _stepwise(steps: _Steps, effects: tuple[Effect, ...]) -> list[Scored]:
    """Return the sets tried forward and backward, the least energy first."""
    tried = level = [steps.alone]
    for number in range(MOST_EFFECTS):
        firsts = _of_different_families(level)[:_FIRSTS] if number == 1 else level[:1]
        longer = [one for first in firsts for one in steps.extended(first, effects)]
        if not longer:
            break
        level = _without_idle_members(steps.problem, steps.base, longer)
        level = sorted(level, key=lambda one: one.energy)
        level += _special_cases(steps, level[0], {one.names for one in (*tried, *level)}, effects)
        best = min(tried, key=lambda one: one.energy).energy
        tried = tried + level
        if level[0].energy > (1.0 - LEAST_GAIN) * best:
            break
    return sorted(tried, key=lambda one: one.energy)


def _special_cases(
    steps: _Steps, best: Scored, known: set[frozenset[str]], effects: tuple[Effect, ...]
) -> list[Scored]:
    """Return the set with the special case of each effect that has one, if it is not yet `known`.

    Only beside it is the name of the effect judged: friction without Stribeck's may fit as well.
    """
    found: list[Scored] = []
    for member, effect in enumerate(best.fit.model.effects):
        simple = SPECIAL_CASE_OF.get(effect.name)
        if simple is None or best.names - {effect.name} | {simple} in known | {best.names}:
            continue
        rest = fit_without(steps.problem, best.fit, member)
        others = _scored(steps.problem, steps.base, rest, best.energies[:1])
        found += steps.extended(others, tuple(e for e in effects if e.name == simple))
    return found


@dataclass(frozen=True)
class _Steps:
    """Extensions of sets by one effect; results that a smaller search needs again are kept."""

    problem: Problem
    base: Fit
    lower: tuple[Coarse, Coarse]
    kept: dict[tuple[str, int], tuple[object, Any]] = field(default_factory=dict)

    def _once(self, step: str, of: object, make: Callable[[], _T]) -> _T:
        """Return the result of `make` for an object, which is kept so that its id stays its own."""
        if (step, id(of)) not in self.kept:
            self.kept[step, id(of)] = of, make()
        made: _T = self.kept[step, id(of)][1]
        return made

    @cached_property
    def alone(self) -> Scored:
        """The base without an effect."""
        return Scored(self.base, (blind_energy(self.problem, self.base),))

    def extended(self, first: Scored, effects: tuple[Effect, ...]) -> list[Scored]:
        """Return the set extended by one effect, per effect with its best law.

        The laws are fitted at the higher of the `lower` rates. The likeliest are then fitted at the
        full one, which the others only get their linear parameters from. If the best law cannot be
        named, the best law that can be is returned as well: the first may predict, the second may
        be named.
        """
        near, fits = self._at_lower_rate(first, effects)
        alone = self._once("alone", near, lambda: near.solve(*_parameters(self.base)))
        bare = [self._once("bare", fit, partial(unsupported, near, alone, fit)) for fit in fits]
        within = best_by_name([fit for fit, without in zip(fits, bare, strict=True) if not without])
        least = {fit.names: (1.0 - LEAST_GAIN) * fit.chi2 for fit in within}
        bent = best_by_name([fit for fit, without in zip(fits, bare, strict=True) if without])
        bent = [fit for fit in bent if fit.chi2 < least.get(fit.names, np.inf)]
        best = min((fit.chi2 for fit in fits), default=0.0)
        slower = near.motion.dt > self.problem.motion.dt
        likely = [slower and (1.0 - LEAST_GAIN) * fit.chi2 < best for fit in (*within, *bent)]
        return [
            self._once(str(refined), fit, partial(self._finely, first, fit, refined))
            for fit, refined in zip((*within, *bent), likely, strict=True)
        ]

    def _at_lower_rate(
        self, first: Scored, effects: tuple[Effect, ...]
    ) -> tuple[Coarse, list[Fit]]:
        """Return the coarse problem about a set, and the fits of its likeliest extensions there."""
        others = tuple(e for e in effects if e.name not in first.names)
        near, _ = self._once("near", first, lambda: self.lower[0].around(self.problem, first.fit))
        starts = self._once(
            "starts", first, lambda: screen_coarsely(self.problem, self.lower, first.fit, others)
        )
        names = {effect.name for effect in others}  # a tone is searched in bands: not the same law
        starts = [start for start in starts if start.effect.name in names][:_STARTS]
        fits = [
            self._once("fit", start, partial(fit_start, near, start, _EVALUATIONS))
            for start in starts
        ]
        for best in best_by_name(fits)[:1]:
            more = self._once("extended", best, partial(extended, near, best, effects))
            fits += [fit for fit in more if fit.chi2 < (1.0 - _LEAST_EXTENSION) * best.chi2]
        likely = [f for f in best_by_name(fits)[:_RECLAMPED] if len(f.model.clamps) > 1]
        fits += [self._once("clamp", f, partial(with_other_clamp, near, f)) for f in likely]
        return near, fits

    def _finely(self, first: Scored, fit: Fit, refined: bool) -> Scored:
        fine = (
            self.problem.refine(fit.model, fit.zeta, _LAST_EVALUATIONS)
            if refined
            else self.problem.solve(*_parameters(fit))
        )
        return _scored(self.problem, self.base, fine, first.energies)


def _of_different_families(singles: list[Scored]) -> list[Scored]:
    """Return the best single effect of each family, of equally good ones a supported name."""
    best: dict[str, Scored] = {}
    for one in singles:
        first = best.setdefault(one.fit.model.effects[0].family, one)
        as_good = (1.0 - LEAST_GAIN) * one.energy <= first.energy
        if as_good and one.nameable and not first.nameable:
            best[one.fit.model.effects[0].family] = one
    return list(best.values())


def _parameters(fit: Fit) -> tuple[CandidateModel, Vector, Vector]:
    return fit.model, fit.zeta, fit.theta


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
