"""The verdict on fitted candidates: named, class, partial, unexplained or no missing effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import sqrt
from statistics import fmean, pvariance
from typing import Literal

from teleop_rt.contact.effect import Family
from teleop_rt.diagnosis.criteria import (
    HINT_SHARE,
    PARTIAL_SHARE,
    SAME_SHARE,
    SECOND_SHARE,
    SPECIAL_CASE_GAIN,
    WITHIN_REACH_BIC,
)
from teleop_rt.diagnosis.inference.ranked import (
    Ranked,
    adequate,
    certain,
    excess_of,
    explains,
    family_of,
    leaves_structure,
    scaled_by_doubt,
)
from teleop_rt.diagnosis.noise.structure import LackOfFit

Verdict = Literal["no_missing_effect", "named", "class", "partial", "unexplained"]
SPECIAL_CASE_OF = {
    "stribeck_friction": "coulomb_friction",
    "direction_dependent_damping": "viscous_friction",
    "second_layer": "contact_offset",
    "gravity_torque": "force_bias",
    "force_drift": "force_bias",
    "return_spring": "force_bias",
}
"""Each key contains its value as a special case, and so fits at least as well."""
_SPECIAL_CASE_AT_BOUND = {**SPECIAL_CASE_OF, "moving_surface": "contact_offset"}
"""The same of a law with a shape at a bound: a surface that settles at once lies elsewhere."""


@dataclass(frozen=True)
class Judgement:
    """The verdict; `sets` best first; `excess` is the energy of the base's residual above noise.

    `reach` is the difference in chi-square at which a set excludes another, `floor` the energy of
    encoder errors in the structure.
    """

    verdict: Verdict
    sets: tuple[Ranked, ...]
    family: Family | None
    excess: float
    reach: float = WITHIN_REACH_BIC
    floor: float = 0.0
    probability: Mapping[str, float] = field(default_factory=dict)


def _tolerance(closest: Ranked, excess: float, floor: float) -> float:
    """Return the energy below which differences between laws do not distinguish them.

    The misfit of the closest law limits the comparison, and differences below half a percent of
    the excess do not count. If the closest law leaves no structure, or is a set of three effects or
    more, which leaves next to nothing, only its misfit counts; not if a shape of it lies at a
    bound, where it takes the error of another law's form.
    """
    misfit = max(closest.left.excess, 0.0)
    complete = not leaves_structure(closest.left, floor) and not closest.at_bound
    if _is_larger(closest) or complete:
        return misfit
    return max(misfit, SAME_SHARE * excess)


def _is_larger(ranked: Ranked) -> bool:
    """Return whether a set has three effects or more: `needed.py` has shown that it is complete."""
    return len(ranked.fit.names) > 2


def _preference(rival: Ranked, closest: Ranked) -> float:
    """Return the evidence for the closest set against a rival [chi-square].

    Two single effects are compared by chi-square alone, because extensions of a simpler effect were
    removed before. Larger sets are compared by BIC, which counts their parameters.
    """
    by_bic = rival.fit.bic - closest.fit.bic
    if len(rival.fit.names) == 1 and len(closest.fit.names) == 1:
        by_bic = min(rival.fit.chi2 - closest.fit.chi2, by_bic)
    return by_bic - _encoder_advantage(rival, closest)


def _encoder_advantage(rival: Ranked, closest: Ranked) -> float:
    """Return the chi-square by which encoder errors alone may favour the closest set.

    A mass turns encoder errors into more force than a bias does, whether it is correct or not. The
    value is the mean over the draws plus two standard deviations: those among draws and those from
    the force noise.
    """
    more = [a - b for a, b in zip(rival.encoder_misfits, closest.encoder_misfits, strict=False)]
    mean = fmean(more) if more else 0.0
    return mean + 2.0 * sqrt(pvariance(more) + 4.0 * mean) if mean > 0.0 else 0.0


def without_empty_extensions(candidates: list[Ranked], excess: float) -> list[Ranked]:
    """Return the candidates without sets that extend a simpler effect and gain nothing by it.

    No data could exclude such a set: no motion shows a Stribeck effect of size zero. It must gain
    more over the set with the simpler effect than chance gives, and more than another form of that
    effect could (`SECOND_SHARE`), or than a larger set leaves. A law with a shape at a bound is
    such another form: a Stribeck effect at the lowest speed allowed takes the error of friction
    that gives way before it slides.
    """
    by_names = {frozenset(r.fit.names): r for r in candidates}

    def gains_over_simpler(ranked: Ranked) -> bool:
        names = frozenset(ranked.fit.names)
        if any(plain in by_names for plain in simpler_names(names, ranked.at_bound)):
            return False
        simpler = (by_names.get(plain) for plain in simpler_names(names))
        form = ranked.left.excess if _is_larger(ranked) else SECOND_SHARE * excess
        least = max(SPECIAL_CASE_GAIN, form)
        return all(ranked.gain - plain.gain > least for plain in simpler if plain is not None)

    return [r for r in candidates if gains_over_simpler(r)]


def by_merit(candidates: list[Ranked], excess: float, floor: float) -> list[Ranked]:
    """Return the candidates by Schwarz's criterion, best first, with the misfit as dispersion.

    If even the closest candidate leaves structure, a law with more shape parameters gains by
    adapting to it. Chi-square is therefore divided by the misfit per degree of freedom
    (quasi-likelihood), which ranks the simpler law first.
    """
    if not candidates:
        return []
    closest = min(candidates, key=lambda r: r.fit.chi2)
    dispersion = 1.0 + _tolerance(closest, excess, floor) / max(closest.left.rank, 1)

    def merit(ranked: Ranked) -> float:
        penalty = ranked.fit.bic - ranked.fit.chi2
        return ranked.fit.chi2 / dispersion + penalty

    return sorted(candidates, key=merit)


def simpler_names(
    names: frozenset[str], replaced: frozenset[str] | None = None
) -> list[frozenset[str]]:
    """Return the sets in which one effect is its own special case.

    Those `replaced`, if given, are effects of which a shape lies at a bound.
    """
    if replaced is None:
        tried, special = names, SPECIAL_CASE_OF
    else:
        tried, special = names & replaced, _SPECIAL_CASE_AT_BOUND
    return [names - {n} | {special[n]} for n in tried if n in special]


def _part_of(ranked: Ranked, larger: Ranked) -> bool:
    """Return whether a set is a part of a larger one, which is needed over each of its parts."""
    return set(ranked.fit.names) < set(larger.fit.names)


def _surpassed(ranked: Ranked, sets: list[Ranked]) -> bool:
    """Return whether a larger set explains the tone or free-air force beside a single effect."""
    names = set(ranked.fit.names)
    return ranked.tone_or_air_force and any(
        names < set(p.fit.names) and not p.tone_or_air_force for p in sets
    )


def joined(judgement: Judgement, other: Ranked) -> Judgement:
    """Return the judgement with one more set, last, if the data do not exclude it."""
    named = judgement.verdict in {"named", "class"}
    known = any(set(r.fit.names) == set(other.fit.names) for r in judgement.sets)
    if (
        not named
        or known
        or other.fit.bic - min(r.fit.bic for r in judgement.sets) > judgement.reach
    ):
        return judgement
    return replace(judgement, verdict="class", sets=(*judgement.sets, other))


def judge(
    base: LackOfFit,
    singles: list[Ranked],
    sets: list[Ranked],
    floor: float,
    *,
    exceeds_noise: bool = False,
) -> Judgement:
    """Return the verdict.

    `sets` contains only larger sets of which all members are needed. `floor` is the energy of
    encoder errors in the structure. `exceeds_noise` states that the base's residual is larger than
    noise.
    """
    best_single = singles[0] if singles else None
    sure = [r for r in singles if certain(r, floor, exceeds_noise=exceeds_noise)]
    if not sure and not exceeds_noise and not leaves_structure(base, floor):
        return Judgement("no_missing_effect", (), None, max(base.excess, 0.0), floor=floor)
    closest = min([*sets, *sure], key=lambda r: r.fit.bic, default=best_single)
    excess = excess_of(base, closest)
    singles, sets = (without_empty_extensions(found, excess) for found in (singles, sets))
    sure = [r for r in sure if r in singles]
    sure, candidates = by_merit(sure, excess, floor), by_merit([*sets, *sure], excess, floor)
    most = max((r.gain for r in candidates), default=0.0)
    candidates = [r for r in candidates if not _surpassed(r, sets)]
    fits = [adequate(r, excess, most, floor) for r in candidates]
    if any(fits):
        # A set that BIC prefers to every adequate set fits no worse: the adequate ones only have
        # more parameters that adapt to the structure.
        likeliest = min(r.fit.bic for r, fit in zip(candidates, fits, strict=True) if fit)
        fitting = [
            r for r, fit in zip(candidates, fits, strict=True) if fit or r.fit.bic < likeliest
        ]
        closest = min(fitting, key=lambda r: r.fit.bic)
        reach = scaled_by_doubt(closest, WITHIN_REACH_BIC) + _tolerance(closest, excess, floor)
        # Adequate effects that are not certain also join the class: the data do not exclude them.
        unsure = [r for r in singles if r not in sure and adequate(r, excess, most, floor)]
        unsure = [r for r in unsure if not _surpassed(r, sets)]
        near = tuple(
            r
            for r in (*fitting, *unsure)
            if r is fitting[0] or (_preference(r, closest) < reach and not _part_of(r, closest))
        )
        if near[0].lacks_named_property:
            return Judgement("unexplained", (), None, excess, floor=floor)
        near = tuple(r for r in near if not r.lacks_named_property)
        near = tuple(sorted(near, key=lambda r: bool(r.at_bound)))
        verdict: Verdict = "named" if len(near) == 1 else "class"
        return Judgement(verdict, near, None, excess, reach, floor)
    return replace(_partial_or_unexplained(sure, excess), floor=floor)


def _partial_or_unexplained(sure: list[Ranked], excess: float) -> Judgement:
    """Return `partial` if one effect clearly leads, else `unexplained` with a hint of family."""
    if not sure:
        return Judgement("unexplained", (), None, excess)
    best = sure[0]
    share = explains(best, excess)
    rivals = [r for r in sure[1:] if family_of(r) != family_of(best)]
    lead = share - max((explains(r, excess) for r in rivals), default=0.0)
    if share >= PARTIAL_SHARE and lead >= 0.25:
        return Judgement("partial", (best,), family_of(best), excess)
    hint = family_of(best) if share >= HINT_SHARE and lead >= 0.1 else None
    return Judgement("unexplained", (), hint, excess)
