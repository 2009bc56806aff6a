"""The shares of several causes in one effect, which add up to the whole (Shapley 1953)."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from itertools import combinations
from math import factorial
from typing import TypeVar

from teleop_rt.diagnosis.inference.one_more import fit_without
from teleop_rt.diagnosis.models.fit import Fit, Problem

_Player = TypeVar("_Player", bound=Hashable)


def shapley(player: _Player, count: int, worth: Mapping[frozenset[_Player], float]) -> float:
    """Return the worth that a player adds to a set, averaged over the orders of all `count`."""
    total = 0.0
    for some, value in worth.items():
        if player in some:
            continue
        weight = factorial(len(some)) * factorial(count - len(some) - 1) / factorial(count)
        total += weight * (worth[some | {player}] - value)
    return max(0.0, total)


def shares_of_members(problem: Problem, base: Fit, best: Fit) -> list[float]:
    """Return the share of each effect of a fit in the gain of all of them; their sum is 1.

    It is the gain that the effect brings beside others, averaged over the orders in which they may
    be added: two effects of which either explains the same energy share it equally.
    """
    count = len(best.model.effects)
    everyone = frozenset(range(count))
    fits = {everyone: best}
    for size in range(count - 1, 0, -1):
        for some in map(frozenset, combinations(range(count), size)):
            left = min(everyone - some)
            larger = fits[some | {left}]
            fits[some] = fit_without(problem, larger, sorted(some | {left}).index(left))
    worth = {some: max(0.0, base.chi2 - fit.chi2) for some, fit in fits.items()}
    worth[frozenset()] = 0.0
    gains = [shapley(member, count, worth) for member in range(count)]
    whole = sum(gains)
    return [gain / whole if whole > 0.0 else 1.0 / count for gain in gains]
