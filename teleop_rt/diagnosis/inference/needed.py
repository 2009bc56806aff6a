"""Sets of two to four effects of which every member is needed."""

from __future__ import annotations

from collections.abc import Callable

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.criteria import CERTAIN_BIC, NAMED_SHARE
from teleop_rt.diagnosis.inference.one_more import (
    MOST_EFFECTS,
    MOST_RANKED,
    exchanged,
    fit_without,
    search_one_more,
)
from teleop_rt.diagnosis.inference.ranked import Ranked, certain, excess_of, leaves_structure
from teleop_rt.diagnosis.inference.ranking import Ranking
from teleop_rt.diagnosis.inference.second import all_needed, extension_needed, parts_of
from teleop_rt.diagnosis.inference.tones import adds_tone
from teleop_rt.diagnosis.inference.verdict import simpler_names
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.noise.structure import LackOfFit

_FIRSTS = 3  # needed sets beside which a third or fourth effect is searched
Known = dict[frozenset[str], Ranked]
"""The best law of each set of names."""


def needed_sets(
    rank: Ranking, left: LackOfFit, singles: list[Ranked], effects: tuple[Effect, ...]
) -> tuple[list[Ranked], list[Ranked]]:
    """Return the sets of which every member is needed, and the single effects, best first.

    Sets with one effect more are searched only if the likeliest leaves structure. `left` is the
    lack of fit of the base. A pair whose second member has no effect has found a better optimum of
    the first; that optimum replaces the single fit.
    """
    if not singles or not certain(singles[0], rank.floor):
        return [], singles
    shorter = firsts = singles
    needed: list[Ranked] = []
    while firsts and len(firsts[0].fit.names) < MOST_EFFECTS:
        best = firsts[0]
        floor = max(rank.floor, rank.floor_of(best.fit))
        alike = not best.tone_or_air_force and best.air_mismatch <= 1.0 - NAMED_SHARE
        if alike and not leaves_structure(best.left, floor):
            break
        tones = sum(r.gain for r in singles if adds_tone(r.fit.model.effects[0])
                    and r.fit.names[0] in best.fit.names)  # fmt: skip
        firsts, known, tried = _needed_longer(rank, left, firsts, shorter, effects, floor, tones)
        if shorter is singles:
            singles = sorted((known[frozenset(r.fit.names)] for r in singles), key=_bic)
        needed = [known.get(frozenset(r.fit.names), r) for r in needed]
        needed = [*(r for r in firsts if _complete(rank, r, known)), *needed]
        shorter = tried
    return needed, singles


def _bic(ranked: Ranked) -> float:
    return ranked.fit.bic


def _complete(rank: Ranking, found: Ranked, known: Known) -> bool:
    """Return whether a set is a pair, or leaves at most a twentieth of the rest of its best part.

    Each further effect takes a part of an unknown remainder.
    """
    if len(found.fit.names) == 2:
        return True
    if not leaves_structure(found.left, max(rank.floor, rank.floor_of(found.fit))):
        return True
    best = min((known[part] for part in parts_of(found.fit)), key=_bic)
    return found.left.excess <= (1.0 - NAMED_SHARE) * best.left.excess


def _needed_longer(
    rank: Ranking,
    left: LackOfFit,
    firsts: list[Ranked],
    shorter: list[Ranked],
    effects: tuple[Effect, ...],
    floor: float,
    tones: float,
) -> tuple[list[Ranked], Known, list[Ranked]]:
    """Return the needed sets with one effect more, their parts and all tried, best first.

    `firsts` are the sets that are extended, of the `shorter` ones. The gain of `tones` is no part
    of the excess: the energy of a line grows with the recording and would hide every other effect.
    """
    ranked = _likeliest(rank, firsts, effects, floor)
    excess = excess_of(left, min([*ranked, *shorter], key=_bic))
    excess = max(excess - tones, 0.0) if tones else excess
    known = {frozenset(r.fit.names): r for r in shorter}

    def better(one: Ranked) -> bool:
        """Return whether no shorter set fits as well."""
        return one.fit.bic < min(r.fit.bic for r in known.values()) - CERTAIN_BIC

    def needed(one: Ranked) -> bool:
        return better(one) and all_needed(rank.problem, one, known, excess, floor)

    if len(shorter[0].fit.names) > 1:
        for one in filter(better, ranked):
            _add_parts(rank, one.fit, known)
    before, chosen = dict(known), list(filter(needed, ranked))
    for one in chosen:
        _improve_parts(rank, one.fit, known)
    if any(known[names] is not part for names, part in before.items()):
        chosen = list(filter(needed, ranked))
    found = _likelier_than_form(chosen, ranked, known)
    found = _beside_special_cases(
        found,
        [one for one in ranked if better(one)],
        lambda one, simpler: extension_needed(rank.problem, one, simpler, known, excess, floor),
    )
    return sorted(found, key=_bic), known, ranked


def _beside_special_cases(
    sets: list[Ranked], tried: list[Ranked], needed_over: Callable[[Ranked, Ranked], bool]
) -> list[Ranked]:
    """Return the sets and their special cases among those `tried`, unless one is needed over it.

    The special case of a needed set may absorb more of the other effect, which then gains less
    beside it.
    """

    def extends(one: Ranked, simpler: Ranked) -> bool:
        return frozenset(simpler.fit.names) in simpler_names(frozenset(one.fit.names))

    plain = [one for one in tried if any(extends(larger, one) for larger in sets)]
    every = sets + [one for one in plain if not any(one is larger for larger in sets)]
    return [one for one in every if not any(extends(p, one) and needed_over(p, one) for p in every)]


def _likelier_than_form(found: list[Ranked], tried: list[Ranked], known: Known) -> list[Ranked]:
    """Return the sets without those that fit no better than the form error of their first part.

    A likelier set among those `tried` that is not needed shows how large that error may be.
    """

    def first(one: Ranked) -> frozenset[str]:
        parts = [part for part in parts_of(one.fit) if part in known]
        return min(parts, key=lambda part: known[part].fit.bic, default=parts_of(one.fit)[-1])

    spare = [one for one in tried if not any(one is other for other in found)]
    return [
        one
        for one in found
        if not any(first(o) == first(one) and o.fit.bic < one.fit.bic for o in spare)
    ]


def _likeliest(
    rank: Ranking,
    firsts: list[Ranked],
    effects: tuple[Effect, ...],
    floor: float,
) -> list[Ranked]:
    """Return the likeliest sets with one effect more, with exchanged members of the best.

    If the best pair leaves structure, members of other families are tried as well; a larger set
    that leaves some is no answer, only the beginning of the next.
    """
    of_sets = len(firsts[0].fit.names) > 1
    starts = [r.fit for r in firsts[: _FIRSTS if of_sets else len(firsts)]]
    fits = search_one_more(rank.problem, rank.base, starts, effects)
    ranked = [rank(fit) for fit in fits[:MOST_RANKED]]
    if not ranked:
        return []
    known = {frozenset(r.fit.names): r for r in ranked}
    complete = not leaves_structure(ranked[0].left, floor)
    if of_sets and not complete:
        return ranked
    others = exchanged(rank.problem, ranked[0].fit, effects, within_family=complete)
    for fit in others[:MOST_RANKED]:
        names = frozenset(fit.names)
        if names not in known or fit.bic < known[names].fit.bic:
            known[names] = rank(fit)
    return sorted(known.values(), key=_bic)


def _add_parts(rank: Ranking, fit: Fit, known: Known) -> None:
    """Add the parts of a set that were not searched."""
    for member, part in enumerate(parts_of(fit)):
        if part not in known:
            known[part] = rank(fit_without(rank.problem, fit, member))


def _improve_parts(rank: Ranking, fit: Fit, known: Known) -> None:
    """Replace parts of a set by better fits that start from its parameters."""
    for member, part in enumerate(parts_of(fit)):
        if part in known:
            alone = fit_without(rank.problem, fit, member)
            if alone.chi2 < known[part].fit.chi2 - CERTAIN_BIC:
                known[part] = rank(alone)
