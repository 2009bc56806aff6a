"""Confirmation of a named set by the unweighted residual.

A noise model with free colour may absorb a second effect as slow noise. The unweighted residual
still contains that effect, so a complete set must reduce most of it.
"""

from __future__ import annotations

from dataclasses import replace

from teleop_rt.diagnosis.criteria import (
    EXCESS_NOISE_RATIO,
    NAMED_SHARE,
    PARTIAL_SHARE,
    REDRAWN_NOISE_RATIO,
)
from teleop_rt.diagnosis.inference.ranked import family_of
from teleop_rt.diagnosis.inference.verdict import Judgement
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.fit import Fit, Problem


def confirmed_unweighted(
    judgement: Judgement, unweighted: Problem, base: Fit, noise: float, in_air: float
) -> Judgement:
    """Return the judgement without sets that fail to reduce the base's unweighted residual.

    `unweighted` is the problem with equal weight on all frequencies, `base` the base fitted there.
    `noise` is the noise's standard deviation by its model, `in_air` the one observed in free air; a
    residual far above the latter must be explained like any excess. If no set is confirmed, the
    best one is reported as a part.
    """
    if judgement.verdict not in {"named", "class"}:
        return judgement
    where = held_out.counted(unweighted, base) > 0.0
    before = unweighted.mean_square(base, where)

    def reduces(share: float, after: float, ratio: float, noise: float) -> bool:
        excess = after - noise**2
        return after < (ratio * noise) ** 2 or excess < (1.0 - share) * (before - noise**2)

    def confirmed(fit: Fit) -> bool:
        after = unweighted.mean_square(unweighted.refine(fit.model, fit.zeta), where)
        by_model = reduces(PARTIAL_SHARE, after, REDRAWN_NOISE_RATIO, noise)
        return by_model and reduces(NAMED_SHARE, after, EXCESS_NOISE_RATIO, in_air)

    if confirmed(judgement.sets[0].fit):
        return judgement
    sets = tuple(ranked for ranked in judgement.sets[1:] if confirmed(ranked.fit))
    if sets:
        return replace(judgement, verdict="named" if len(sets) == 1 else "class", sets=sets)
    best = judgement.sets[0]
    return replace(judgement, verdict="partial", sets=(best,), family=family_of(best))
