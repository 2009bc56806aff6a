"""The error of a fitted set on inner blocks: its linear parameters were fitted without them.

This error chooses the sets. The answer's error uses other blocks.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.least_squares import centred, signed_solution
from teleop_rt.diagnosis.models.predict import columns

BLOCKS = 40
"""Blocks of a recording, each hidden alone: as many as `UNKNOWN_DIRECTIONS`. Short blocks let
evidence from a single press, such as a layer that no other press reaches, lie in several."""


def blind_energy(problem: Problem, fit: Fit) -> float:
    """Return the mean square [force^2] of the fit's residual on blocks hidden from it.

    Free air counts, because the pull of a neck acts only there. Shape parameters keep their fitted
    values, because a single block has little influence on them.
    """
    parts = columns(Course.of(fit.model, problem.motion, fit.zeta), fit.theta)
    where = problem.whitener.mask > 0.0
    target = (problem.force - parts.offset)[where]
    if not parts.columns:
        return float(np.mean(target**2))
    rows = np.array(parts.columns)[:, where]
    deviation = float(np.sqrt(np.mean((target - fit.theta @ rows) ** 2)))
    rows, _ = centred(rows, fit.model.base.bias_place)
    weak = held_out.prior(rows, problem.force[where]) * deviation
    both = np.concatenate([rows, target[None, :]])
    edges = np.searchsorted(np.flatnonzero(where), np.arange(BLOCKS + 1) * where.size // BLOCKS)
    blocks = [slice(*ends) for ends in pairwise(edges.tolist())]
    products = [rows[:, block] @ both[:, block].T for block in blocks]
    whole = np.sum(products, axis=0) + np.eye(*products[0].shape) * np.append(weak, 0.0) ** 2
    left = np.empty(target.size)
    for block, own in zip(blocks, products, strict=True):
        left[block] = (
            target[block] - signed_solution(whole - own, fit.model.nonnegative) @ rows[:, block]
        )
    return float(np.mean(left**2))
