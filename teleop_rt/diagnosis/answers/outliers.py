"""Isolated wrong samples of the force as an effect of the answer."""

from __future__ import annotations

from typing import Any

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.answers.answer import effect_entry, entry
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.diagnosis.samples.outliers import OUTLIERS
from teleop_rt.recordings.rows import stretches

OUTLIERS_ASIDE = (
    "{percent:.2g} % of the force's samples stand alone, far from their neighbours, and were left"
    " out; they do not explain the residual: check the sensor's cable and shielding"
)
_FEWEST_BURSTS = 3  # of one wrong sample or a few that make an effect
_SMALLEST_SHARE = 2e-4  # of all samples; fewer outliers are no effect
_LEAST_P_VALUE = 1e-3  # below it bursts depend on the motion; of four rows, by chance in 1 of 250


def of_motion(found: Vector, motion: RecordedMotion) -> bool:
    """Return whether the samples found follow the motion, as the impacts of a play do.

    Errors of a channel do not depend on depth, speed or acceleration, so their samples have the
    same distribution as all others (Kolmogorov and Smirnov). Samples of one burst are one event.
    """
    hit = found > 0.0
    bursts = np.array([first for first, _ in stretches(hit)], dtype=np.int64)
    if bursts.size < _FEWEST_BURSTS:
        return False
    chances = [
        chance_of_one_source(row[bursts], row[~hit])
        for row in (motion.x, motion.v, np.abs(motion.v), np.abs(motion.a))
    ]
    return min(chances) < _LEAST_P_VALUE


def chance_of_one_source(some: Vector, others: Vector) -> float:
    """Return the chance that two samples of one distribution differ as much (at most 1).

    Twice that of one sample and one side (Birnbaum and Tingey, Ann. Math. Stat. 22, 1951), of as
    many values as the two determine: exact where the difference is large.
    """
    places = np.concatenate((some, others))
    first, second = (np.searchsorted(np.sort(row), places, side="right") / row.size
                     for row in (some, others))  # fmt: skip
    apart = float(np.max(np.abs(first - second)))
    size = max(round(some.size * others.size / places.size), 1)
    j = np.arange(np.ceil(size * (1.0 - apart)))
    if not (apart and j.size):
        return 0.0 if apart else 1.0
    factorials = np.concatenate(([0.0], np.cumsum(np.log(np.arange(1, size + 1)))))
    ways = factorials[size] - factorials[: j.size] - factorials[size - j.astype(np.int64)]
    ways += (j - 1.0) * np.log(apart + j / size) + (size - j) * np.log(1.0 - apart - j / size)
    return min(2.0 * apart * float(np.sum(np.exp(ways))), 1.0)


def effect_of(found: Vector) -> dict[str, Any] | None:
    """Return the effect `outliers` for JSON, or None where too few samples stand alone."""
    share = float(np.sum(found)) / found.size
    if len(stretches(found > 0.0)) < _FEWEST_BURSTS or share < _SMALLEST_SHARE:
        return None
    deviation = float(np.sqrt(share * (1.0 - share) / found.size))
    return effect_entry(find(OUTLIERS), {"share": entry(share, deviation**2, "1")})


def _of_one_reading(found: Vector, force: Vector) -> bool:
    """Return whether most of the samples found have one reading, which no motion gives.

    A dead channel's reading shows only where the force is far from it, and so with the motion.
    """
    counts = np.unique(force[found > 0.0], return_counts=True)[1]
    return bool(2 * np.max(counts, initial=0) > np.sum(counts))


def add_to(answer: dict[str, Any], found: Vector, force: Vector, motion: RecordedMotion) -> None:
    """Add outliers of the `force` to an answer: to its effects, and to every set of its class."""
    effect = effect_of(found)
    if effect is not None and (_of_one_reading(found, force) or not of_motion(found, motion)):
        join(answer, effect)


def join(answer: dict[str, Any], effect: dict[str, Any]) -> None:
    """Add the effect `outliers` to an answer that does not hold it.

    An unexplained answer only gets a note, because outliers do not explain its residual.
    """
    if answer["verdict"] == "unexplained":
        share = effect["parameters"]["share"]["value"]
        answer["notes"].append(OUTLIERS_ASIDE.format(percent=100.0 * share))
        return
    answer["effects"].append(effect)
    if answer["verdict"] == "no_missing_effect":
        answer["verdict"], answer["class"] = "named", [[effect["name"]]]
    elif answer["verdict"] in {"named", "class"}:
        answer["class"] = [[*names, effect["name"]] for names in answer["class"]]
