"""From fitted candidates to a verdict: a name, a class, or the admission that it is unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf, sqrt
from statistics import fmean, pvariance
from typing import Literal

from teleop_rt.contact.effect import Family
from teleop_rt.diagnosis.criteria import (
    BY_NO_DRAW,
    CERTAIN_BIC,
    DOUBT_WEIGHT,
    ENCODER_TIMES,
    EXTENDED_GAIN,
    HINT_SHARE,
    NAMED_SHARE,
    PARTIAL_SHARE,
    SAME_SHARE,
    SIGMAS,
    WITHIN_REACH_BIC,
)
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.noise.structure import LackOfFit

Verdict = Literal["no_missing_effect", "named", "class", "partial", "unexplained"]
# The first holds the second as a special case, and so fits at least as well.
_EXTENDS = {
    "stribeck_friction": "coulomb_friction",
    "direction_dependent_damping": "viscous_friction",
    "second_layer": "contact_offset",
}


@dataclass(frozen=True)
class Ranked:
    """A candidate set with what it leaves: structure, and its gain over the base.

    `uneven` is by how much the residuals in contact and in free air differ, as a share.
    `lacks_property` where an effect fits as well without what it is named after: a damping that
    differs by direction, equal in both.
    `along` is the energy that encoder errors put along what the set adds to the base, `passed` what
    the effects themselves make of them in the structure that is left, `by_encoder` all that the set
    leaves of them beside its fit, one for each draw; known of the best fits alone. `apart` where it
    leaves what no form of a law could: a tone, or a force in free air. `chance` is what noise puts
    along what the set adds, of one whose shape was not searched.
    """

    fit: Fit
    gain: float
    delta_bic: float
    left: LackOfFit
    uneven: float = 0.0
    lacks_property: bool = False
    along: float = inf
    passed: float = 0.0
    by_encoder: tuple[float, ...] = ()
    apart: bool = False
    chance: float | None = None


@dataclass(frozen=True)
class Judgement:
    """The verdict; `sets` best first; `excess` is the energy that the base leaves unexplained.

    `reach` is by how much the data must prefer one set to another to exclude it, `floor` the energy
    that the encoder's errors put into the structure.
    """

    verdict: Verdict
    sets: tuple[Ranked, ...]
    family: Family | None
    excess: float
    reach: float = WITHIN_REACH_BIC
    floor: float = 0.0
    probability: Mapping[str, float] = field(default_factory=dict)


def excess_of(base: LackOfFit, best: Ranked | None) -> float:
    """Return the energy above the noise that the base leaves."""
    by_candidate = best.gain + max(best.left.excess, 0.0) if best else 0.0
    return max(base.excess, by_candidate)


def explains(ranked: Ranked, excess: float, slack: float = 0.0) -> float:
    """Return the share of the excess that a set explains, of 0 to 1.

    `slack` is what it may leave and explain all that can be seen (see `slack_of`).
    """
    if excess <= 0.0:
        return 0.0
    return float(min(1.0, max(0.0, 1.0 - max(ranked.left.excess - slack, 0.0) / excess)))


def slack_of(ranked: Ranked, floor: float) -> float:
    """Return what a set may leave by chance, and of the encoder's errors (`floor`)."""
    return SIGMAS / 2.0 * ranked.left.deviation + max(floor, _passed_on(ranked))


def adequate(ranked: Ranked, excess: float, most: float, floor: float) -> bool:
    """Return whether a set explains 95 % of the excess, as far as the noise lets one see.

    `most` is the largest gain of any set: what another explains, this one must explain too.
    `floor` is the energy of the encoder's errors, which no effect explains; a set that passes more
    of them on than the base leaves more, which counts where it gains well beyond that.
    """
    share = (1.0 - NAMED_SHARE) * excess
    left = max(ranked.left.excess, most - ranked.gain)
    return left <= share + slack_of(ranked, floor) and ranked.uneven <= 1.0 - NAMED_SHARE


def _passed_on(ranked: Ranked) -> float:
    """Return what of a set's leftover may be its making of the encoder's errors.

    Nothing where it gains no more than they make.
    """
    likely = min(ranked.passed, max(ranked.left.excess, 0.0))
    return likely if ranked.gain > ENCODER_TIMES * ranked.passed else 0.0


def something_left(left: LackOfFit, floor: float) -> bool:
    """Return whether structure is left beyond chance and beyond what encoder errors make."""
    return left.excess > SIGMAS * left.deviation + ENCODER_TIMES * floor


def certain(ranked: Ranked, floor: float, *, loud: bool = False) -> bool:
    """Return whether a single effect is beyond chance and twice (in force) above the input floor.

    Where the noise is red its level is doubtful, and the gain counts for less, unless what the base
    leaves is so `loud` that it is none. Of the input floor counts what lies along the effect:
    errors at each touch put nothing along a bias. But an effect that gains less than it leaves to
    the encoder is not distinguished from it by a few draws, unless these put next to nothing along
    it: a mass's errors make no drift.
    """
    penalty = ranked.gain - ranked.delta_bic
    chance = ranked.left.chance if ranked.chance is None else ranked.chance
    gain = ranked.gain / (chance if loud else _doubted(ranked, chance))
    beyond = ENCODER_TIMES * min(floor, ranked.along)
    if ranked.gain < BY_NO_DRAW * ranked.along and not something_left(ranked.left, floor):
        beyond = max(beyond, min(floor, ranked.left.excess))
    return gain - penalty > CERTAIN_BIC and ranked.gain > beyond


def _doubted(ranked: Ranked, difference: float) -> float:
    """Return a difference of chi-square, larger where the noise's level is doubtful."""
    return difference * (1.0 + DOUBT_WEIGHT * ranked.left.doubt)


def _tolerance(closest: Ranked, excess: float, floor: float) -> float:
    """Return the energy below which differences between laws do not distinguish them.

    A law that misses the data by some energy is not distinguished from another by less, and half a
    percent of the excess is not worth a distinction. Where the closest law leaves no structure at
    all the data decide.
    """
    misfit = max(closest.left.excess, 0.0)
    return max(misfit, SAME_SHARE * excess) if something_left(closest.left, floor) else misfit


def _preference(rival: Ranked, closest: Ranked) -> float:
    """Return by how much the data prefer the closest set to a rival.

    A single effect that fits as well belongs to the class, whatever its number of parameters: one
    that only contains a simpler effect was left out before. A set of more is judged by them.
    """
    by_bic = rival.fit.bic - closest.fit.bic
    if len(rival.fit.names) == 1 and len(closest.fit.names) == 1:
        by_bic = min(rival.fit.chi2 - closest.fit.chi2, by_bic)
    return by_bic - _owed_to_encoder(rival, closest)


def _owed_to_encoder(rival: Ranked, closest: Ranked) -> float:
    """Return by how much encoder errors alone may have put a set behind the closest one.

    A mass makes more force of them than a bias does, right or wrong. Their mean over the draws, and
    two deviations of it: among draws, and by what the force's noise makes of them.
    """
    more = [a - b for a, b in zip(rival.by_encoder, closest.by_encoder, strict=False)]
    mean = fmean(more) if more else 0.0
    return mean + 2.0 * sqrt(pvariance(more) + 4.0 * mean) if mean > 0.0 else 0.0


def without_empty_extensions(candidates: list[Ranked], excess: float) -> list[Ranked]:
    """Leave out sets with an effect that holds another one as a special case and gains nothing.

    Nothing could ever exclude them: no motion shows a Stribeck effect of size zero. They must gain
    on the set with the simpler effect more than chance gives them, and more than what is worth a
    distinction.
    """
    by_names = {frozenset(r.fit.names): r for r in candidates}

    def says_more(ranked: Ranked) -> bool:
        simpler = (by_names.get(names) for names in simpler_names(frozenset(ranked.fit.names)))
        least = max(EXTENDED_GAIN, SAME_SHARE * excess)
        return all(ranked.gain - plain.gain > least for plain in simpler if plain is not None)

    return [r for r in candidates if says_more(r)]


def by_merit(candidates: list[Ranked], excess: float, floor: float) -> list[Ranked]:
    """Return the candidates by Schwarz's criterion, best first, misfit counted as dispersion.

    Where even the closest candidate leaves structure, a law with more shape parameters gains
    from bending after it; dividing chi-square by the misfit per degree of freedom
    (quasi-likelihood) keeps the simpler law in front. What a set passes on of the encoder's errors
    is no misfit of its law.
    """
    if not candidates:
        return []
    closest = min(candidates, key=lambda r: r.fit.chi2)
    dispersion = 1.0 + _tolerance(closest, excess, floor) / max(closest.left.rank, 1)

    def merit(ranked: Ranked) -> float:
        penalty = ranked.fit.bic - ranked.fit.chi2
        return (ranked.fit.chi2 - _passed_on(ranked)) / dispersion + penalty

    return sorted(candidates, key=merit)


def simpler_names(names: frozenset[str]) -> list[frozenset[str]]:
    """Return the sets in which one effect is replaced by a special case of it."""
    return [names - {n} | {_EXTENDS[n]} for n in names if n in _EXTENDS]


def _outdone(ranked: Ranked, pairs: list[Ranked]) -> bool:
    """Return whether a pair makes what a set of one leaves apart from all that its law could."""
    names = set(ranked.fit.names)
    return ranked.apart and any(names < set(p.fit.names) and not p.apart for p in pairs)


def family_of(ranked: Ranked) -> Family:
    """Return the family of the set's first effect."""
    return ranked.fit.model.effects[0].family


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
    pairs: list[Ranked],
    floor: float,
    *,
    loud: bool = False,
) -> Judgement:
    """Return the verdict.

    `pairs` hold only such whose members were both found necessary. `floor` is the energy that
    encoder errors put into the structure. `loud` where the base leaves more than any noise could.
    """
    best_single = singles[0] if singles else None
    sure = [r for r in singles if certain(r, floor, loud=loud)]
    if not sure and not loud and not something_left(base, floor):
        return Judgement("no_missing_effect", (), None, max(base.excess, 0.0), floor=floor)
    closest = min([*pairs, *sure], key=lambda r: r.fit.bic, default=best_single)
    excess = excess_of(base, closest)
    singles, pairs = (without_empty_extensions(found, excess) for found in (singles, pairs))
    sure = [r for r in sure if r in singles]
    sure, candidates = by_merit(sure, excess, floor), by_merit([*pairs, *sure], excess, floor)
    most = max((r.gain for r in candidates), default=0.0)
    candidates = [r for r in candidates if not _outdone(r, pairs)]
    fits = [adequate(r, excess, most, floor) for r in candidates]
    if any(fits):
        # What the likelihood prefers to every adequate set fits no worse: such a set only had
        # more parameters to bend after the structure.
        likeliest = min(r.fit.bic for r, fit in zip(candidates, fits, strict=True) if fit)
        fitting = [
            r for r, fit in zip(candidates, fits, strict=True) if fit or r.fit.bic < likeliest
        ]
        closest = min(fitting, key=lambda r: r.fit.bic)
        reach = _doubted(closest, WITHIN_REACH_BIC) + _tolerance(closest, excess, floor)
        # Also what is not beyond chance by itself: the data that do not exclude it do not name.
        unsure = [r for r in singles if r not in sure and adequate(r, excess, most, floor)]
        unsure = [r for r in unsure if not _outdone(r, pairs)]
        near = tuple(
            r for r in (*fitting, *unsure) if r is fitting[0] or _preference(r, closest) < reach
        )
        if near[0].lacks_property:
            return Judgement("unexplained", (), None, excess, floor=floor)
        near = tuple(r for r in near if not r.lacks_property)
        verdict: Verdict = "named" if len(near) == 1 else "class"
        return Judgement(verdict, near, None, excess, reach, floor)
    return replace(_short_of_a_name(sure, excess), floor=floor)


def _short_of_a_name(sure: list[Ranked], excess: float) -> Judgement:
    """Return partial, where one effect clearly leads, or unexplained with a hint."""
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
