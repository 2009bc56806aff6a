"""A force that stays one number while the tool presses: its sensor is dead or saturated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]

LONGEST_S = 0.5
"""For so long no living force is one number to its last digit [s]: the slowest amplifiers of load
cells convert ten times a second, and five conversions of a cell under a changing load differ."""
LEAST_TRAVEL = 0.2
"""Of the travel in contact: by so much the tool moves meanwhile [1]. At rest a force may stay, and
a sensor whose step is a fifth of its whole range in contact measures nothing."""


def stuck_force(trial: TrialConfig, slave: Mapping[str, Array]) -> list[str]:
    """Return the note that the force was one number while the tool pressed and moved; else nothing.

    A tool presses where the estimators see a contact, and beyond the surface that they have found:
    a sensor that dies with zero ends the contact for them. Without any contact, a force that
    is one number all the time is noted as well.
    """
    if not slave:
        return []
    used = slave["valid"] > 0
    force, position = slave["force"][used], slave["position"][used]
    pressing = (slave["in_contact"][used] > 0) | (position > slave["surface"][used])
    touched = bool(pressing.any())
    if not touched and force.size and np.ptp(force) == 0.0:
        pressing[:] = True
    least = LONGEST_S * trial.rig.rate_hz
    if np.count_nonzero(pressing) < least:
        return []
    travel = LEAST_TRAVEL * float(np.ptp(position[pressing]))
    for rows in _suspects(force, pressing):
        moved = float(np.ptp(position[rows])) if rows.any() else 0.0
        if np.count_nonzero(rows) >= least and moved > 0.0 and moved >= travel:
            return [_note(trial, force[rows][0], int(np.count_nonzero(rows)), moved, touched)]
    return []


def _suspects(force: Array, pressing: Rows) -> Iterator[Rows]:
    """Give the longest stretch (n,) of one force while the tool presses, and the most repeated one.

    That is where many short presses reach the end of a sensor.
    """
    held = pressing[1:] & pressing[:-1] & (np.diff(force) == 0.0)
    edges = np.flatnonzero(np.diff(held, prepend=False, append=False))
    starts, ends = edges[::2], edges[1::2]
    longest: Rows = np.zeros(force.size, dtype=np.bool_)
    if starts.size:
        at = int(np.argmax(ends - starts))
        longest[starts[at] : ends[at] + 1] = True
    yield longest
    repeated, counts = np.unique(force[1:][held], return_counts=True)
    if counts.size:
        yield pressing & (force == repeated[np.argmax(counts)])


def _note(trial: TrialConfig, force: float, count: int, moved: float, touched: bool) -> str:
    """Return the sentence; `moved` is the tool's way meanwhile [rig's unit of position]."""
    units, small = trial.rig.units, "mm" if trial.rig.units.position == "m" else "mrad"
    said = (
        f"the force was one number, {force:.4g} {units.force}, in {count} samples "
        f"({count / trial.rig.rate_hz:.3g} s) while the tool moved by {1e3 * moved:.3g} {small}"
    )
    if touched:
        return f"{said} in contact: its sensor is dead or saturated; check it, its range and wiring"
    return f"{said}: unless nothing was touched, its sensor is dead; check it and its wiring"
