"""Times of a run that its figures share: of rows, of the whole, of contact, and of a first look."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.view.charts import Limits, few_swings, spans
from teleop_rt.view.run_folder import Columns, Run

Array = NDArray[np.float64]
UNKNOWN = (0.0, 3.0)
"""Statuses `warming up` and `restarted`, in which an estimator's values are no estimate."""
_AFTER_FAULT_S = 0.2  # of the first look at a run that stopped: the force falls within it


def seconds(run: Run, columns: Columns) -> Array:
    """Return the time of each row in s since the slave's first tick."""
    return (columns["stamp_ns"] - run.start_ns) * 1e-9


def span(run: Run) -> Limits:
    """Return the ends of every time axis [s]: the slave's first tick and its last.

    The master begins to record before, and waits.
    """
    return 0.0, float(seconds(run, run.slave)[-1]) or run.period_s


def window(run: Run) -> Limits:
    """Return the interval [s] of the force shown at first: a few swings, or up to the fault."""
    t, slave = seconds(run, run.slave), run.slave
    start, end = few_swings(t, slave["position"], slave["in_contact"]) or span(run)
    stopped = np.flatnonzero(slave["fault"] > 0)
    if stopped.size:
        fault_s = float(t[stopped[0]])
        end, start = fault_s + _AFTER_FAULT_S, fault_s - (end - start)
    return max(0.0, start), min(end, span(run)[1])


def contacts(run: Run) -> tuple[Limits, ...]:
    """Return the spans of contact [s]."""
    return spans(seconds(run, run.slave), run.slave["in_contact"])
