"""Comparison of the beginning of a recording that starts in contact with the rest."""

from __future__ import annotations

import numpy as np

from teleop_rt.diagnosis.models.fit import Fit, Problem

_BLOCK_S = 0.05  # s over which the residual is averaged: fast noise cancels
_FEWEST_STRETCHES = 3  # later stretches as long as the beginning; fewer show no typical residual
_MISFIT_RATIO = 2.0  # times the largest later residual; slow noise drifts by less


def misfits(whole: Problem, used: Problem, fit: Fit) -> bool:
    """Return whether a fit of the used part of a recording does not describe its beginning.

    `whole` counts the samples of the beginning, `used` does not. Slow noise drifts between
    stretches, so the residual of the beginning must exceed that of any later stretch as long.
    """
    counted, kept = whole.whitener.mask > 0.0, used.whitener.mask > 0.0
    begins = int(np.argmax(kept))
    width = max(round(_BLOCK_S / used.motion.dt), 1)
    left = np.where(counted, whole.residual(fit), 0.0)
    starts = np.arange(0, left.size, width)
    sums, numbers = np.add.reduceat(left, starts), np.add.reduceat(counted.astype(float), starts)
    blocks, full = (sums / np.maximum(numbers, 1.0)) ** 2, numbers > 0.5 * width
    early = begins // width
    later = [
        float(np.mean(blocks[first : first + early][full[first : first + early]]))
        for first in range(early, starts.size - early + 1, max(early, 1))
        if early and np.any(full[first : first + early])
    ]
    if len(later) < _FEWEST_STRETCHES or not np.any(full[:early]):
        return False
    return float(np.mean(blocks[:early][full[:early]])) > _MISFIT_RATIO**2 * max(later)
