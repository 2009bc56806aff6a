"""A set confirmed by the unweighted residual, whatever the noise model takes slow residuals to be.

A noise model that is free in colour may take what a second effect does to be slow noise. The plain
residual gives it away: a set that explains what is missing takes most of it off.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.diagnosis.answers import held_out
from teleop_rt.diagnosis.criteria import ANOTHER_DRAW, LOUD, NAMED_SHARE, PARTIAL_SHARE
from teleop_rt.diagnosis.inference.verdict import Judgement, family_of
from teleop_rt.diagnosis.models.fit import Fit, Problem


def confirmed_unweighted(
    judgement: Judgement, alike: Problem, base: Fit, noise: float, in_air: float
) -> Judgement:
    """Return the judgement without the sets that leave most of what the base leaves of the force.

    `alike` is the problem in which all frequencies weigh alike, `base` the base fitted there, and
    `noise` the standard deviation that noise alone leaves by its model, `in_air` by what free air
    shows of it: what is far louder than that must be explained as any excess must. If the best set
    is one of these and no other is confirmed, it is reported as a part.
    """
    if judgement.verdict not in {"named", "class"}:
        return judgement
    where = held_out.counted(alike, base) > 0.0

    def power(fit: Fit) -> float:
        return float(np.mean((alike.force - held_out.predict(alike, fit))[where] ** 2))

    before = power(base)

    def takes(share: float, after: float, above: float, least: float) -> bool:
        beyond = after - least**2
        return after < (above * least) ** 2 or beyond < (1.0 - share) * (before - least**2)

    def takes_most(fit: Fit) -> bool:
        after = power(alike.refine(fit.model, fit.zeta))
        by_model = takes(PARTIAL_SHARE, after, ANOTHER_DRAW, noise)
        return by_model and takes(NAMED_SHARE, after, LOUD, in_air)

    if takes_most(judgement.sets[0].fit):
        return judgement
    sets = tuple(ranked for ranked in judgement.sets[1:] if takes_most(ranked.fit))
    if sets:
        return replace(judgement, verdict="named" if len(sets) == 1 else "class", sets=sets)
    best = judgement.sets[0]
    return replace(judgement, verdict="partial", sets=(best,), family=family_of(best))
