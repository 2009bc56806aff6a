"""Where an on-line prediction of force errs: while it settles, by noise, or by neither."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from teleop_rt.realtime.reading import read_topics

_SLAVE = "/slave"
_SIGNALS = ("stamp_ns", "filtered_force", "predicted_force")
_FAST_S = 0.1
"""Window [s] in which a hand, of some 5 Hz at most, changes a force smoothly; the remainder beside
the mean of that window is noise, or the transient of a touch."""
_CAUSE_SHARE = 0.5
"""Share of an error's growth, in energy, from which one cause is said."""
_Row = NDArray[np.float64]


@dataclass(frozen=True)
class OnLineError:
    """Root mean squares [rig's force] of an error: of both halves of the contact, and its noise.

    `noise` is that part of the second half which varies within `_FAST_S`.
    """

    first: float
    second: float
    noise: float


def on_line_error(time_s: _Row, measured: _Row, predicted: _Row) -> OnLineError | None:
    """Return the parts of the error where there is a prediction; None with too little of it."""
    width = max(3, round(_FAST_S / float(np.median(np.diff(time_s)))))
    weights = np.ones(width) / width
    whole = np.isfinite(measured) & np.isfinite(predicted)
    error = np.where(whole, measured - predicted, 0.0)
    # Beside a sample without a prediction the mean of a window is not that of the error.
    inside = np.convolve(whole, weights, mode="same") > 1.0 - 0.5 / width
    places = np.flatnonzero(whole)
    later = np.flatnonzero(inside & (np.arange(whole.size) >= places[places.size // 2 :][:1]))
    if not later.size:
        return None
    halves = (places[: places.size // 2], places[places.size // 2 :])
    first, second = (float(np.sqrt(np.mean(error[half] ** 2))) for half in halves)
    fast = error[later] - np.convolve(error, weights, mode="same")[later]
    return OnLineError(first, second, float(np.sqrt(np.mean(fast**2))))


def cause_of_error(before: Path, after: Path, unit: str) -> str | None:
    """Return in words where the recorded run `after` predicts worse than the run `before`.

    None where either recording has too little of a prediction.
    """
    without, found = (_read(path) for path in (before, after))
    if without is None or found is None:
        return None
    figures = (
        f"{found.first:.2g} {unit} in the first half of the contact ({without.first:.2g} before),"
        f" {found.second:.2g} in the second ({without.second:.2g}),"
        f" of which {found.noise:.2g} is noise ({without.noise:.2g})"
    )
    early, late = (
        a**2 - b**2 for a, b in ((found.first, without.first), (found.second, without.second))
    )
    if early > _CAUSE_SHARE * (early + max(late, 0.0)):
        return f"most of the increase occurs while the parameters settle: {figures}"
    if found.noise**2 - without.noise**2 > _CAUSE_SHARE * late:
        return f"the compensation adds noise: {figures}"
    return f"the error varies slowly, and remains after the parameters settle: {figures}"


def _read(path: Path) -> OnLineError | None:
    rows = read_topics(path, [_SLAVE], {_SLAVE: _SIGNALS}).get(_SLAVE)
    if rows is None or rows["stamp_ns"].size < 2:
        return None
    stamps = rows["stamp_ns"]
    time_s = 1e-9 * (stamps - stamps[0])
    return on_line_error(time_s, rows["filtered_force"], rows["predicted_force"])
