"""How far an estimate runs behind parameters that vary."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector


def tracking_delay(t: Vector, estimate: Vector, truth: Vector) -> float | None:
    """Return the delay [s] at which the estimate fits the delayed truth best.

    t (samples,) equidistant [s], estimate and truth (samples,) in any one unit. None where truth
    does not vary, or the estimate does not follow it at all (correlation below a half). Delays up
    to half the record are searched.
    """
    step = float(t[1] - t[0])
    if np.ptp(truth) == 0.0 or np.ptp(estimate) == 0.0:
        return None
    longest = len(t) // 2
    stride = max(1, longest // 500)
    errors = [_error(estimate, truth, shift) for shift in range(0, longest, stride)]
    coarse = int(np.argmin(errors)) * stride
    fine = range(max(0, coarse - stride), min(longest, coarse + stride + 1))
    best = min(fine, key=lambda shift: _error(estimate, truth, shift))
    delayed = np.concatenate([np.full(best, truth[0]), truth[: len(truth) - best]])
    if np.ptp(delayed) == 0.0 or np.corrcoef(estimate, delayed)[0, 1] < 0.5:
        return None
    return best * step


def _error(estimate: Vector, truth: Vector, shift: int) -> float:
    """Return the mean square difference between an estimate and truth delayed by `shift`."""
    head = float(np.sum((estimate[:shift] - truth[0]) ** 2))
    tail = float(np.sum((estimate[shift:] - truth[: len(truth) - shift]) ** 2))
    return (head + tail) / len(truth)
