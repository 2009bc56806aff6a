"""The dependence of the residual, and the few terms that describe it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.diagnosis.answers.shares import shapley
from teleop_rt.diagnosis.draft.blocks import FoldEquations
from teleop_rt.diagnosis.draft.terms import (
    GROUPS,
    Group,
    Scaling,
    Term,
    candidates,
    quantities,
    row_of,
)
from teleop_rt.diagnosis.models.fit import Fit, Problem

MOST_TERMS = 4  # a person has to read the law; a fifth gains less than a tenth on the campaign
_GAIN = 0.02  # of the mean square on hidden blocks by which a further term must lower it
_EXCHANGES = 3  # rounds at most; fewer where one changes nothing
_IN_AIR = 0.01  # of the base's mean square: the gain that a law needs to act in free air
_KEPT_GAIN = 0.005  # of the mean square: a term that gains less beside the others is removed


@dataclass(frozen=True)
class Law:
    """A drafted law: its terms, largest first, with the force [rig unit] that each makes.

    `only_in_contact`: it is 0 in free air. `shares` are the parts of the base's mean square that
    depend on each group, by Shapley's value of the groups' worth on hidden blocks.
    """

    terms: tuple[Term, ...]
    coefficients: tuple[float, ...]
    scaling: Scaling
    only_in_contact: bool
    shares: dict[Group, float]

    def without(self, place: int) -> Law:
        """Return the law without one of its terms; the shares stay those of the residual."""
        terms, coefficients = (
            (*row[:place], *row[place + 1 :]) for row in (self.terms, self.coefficients)
        )
        return replace(self, terms=terms, coefficients=coefficients)

    @property
    def words(self) -> list[str]:
        """The terms in words, each once: two directions of different width read alike."""
        return list(dict.fromkeys(term.words for term in self.terms))


def dependence(problem: Problem, fit: Fit) -> dict[str, float] | None:
    """Return the shares of a law (see `Law`) for the answer, None without a law."""
    law = law_of(problem, fit)
    return None if law is None else {str(key): share for key, share in law.shares.items()}


def law_of(problem: Problem, fit: Fit, *, of_time: bool = True) -> Law | None:
    """Return the law of a fit's residual, None if no term lowers the error on hidden blocks.

    Terms in the time since the recording began are left out unless `of_time`: they do not transfer
    to another recording.

    Terms are chosen forward, then thinned backward, by the mean square over blocks that are hidden
    in turn; the base is fitted beside them. Of a base with a surface, a law that acts in contact
    alone and one that acts in free air as well are drafted, and the better is returned.
    """
    scaling = Scaling.of(problem, fit)
    if scaling.travel <= 0.0 or scaling.speed <= 0.0:
        return None
    known = quantities(problem, fit, scaling)
    terms = [one for one in candidates(fit.model.base) if of_time or one.group != "time"]
    rows = np.array([row_of(term, known, problem.motion.dt) for term in terms])
    own, where = _own_rows(problem, fit), problem.whitener.mask
    inside = problem.motion.x + fit.model.shift(fit.zeta) > 0.0
    found = []
    for gated in (True, False) if scaling.touches else (False,):
        blocks = FoldEquations(own, rows * inside if gated else rows, problem.force, where)
        chosen = _thinned(blocks, _exchanged(blocks, _forward(blocks)))
        handicap = 0.0 if gated else _IN_AIR * blocks.energy([])
        found.append((blocks.energy(chosen) + handicap, gated, blocks, chosen))
    _, gated, blocks, chosen = min(found, key=lambda one: one[0])
    if not chosen:
        return None
    coefficients = blocks.coefficients(chosen)
    order = np.argsort(-np.abs(coefficients * blocks.sizes[chosen]))
    return Law(
        tuple(terms[chosen[i]] for i in order),
        tuple(float(coefficients[i]) for i in order),
        scaling,
        gated,
        shares(blocks, terms, chosen),
    )


def shares(
    blocks: FoldEquations, terms: Sequence[Term], chosen: Sequence[int]
) -> dict[Group, float]:
    """Return the share of the base's mean square that depends on each group of terms.

    A group represents its terms among the chosen ones. Its share is their error reduction on hidden
    blocks, averaged over the orders of the groups (Shapley 1953). The unexplained
    share is 1 minus the sum.
    """
    base = blocks.energy([])
    places = {group: [place for place in chosen if terms[place].group == group] for group in GROUPS}
    worth: dict[frozenset[Group], float] = {}
    for number in range(len(GROUPS) + 1):
        for some in combinations(GROUPS, number):
            chosen = [place for group in some for place in places[group]]
            left = blocks.energy(chosen)
            worth[frozenset(some)] = max(0.0, 1.0 - left / max(base, 1e-300))
    return {group: round(shapley(group, len(GROUPS), worth), 4) for group in GROUPS}


def _own_rows(problem: Problem, fit: Fit) -> Matrix:
    """Return the columns of the base, and the force of the named effects as one column."""
    base, motion = fit.model.base, problem.motion
    x = motion.x + fit.model.shift(fit.zeta)
    power = float(fit.zeta[0]) if base.has_power else 1.0
    rows = [np.asarray(row, dtype=np.float64) for row in base.columns(x, motion.v, motion.a, power)]
    if fit.model.effects:
        alone: Vector = fit.theta[: len(rows)] @ np.array(rows)
        rows.append(fit.force_on(problem.motion) - alone)
    return np.array(rows).reshape(len(rows), x.size)


def _forward(blocks: FoldEquations) -> list[int]:
    """Return the places of the terms that lower the mean square on hidden blocks, best first."""
    free = list(blocks.places)
    chosen: list[int] = []
    left = blocks.energy([])
    while free and len(chosen) < MOST_TERMS:
        lower, best = min((blocks.energy([*chosen, place]), place) for place in free)
        if lower > (1.0 - _GAIN) * left:
            break
        chosen.append(best)
        free.remove(best)
        left = lower
    return chosen


def _exchanged(blocks: FoldEquations, chosen: list[int]) -> list[int]:
    """Return the terms after exchanges for better ones beside the others, until none is better.

    Forward choice alone keeps terms that it chose without the later ones.
    """
    for _ in range(_EXCHANGES):
        before = list(chosen)
        for i in range(len(chosen)):
            others = [*chosen[:i], *chosen[i + 1 :]]
            free = set(blocks.places) - set(others)
            chosen[i] = min((blocks.energy([*others, place]), place) for place in free)[1]
        if chosen == before:
            break
    return chosen


def _thinned(blocks: FoldEquations, chosen: list[int]) -> list[int]:
    """Return the terms without those that later ones made unnecessary."""
    for place in list(chosen[:-1]):
        rest = [other for other in chosen if other != place]
        if blocks.energy(rest) < (1.0 + _KEPT_GAIN) * blocks.energy(chosen):
            chosen = rest
    return chosen
