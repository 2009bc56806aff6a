"""The error of a fitted set on blocks of the recording that its linear parameters have not seen.

Sets are chosen by it. Its blocks are not those by which the answer's error is judged.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from teleop_rt.diagnosis.answers import held_out
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.least_squares import signed_solution
from teleop_rt.diagnosis.models.predict import columns

BLOCKS = 40
"""Of a recording, each hidden alone: as many as there are independent values of what is unknown.
What a single press shows, as a layer that no other reaches, must not lie in one of them alone."""


def blind_energy(problem: Problem, fit: Fit) -> float:
    """Return the mean square [force^2] of what the fit leaves of blocks hidden from it.

    Free air counts: a neck pulls there alone. The shapes stay as fitted: a block
    determines these few parameters hardly at all.
    """
    parts = columns(Course.of(fit.model, problem.motion, fit.zeta), fit.theta)
    where = problem.whitener.mask > 0.0
    target = (problem.force - parts.offset)[where]
    if not parts.columns:
        return float(np.mean(target**2))
    rows = np.array(parts.columns)[:, where]
    nonnegative = np.array([linear.nonnegative for linear in fit.model.linear], dtype=bool)
    deviation = float(np.sqrt(np.mean((target - fit.theta @ rows) ** 2)))
    weak = held_out.prior(rows, problem.force[where]) * deviation
    both = np.concatenate([rows, target[None, :]])
    edges = np.searchsorted(np.flatnonzero(where), np.arange(BLOCKS + 1) * where.size // BLOCKS)
    blocks = [slice(*ends) for ends in pairwise(edges.tolist())]
    products = [rows[:, block] @ both[:, block].T for block in blocks]
    whole = np.sum(products, axis=0) + np.eye(*products[0].shape) * np.append(weak, 0.0) ** 2
    left = np.empty(target.size)
    for block, own in zip(blocks, products, strict=True):
        left[block] = target[block] - signed_solution(whole - own, nonnegative) @ rows[:, block]
    return float(np.mean(left**2))
