"""The settling time of an estimate, found afterwards from its last value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation.parameters import leading
from teleop_rt.estimation.trace import Trace

BAND = 0.02
"""Share of its last value within which a parameter has settled, as is usual for step responses."""


def settling_times(trace: Trace) -> list[float | None]:
    """Return for each row the time [s] after which k, or m without a k, stayed in the band.

    It counts in contact for models of a contact, else from the first sample; None for a row that
    has no estimate at the end.
    """
    touching = trace.signals[:, 0] > 0.0
    return [_settled_s(trace, row, touching) for row in range(len(trace.rows))]


def _settled_s(trace: Trace, row: int, touching: NDArray[np.bool_]) -> float | None:
    estimated = trace.status[:, row] > 0.0
    if not estimated.size or not estimated[-1]:
        return None
    values = trace.physical(row, leading(trace.rows[row]))
    counted = touching if trace.rows[row].declared.in_contact_only else np.ones_like(touching)
    return float(np.count_nonzero(counted[: last_outside(values, estimated)]) * trace.period_s)


def last_outside(values: Vector, estimated: NDArray[np.bool_]) -> int:
    """Return how many of the values (n,) go before those that all lie in the band of the last."""
    inside = estimated & (np.abs(values - values[-1]) <= BAND * abs(values[-1]))
    outside = np.flatnonzero(~inside)
    return int(outside[-1]) + 1 if outside.size else 0
