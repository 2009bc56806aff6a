"""Pairs of effects of which both members are needed."""

from __future__ import annotations

from collections.abc import Callable

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.criteria import CERTAIN_BIC, NAMED_SHARE
from teleop_rt.diagnosis.inference.pairs import MOST_PAIRS, exchanged, fit_without, search_pairs
from teleop_rt.diagnosis.inference.ranked import Ranked, certain, excess_of, leaves_structure
from teleop_rt.diagnosis.inference.ranking import Ranking
from teleop_rt.diagnosis.inference.second import both_needed, extension_needed
from teleop_rt.diagnosis.inference.tones import adds_tone
from teleop_rt.diagnosis.inference.verdict import simpler_names
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.noise.structure import LackOfFit


def needed_pairs(
    rank: Ranking, left: LackOfFit, singles: list[Ranked], effects: tuple[Effect, ...]
) -> tuple[list[Ranked], list[Ranked]]:
    """Return the pairs of which both members are needed, and the single effects, best first.

    Pairs are searched only if the best single effect leaves structure. `left` is the lack of fit of
    the base. A pair whose second member has no effect has found a better optimum of the first; that
    optimum replaces the single fit.
    """
    if not singles or not certain(singles[0], rank.floor):
        return [], singles
    floor = max(rank.floor, rank.floor_of(singles[0].fit))
    alike = not singles[0].tone_or_air_force and singles[0].air_mismatch <= 1.0 - NAMED_SHARE
    if alike and not leaves_structure(singles[0].left, floor):
        return [], singles
    ranked = _likeliest_pairs(rank, singles, effects, floor)
    likeliest = min([*ranked, *singles], key=lambda r: r.fit.bic)
    excess = _excess_beside_tone(left, singles[0], likeliest)
    known = {r.fit.names[0]: r for r in singles}

    def better(pair: Ranked) -> bool:
        """Return whether no single effect fits as well as the pair."""
        return pair.fit.bic < min(r.fit.bic for r in known.values()) - CERTAIN_BIC

    def needed(pair: Ranked) -> bool:
        return better(pair) and both_needed(rank.problem, pair, known, excess, floor)

    before, chosen = dict(known), list(filter(needed, ranked))
    for pair in chosen:
        _improve_singles(rank, pair.fit, known)
    if any(known[name] is not single for name, single in before.items()):
        chosen = list(filter(needed, ranked))
    pairs = _likelier_than_form(chosen, ranked, known)
    pairs = _beside_special_cases(
        pairs,
        [pair for pair in ranked if better(pair)],
        lambda pair, simpler: extension_needed(rank.problem, pair, simpler, known, excess, floor),
    )
    return pairs, sorted(known.values(), key=lambda r: r.fit.bic)


def _beside_special_cases(
    pairs: list[Ranked], tried: list[Ranked], needed_over: Callable[[Ranked, Ranked], bool]
) -> list[Ranked]:
    """Return the pairs and their special cases among those `tried`, unless one is needed over it.

    The special case of a needed pair may absorb more of the other effect, which then gains less
    beside it.
    """

    def extends(pair: Ranked, simpler: Ranked) -> bool:
        return frozenset(simpler.fit.names) in simpler_names(frozenset(pair.fit.names))

    plain = [one for one in tried if any(extends(pair, one) for pair in pairs)]
    every = pairs + [one for one in plain if not any(one is pair for pair in pairs)]
    return [one for one in every if not any(extends(p, one) and needed_over(p, one) for p in every)]


def _likelier_than_form(
    pairs: list[Ranked], tried: list[Ranked], singles: dict[str, Ranked]
) -> list[Ranked]:
    """Return the pairs without those that fit no better than the form error of their first effect.

    A likelier pair among those `tried` that is not needed shows how large that error may be.
    """

    def first(pair: Ranked) -> str:
        known = [name for name in pair.fit.names if name in singles]
        return min(known, key=lambda name: singles[name].fit.bic, default=pair.fit.names[0])

    spare = [pair for pair in tried if not any(pair is one for one in pairs)]
    return [
        pair
        for pair in pairs
        if not any(first(o) == first(pair) and o.fit.bic < pair.fit.bic for o in spare)
    ]


def _excess_beside_tone(left: LackOfFit, single: Ranked, best: Ranked) -> float:
    """Return the energy of the base's residual above the noise, but for that of a `single` tone.

    The energy of a line grows with the recording and would hide every other effect. `best` is the
    likeliest set.
    """
    excess = excess_of(left, best)
    tone = adds_tone(single.fit.model.effects[0])
    return max(excess - single.gain, 0.0) if tone else excess


def _likeliest_pairs(
    rank: Ranking,
    singles: list[Ranked],
    effects: tuple[Effect, ...],
    floor: float,
) -> list[Ranked]:
    """Return the likeliest pairs, with exchanged members of the best.

    If the best pair leaves structure, members of other families are tried as well.
    """
    fits = search_pairs(rank.problem, rank.base, [r.fit for r in singles], effects)
    ranked = [rank(fit) for fit in fits[:MOST_PAIRS]]
    if not ranked:
        return []
    known = {frozenset(r.fit.names): r for r in ranked}
    complete = not leaves_structure(ranked[0].left, floor)
    others = exchanged(rank.problem, ranked[0].fit, effects, within_family=complete)
    for fit in others[:MOST_PAIRS]:
        names = frozenset(fit.names)
        if names not in known or fit.bic < known[names].fit.bic:
            known[names] = rank(fit)
    return sorted(known.values(), key=lambda r: r.fit.bic)


def _improve_singles(rank: Ranking, pair: Fit, known: dict[str, Ranked]) -> None:
    """Replace single fits by better ones that start from the parameters of a pair."""
    for member, effect in enumerate(pair.model.effects):
        if effect.name in known:
            alone = fit_without(rank.problem, pair, 1 - member)
            if alone.chi2 < known[effect.name].fit.chi2 - CERTAIN_BIC:
                known[effect.name] = rank(alone)
