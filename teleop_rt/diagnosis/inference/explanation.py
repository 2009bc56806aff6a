"""Probabilities and verdict of sets that all leave more than noise.

The residual of each set contains an unknown remainder, larger than the noise: one function of
motion and time with a free size, of which a recording shows `UNKNOWN_DIRECTIONS` independent
values. With that size integrated out, -2 log p of a set is UNKNOWN_DIRECTIONS * log(energy), where
energy is that of its residual on inner blocks (a t distribution; Kennedy and O'Hagan 2001).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, log

from teleop_rt.contact.effect import Family
from teleop_rt.diagnosis.criteria import (
    EFFECT_COST,
    HIGHEST_BESIDE_UNKNOWN,
    HIGHEST_PROBABILITY,
    LEAST_CONFIDENCE,
    LEAST_GAIN,
    LEAST_SHARE,
    LOWEST_BOUND,
    MOST_SETS,
    NAMED_SHARE,
    NOISE_POWER_DOUBT,
    POSTERIOR_MASS,
    UNKNOWN_DIRECTIONS,
    WITHIN_REACH_BIC,
)
from teleop_rt.diagnosis.inference.one_more import same_physics
from teleop_rt.diagnosis.inference.ranked import family_of
from teleop_rt.diagnosis.inference.sets import Scored
from teleop_rt.diagnosis.inference.tones import adds_tone
from teleop_rt.diagnosis.inference.verdict import Judgement, Verdict, simpler_names

_NEARLY_AS_GOOD = 1.0 - LEAST_SHARE

_ROUNDING = 1e-12  # share of the base's energy; smaller ones are rounding errors


@dataclass(frozen=True)
class Explanation:
    """The verdict on the sets tried; `sets` likeliest first, each effect with a fifth or more.

    `probability` of each of their effects is conditional on the vocabulary and the sets tried.
    """

    verdict: Verdict
    sets: tuple[Scored, ...]
    family: Family | None
    probability: Mapping[str, float]


def explain(
    tried: Sequence[Scored],
    noise: float = 0.0,
    apart: Callable[[Scored, Scored], float] | None = None,
) -> Explanation:
    """Return the verdict and the probabilities of the sets tried, which include the base alone.

    `noise` is the mean square [force^2] of the noise, of which no set explains a share: sets that
    leave less than the noise fit equally well. `apart` is the mean square [force^2] by which the
    predictions of two sets differ: more than `MOST_SETS` are an answer if this motion makes them
    one explanation with many names.
    """
    known = _by_names([_down_to_noise(one, noise) for one in tried])
    excess = max(known[frozenset()].energy - noise, 0.0)
    weights = _weights(known, noise)
    parts = [(one, weight, _named_part(one, known, excess)) for one, weight in weights]
    naming = [one for one, _, part in parts if part]
    mass: dict[frozenset[str], float] = defaultdict(float)
    for one, weight, part in parts:
        if part or not _named_set_fits_as_well(one, naming):
            mass[part] += weight
    whole = sum(mass.values())
    mass = defaultdict(float, {part: weight / whole for part, weight in mass.items()})
    chosen: list[frozenset[str]] = []
    for names in sorted(mass, key=lambda n: -mass[n]):
        chosen.append(names)
        if sum(mass[n] for n in chosen) >= POSTERIOR_MASS:
            break
    # If the class contains a law and its special case, the special case comes first.
    chosen = sorted(chosen, key=lambda n: not set(chosen).isdisjoint(_special_cases(known[n])))
    probability = {
        n: min(HIGHEST_BESIDE_UNKNOWN, sum(w for names, w in mass.items() if n in names))
        for n in frozenset[str]().union(*chosen)
    }
    common = frozenset.intersection(*chosen)
    is_part = len(chosen) > 1 and common in chosen
    if is_part:  # what the larger sets add is possible, and not certain
        chosen = [common]
    sets = tuple(known[names] for names in chosen)
    family = _family(sets)
    many = len(sets) > MOST_SETS and not _predict_alike(sets, apart)
    if many or not sets[0].names:
        return Explanation("unexplained", (), family, {})
    if is_part or sets[0].energies[0] - sets[0].energy < NAMED_SHARE * excess:
        return Explanation("partial", sets, family, probability)
    return Explanation("named" if len(sets) == 1 else "class", sets, family, probability)


def _predict_alike(sets: Sequence[Scored], apart: Callable[[Scored, Scored], float] | None) -> bool:
    """Return whether the sets differ by less than the smallest effect that is named beside them."""
    most = LEAST_SHARE * (sets[0].energies[0] - sets[0].energy)
    return apart is not None and all(apart(sets[0], one) <= most for one in sets[1:])


def likelihoods(judgement: Judgement) -> dict[str, float]:
    """Return the probability [0 to `HIGHEST_PROBABILITY`] of each effect of a class.

    Its sets leave noise alone, so their weights follow Schwarz's criterion. Differences are scaled
    down if an uncertain noise level increased the `reach` at which a set is excluded.
    """
    if not judgement.sets:
        return {}
    least = min(ranked.fit.bic for ranked in judgement.sets)
    scale = 0.5 * WITHIN_REACH_BIC / max(judgement.reach, WITHIN_REACH_BIC)
    weights = [exp(-scale * (ranked.fit.bic - least)) for ranked in judgement.sets]
    found: dict[str, float] = defaultdict(float)
    for ranked, weight in zip(judgement.sets, weights, strict=True):
        for name in set(ranked.fit.names):
            found[name] += weight / sum(weights)
    return {name: min(HIGHEST_PROBABILITY, probability) for name, probability in found.items()}


def highest_probability(ratio: float) -> float:
    """Return the highest probability of a set whose held-out error is `ratio` times the noise.

    A set that leaves more may have a wrong name: of 447 answers to recordings by others, 95 % were
    right that left at most 1.02 times the noise, 82 % at 1.15 times, 57 % at 1.75 times, and 44 %
    beyond 2. That is about the inverse.
    """
    return max(HIGHEST_PROBABILITY / max(ratio, 1.0), LOWEST_BOUND)


def bounded_by_error(judgement: Judgement, ratio: float) -> Judgement:
    """Return the judgement with probabilities no higher than its error allows.

    `ratio` is the held-out error over that of the noise. A set that is wrong more often than right
    is partly named: something else is left.
    """
    highest = highest_probability(ratio)
    found = judgement.probability or likelihoods(judgement)
    probability = {name: min(p, highest) for name, p in found.items()}
    if judgement.verdict == "named" and highest < LEAST_CONFIDENCE:
        family = family_of(judgement.sets[0])
        judgement = replace(judgement, verdict="partial", family=family)
    return replace(judgement, probability=probability)


def predictor(tried: Sequence[Scored], named: Collection[str] = ()) -> Scored:
    """Return the smallest set whose energy on inner blocks is within `LEAST_GAIN` of the least.

    Sets with a law of time that is not `named` are excluded: such a law describes this recording
    alone and increases the error on another one.
    """
    timeless = [one for one in tried if not one.laws_of_time - set(named)]
    least = min(one.energy for one in timeless)
    near = [one for one in timeless if (1.0 - LEAST_GAIN) * one.energy <= least]
    return min(near, key=lambda one: (len(one.names), one.energy))


def _down_to_noise(one: Scored, noise: float) -> Scored:
    return replace(one, energies=tuple(max(energy, noise) for energy in one.energies))


def _by_names(tried: Sequence[Scored]) -> dict[frozenset[str], Scored]:
    """Return the best laws of each set of names; laws within their bounds come first.

    Such laws must explain at least four fifths of the energy that the best laws, at their bounds,
    explain.
    """
    best: dict[frozenset[str], Scored] = {}
    known: dict[frozenset[str], Scored] = {}
    for one in sorted(tried, key=lambda one: one.energy):
        least = best.setdefault(one.names, one)
        taken, most = (each.energies[0] - each.energy for each in (one, least))
        if one is least or (
            known[one.names].unsupported and not one.unsupported and taken >= _NEARLY_AS_GOOD * most
        ):
            known[one.names] = one
    return known


def _weights(known: Mapping[frozenset[str], Scored], noise: float) -> list[tuple[Scored, float]]:
    """Return the posterior mass of each set, by its energy above the certain part of the noise.

    Sets that extend a special case and gain nothing over it are left out.
    """
    sets = [one for one in known.values() if not _special_case_fits_as_well(one, known)]
    certain = (1.0 - NOISE_POWER_DOUBT) * noise
    base = known[frozenset()].energy - certain
    shares = [max((one.energy - certain) / base, _ROUNDING) for one in sets]
    costs = [EFFECT_COST * len(one.names) for one in sets]
    scores = [
        UNKNOWN_DIRECTIONS * log(share) + cost for share, cost in zip(shares, costs, strict=True)
    ]
    weights = [exp(-0.5 * (score - min(scores))) for score in scores]
    total = sum(weights)
    return [(one, weight / total) for one, weight in zip(sets, weights, strict=True)]


def _special_cases(one: Scored) -> list[frozenset[str]]:
    """Return the sets in which one effect is replaced by its special case.

    Without contact, Coulomb friction is a special case of hysteresis (one that yields at once).
    """
    found = simpler_names(one.names)
    if "hysteresis" in one.names and not one.fit.model.base.touches:
        found.append(one.names - {"hysteresis"} | {"coulomb_friction"})
    return found


def _special_case_fits_as_well(one: Scored, known: Mapping[frozenset[str], Scored]) -> bool:
    simpler = [known[names] for names in simpler_names(one.names) if names in known]
    return any((1.0 - LEAST_GAIN) * plain.energy <= one.energy for plain in simpler)


def _named_set_fits_as_well(one: Scored, naming: Sequence[Scored]) -> bool:
    """Return whether a named set with as few effects fits as well as this one without a name.

    A law at a bound that fits no better is no evidence against the named set.
    """
    few = (other for other in naming if len(other.names) <= len(one.names))
    return any((1.0 - LEAST_GAIN) * other.energy <= one.energy for other in few)


def _named_part(
    one: Scored, known: Mapping[frozenset[str], Scored], excess: float
) -> frozenset[str]:
    """Return the effects of a set that each explain a fifth or more of the base's excess.

    A smaller effect counts if the effects before it explain too little to be named without it
    (`NAMED_SHARE`), and it explains four fifths of their residual above the noise: no other law
    explains that much of the error of a law's form.
    The effect that explains most comes first: a damping tried before a friction would absorb its
    share. Of two equal effects, the one within its bounds comes first. The energy of a tone is no
    part of the excess of which later effects take their shares: it grows with the recording.
    Another law of the same physics only corrects the first one and is not named. If the data do
    not support the name of an effect, the set with its special case is returned where that explains
    nearly as much, or else the part of the set that explains most by itself, of those that the data
    support. A special case that fits as well comes first.
    """
    names, order, named = frozenset[str](), list[str](), 0
    energy = known[names].energy
    noise = energy - excess
    tones = {effect.name for effect in one.fit.model.effects if adds_tone(effect)}
    while rest := [names | {n} for n in one.names - names if names | {n} in known]:
        longer = min(
            rest, key=lambda n: known[n].energy / (1.0 - LEAST_GAIN * bool(known[n].unsupported))
        )
        order, names = [*order, *(longer - names)], longer
        # The law of a larger set may be another one, within its bounds, that fits less well.
        taken, left = max(energy - known[names].energy, 0.0), energy - noise
        completes = left > (1.0 - NAMED_SHARE) * excess and taken >= _NEARLY_AS_GOOD * left
        if completes or taken >= LEAST_SHARE * excess:
            named = len(order)
            excess -= taken if order[-1] in tones else 0.0
        energy -= taken
    best = _distinct(order[:named], one, known)
    taken = one.energies[0] - known[best].energy
    special = [n for n in simpler_names(best) if n in known
               and one.energies[0] - known[n].energy >= _NEARLY_AS_GOOD * taken]  # fmt: skip
    as_good = [n for n in special if (1.0 - LEAST_GAIN) * known[n].energy <= known[best].energy]
    parts = sorted((n for n in known if n < best), key=lambda n: known[n].energy)
    ways = (*as_good, best, *special, *parts)
    return next(n for n in ways if known[n].nameable or _supported_in(one, n))


def _supported_in(one: Scored, names: frozenset[str]) -> bool:
    """Return whether a set's data support these names of it, if not each by itself.

    Alone, a law may end at a bound because it takes the force of the others.
    """
    return names <= one.names and names.isdisjoint(one.unsupported)


def _distinct(
    order: Sequence[str], one: Scored, known: Mapping[frozenset[str], Scored]
) -> frozenset[str]:
    """Return the effects without those with the same physics as an earlier one."""
    effects = {effect.name: effect for effect in one.fit.model.effects}
    kept: list[str] = []
    for name in order:
        if not any(same_physics(effects[name], effects[other]) for other in kept):
            kept.append(name)
    return frozenset(kept) if frozenset(kept) in known else frozenset(order)


def _family(sets: Sequence[Scored]) -> Family | None:
    """Return the family of the first effect, where all sets agree in it."""
    first = {one.fit.model.effects[0].family if one.names else None for one in sets}
    return first.pop() if len(first) == 1 else None
