"""A set confirmed by the unweighted residual, whatever the noise model takes slow residuals to be.

A noise model that is free in colour may take what a second effect does to be slow noise. The plain
residual gives it away: a set that explains what is missing takes most of it off.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.diagnosis.answers import held_out
from teleop_rt.diagnosis.inference.verdict import (
    HINT_SHARE,
    NAMED_SHARE,
    PARTIAL_SHARE,
    Judgement,
    family_of,
)
from teleop_rt.diagnosis.models.fit import Fit, Problem

_NEAR_NOISE, _LOUD = 1.3, 2.0
_LOUDEST_NOISE = 0.3  # of the force; no sensor in use is that noisy, so what is left is no noise


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
        by_model = takes(PARTIAL_SHARE, after, _NEAR_NOISE, noise)
        return by_model and takes(NAMED_SHARE, after, _LOUD, in_air)

    if takes_most(judgement.sets[0].fit):
        return judgement
    sets = tuple(ranked for ranked in judgement.sets[1:] if takes_most(ranked.fit))
    if sets:
        return replace(judgement, verdict="named" if len(sets) == 1 else "class", sets=sets)
    best = judgement.sets[0]
    return replace(judgement, verdict="partial", sets=(best,), family=family_of(best))


def louder_than_sensors(judgement: Judgement, base: float, best: float) -> Judgement:
    """Take a name back where what it leaves is no sensor's noise, whatever its spectrum.

    `base` and `best` are the standard deviations of the residuals over that of the force. A noise
    model that is free in colour takes up what nobody can explain; its loudness gives it away.
    """
    if judgement.verdict not in {"named", "class"} or best < _LOUDEST_NOISE:
        return judgement
    hint = family_of(judgement.sets[0]) if best**2 < (1.0 - HINT_SHARE) * base**2 else None
    if best**2 < (1.0 - PARTIAL_SHARE) * base**2:
        return replace(judgement, verdict="partial", sets=judgement.sets[:1], family=hint)
    return replace(judgement, verdict="unexplained", sets=(), family=hint)
