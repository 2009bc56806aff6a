"""Detection of a table whose columns of position and force seem to be exchanged."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from teleop_rt.errors import RecordingError
from teleop_rt.recordings.column_names import exchanged
from teleop_rt.recordings.recording import Recording

Array = NDArray[np.float64]

EXCHANGED = (
    "columns exchanged? the position rests at one level, as a force does in free air, while the"
    " force moves from its lowest value up to where the position begins to move, as a tool does"
    " on its way to a surface; exchange them with "
)
_LEVELS = 33
"""Levels into which a range is divided to find the usual one: 3 % each, above any noise."""
_OUTLIERS = (0.001, 0.999)  # quantiles: a thousandth at either end may be wrong samples
_SPREAD = (0.02, 0.98)  # quantiles, of a part of the samples: fewer of them, so a larger share
_RESTS = (0.1, 0.9)
"""Share of the samples at the usual level. A sinusoid rests for 0.09 of its time at either end, and
a held step for nearly all of it."""
_MOVES = 0.15
"""Share of its range by which a position moves in free air, where a force does not."""
_FROM_LOWEST = 0.05
"""Of the range: so near its lowest value is a tool that is led away from a surface."""
_ONLY_THERE = 0.9
"""Share of the samples below the surface in which the other signal rests."""


def exchange_note(recording: Recording) -> str | None:
    """Return the note that position and force seem to be exchanged, None where nothing shows it.

    In free air the force rests at its noise while the tool moves, and no other signal shows this:
    a motion that is held sees the force start at a surface or a step, and never at its lowest.
    """
    known = recording.mask > 0.0
    position, force = recording.position[known], recording.force[known]
    lowest, highest = np.quantile(force, _OUTLIERS)
    if not (np.ptp(np.quantile(position, _OUTLIERS)) > 0.0 and highest > lowest):
        return None
    rests = _at_usual_level(position)
    least, surface = (np.quantile(force[rests], _SPREAD) - lowest) / (highest - lowest)
    below = force <= np.quantile(force[rests], _SPREAD[1])
    found = (
        _RESTS[0] < float(np.mean(rests)) < _RESTS[1]
        and least < _FROM_LOWEST
        and surface - least > _MOVES
        and float(np.mean(rests[below])) > _ONLY_THERE
        and _spread(position, _at_usual_level(force)) < _MOVES
    )
    return f"{EXCHANGED}{exchanged(recording.columns)}" if found else None


@contextmanager
def stands_beside_refusals(hint: str | None) -> Iterator[None]:
    """Add the hint at exchanged columns to a RecordingError, which may be their consequence."""
    try:
        yield
    except RecordingError as error:
        if hint is None or hint in str(error):
            raise
        raise RecordingError(f"{error}; {hint}") from None


def _at_usual_level(signal: Array) -> NDArray[np.bool_]:
    """Return where a signal (n,) is within a level of its most usual one."""
    lowest, highest = np.quantile(signal, _OUTLIERS)
    counts, edges = np.histogram(signal, bins=_LEVELS, range=(lowest, highest))
    usual = int(np.argmax(counts))
    level = 0.5 * (edges[usual] + edges[usual + 1])
    near: NDArray[np.bool_] = np.abs(signal - level) <= (highest - lowest) / _LEVELS
    return near


def _spread(signal: Array, where: NDArray[np.bool_]) -> float:
    """Return the range of a signal (n,) in these samples, as a share of the whole."""
    inner = float(np.ptp(np.quantile(signal[where], _SPREAD)))
    return inner / float(np.ptp(np.quantile(signal, _OUTLIERS)))
