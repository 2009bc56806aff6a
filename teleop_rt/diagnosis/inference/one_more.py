"""Search of one more effect beside the best single effects, or the best sets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.diagnosis.criteria import CERTAIN_BIC
from teleop_rt.diagnosis.inference.coarse import Coarse, at_lower_rates
from teleop_rt.diagnosis.inference.laws import by_other_laws, friction_beside_delay
from teleop_rt.diagnosis.inference.screening import screen_coarsely
from teleop_rt.diagnosis.inference.search import (
    best_by_name,
    fades,
    fit_start,
    with_other_clamp,
    with_past,
)
from teleop_rt.diagnosis.inference.starts import Start
from teleop_rt.diagnosis.inference.verdict import SPECIAL_CASE_OF
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import CandidateModel

FIRSTS = 5  # single effects beside which a second is searched
FIRST_SHARE = 0.2  # of the best gain; a set that explains less is not extended
EXTENDED = 17  # sets of the largest screened gain that are fitted; 16 lost a play beside friction
# In a set. A fifth lowers no error of a measured recording by as much as `LEAST_GAIN`.
MOST_EFFECTS = 4
MOST_RANKED = 6  # best sets that are fitted at the full rate and ranked
_RELAWED_PAIRS, _RELAWED_SETS = 1, 3  # best pairs, and best larger sets, tried with other laws
_LAST_EVALUATIONS = 6  # of their descent, from the optimum at a lower rate
_MOST_EXCHANGED = 3  # effects tried in place of each member of the best set
_FRICTION_NAMES = {"coulomb_friction", "stribeck_friction", "hysteresis"}
_CONTAINED_LAWS = (
    {"coulomb_friction", "stribeck_friction"},
    {"stress_relaxation", "fractional_relaxation"},
)


def search_one_more(
    problem: Problem,
    base: Fit,
    singles: list[Fit],
    effects: tuple[Effect, ...],
) -> list[Fit]:
    """Return the likeliest fitted sets with one more effect, best first."""
    fits = coarse_one_more(problem, base, singles, effects)[:MOST_RANKED]
    return best_by_name([problem.refine(f.model, f.zeta, _LAST_EVALUATIONS) for f in fits])


def coarse_one_more(
    problem: Problem, base: Fit, singles: list[Fit], effects: tuple[Effect, ...]
) -> list[Fit]:
    """Return sets with one more effect, fitted at a lower rate, best first.

    It is searched beside the `singles`, or sets, that gain most. There it is detected
    even if it is too small to be detected alone.
    """
    lower = at_lower_rates(problem)
    starts = _starts(problem, lower, base, singles, effects)
    near, _ = lower[0].around(problem, min(singles, key=lambda fit: fit.chi2))
    fits = [fit_start(near, start, evaluations=10) for start in starts]
    fits += friction_beside_delay(near, worth_extending(base, singles)[:FIRSTS], effects)
    fits = best_by_name(fits)
    fits += [with_other_clamp(near, fit) for fit in fits[:2]]
    pairs = all(len(fit.names) == 2 for fit in fits)
    for fit in fits[: _RELAWED_PAIRS if pairs else _RELAWED_SETS]:
        fits += by_other_laws(near, fit, effects)
    fits += [with_past(near, fit) for fit in best_by_name(fits)[:2] if fades(near, fit)]
    return best_by_name(fits)


def worth_extending(base: Fit, singles: list[Fit]) -> list[Fit]:
    """Return the single effects, or sets, that explain enough to be part of a larger set."""
    least = min(fit.chi2 for fit in singles)
    return [f for f in singles if f.chi2 - least <= (1.0 - FIRST_SHARE) * (base.chi2 - least)]


def _starts(
    problem: Problem,
    lower: tuple[Coarse, Coarse],
    base: Fit,
    singles: list[Fit],
    effects: tuple[Effect, ...],
) -> list[Start]:
    """Return starts of the likeliest sets, each beside one of the best single effects or sets."""
    found: list[tuple[float, tuple[str, ...], Start]] = []
    for first in worth_extending(base, singles)[:FIRSTS]:
        others = tuple(e for e in effects if not _same_as_any(e, first))
        seconds = screen_coarsely(problem, lower, first, others)[:8]
        found += [(first.chi2 - s.gain, first.names, s) for s in seconds]
    found.sort(key=lambda item: item[0])
    chosen: dict[tuple[str, ...], Start] = {}
    for _, names, start in found:
        chosen.setdefault((*names, start.effect.name, start.effect.law), start)
    return list(chosen.values())[:EXTENDED]


def exchanged(
    problem: Problem, whole: Fit, effects: tuple[Effect, ...], *, within_family: bool
) -> list[Fit]:
    """Return fitted sets in which one member of the given set is replaced by another effect.

    The search starts from the parameters that the kept members have in the set. Fitted alone, their
    parameters may compensate for the missing effect and hide it. With `within_family` only effects
    of the member's own family, its special case and effects with the same force are tried: they are
    its closest rivals, however well the set fits.
    """
    lower, fits = at_lower_rates(problem), []
    for member in range(len(whole.names)):
        kept, left = problem.solve(*without(whole, member)), whole.model.effects[member]
        special = SPECIAL_CASE_OF.get(left.name)
        others = tuple(
            e
            for e in effects
            if e.name != left.name
            and not _same_as_any(e, kept)
            and (_rivals(e, left) or e.name == special or not within_family)
        )
        starts = screen_coarsely(problem, lower, kept, others)[:_MOST_EXCHANGED]
        near, _ = lower[0].around(problem, kept)
        found = [fit_start(near, start, evaluations=10) for start in starts]
        fits += [problem.refine(f.model, f.zeta, _LAST_EVALUATIONS) for f in found]
    return best_by_name(fits)


def _rivals(one: Effect, other: Effect) -> bool:
    return one.family == other.family or _are_one_force(one, other)


def _are_one_force(one: Effect, other: Effect) -> bool:
    """Return whether two names mean one force, which no data separate."""
    return one.step is other.step and one.acts == other.acts


def alike(problem: Problem, base: Fit, best: Fit, effects: tuple[Effect, ...]) -> Fit | None:
    """Return the fit of the set that is declared equivalent to a single effect's law.

    The fit starts at the law's shape parameters, or, beside a first member without a shape, where
    the search of pairs starts the second. None without such a declaration or such members, or if
    the set does not need all its members.
    """
    if len(best.names) != 1 or not best.model.effects[0].like:
        return None
    law = best.model.effects[0]
    laws = [tuple(e for e in effects if e.name == name and not e.like) for name in law.like]
    known = {c.shape.name: z for c, z in zip(best.model.coordinates, best.zeta, strict=True)}
    members = tuple(e for each in laws for e in each if {s.name for s in e.shapes} <= known.keys())
    if len(members) == len(laws):
        model = replace(best.model, effects=members)
        fit = problem.refine(model, np.array([known[c.shape.name] for c in model.coordinates]))
    else:
        fits = _from_first(problem, base, laws)
        if not fits:
            return None
        fit = problem.refine(fits[0].model, fits[0].zeta, _LAST_EVALUATIONS)
    needed = all(
        fit_without(problem, fit, member).bic - fit.bic > CERTAIN_BIC for member in range(len(laws))
    )
    return fit if needed else None


def _from_first(problem: Problem, base: Fit, laws: list[tuple[Effect, ...]]) -> list[Fit]:
    """Return coarse pairs, best first, of a first effect without a shape and a second one."""
    if not all(laws) or laws[0][0].shapes:
        return []
    first = problem.refine(replace(base.model, effects=laws[0][:1]), base.zeta)
    return coarse_one_more(problem, base, [first], laws[1])


def same_physics(one: Effect, other: Effect) -> bool:
    """Return whether two effects are the same force, contain each other, or are both friction.

    Hysteresis is friction with a long presliding where both act at the same places: without
    contact, or both in contact alone. A pair of the two would only adapt to the form of either.
    """
    names = {one.name, other.name}
    if len(names) == 1 or _are_one_force(one, other) or names in _CONTAINED_LAWS:
        return True
    at_same_places = one.only_in_contact == other.only_in_contact
    return names <= _FRICTION_NAMES and (
        at_same_places or one.without_contact or other.without_contact
    )


def _same_as_any(effect: Effect, fit: Fit) -> bool:
    return any(same_physics(effect, member) for member in fit.model.effects)


def fit_without(problem: Problem, fit: Fit, member: int) -> Fit:
    """Return the fit's model without one member, refitted from the fit's parameters."""
    return problem.refine(*without(fit, member))


def without(fit: Fit, member: int) -> tuple[CandidateModel, Vector]:
    """Return the fit's model without one member, and the nonlinear parameters of the others."""
    kept = tuple(e for i, e in enumerate(fit.model.effects) if i != member)
    owners = [c.owner for c in fit.model.coordinates]
    zeta = fit.zeta[[i for i, owner in enumerate(owners) if owner != member]]
    return replace(fit.model, effects=kept), zeta
