"""Detection of a drive that moves freely: its force follows acceleration and speed, no depth."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.models.least_squares import within_bounds
from teleop_rt.diagnosis.samples.motion import differentiate
from teleop_rt.diagnosis.samples.smoothing import half_window
from teleop_rt.recordings.recording import Recording
from teleop_rt.recordings.rows import without_lone

FREE = (
    "the force follows acceleration and speed, and no contact shows: the base is {base}, of a drive"
    " that moves freely; for {stated}, give the place of the surface with --surface"
)
_FOLLOWS = 0.5  # of the force's variance, by a mass, a damper and dry friction
_RUBBING_SPEED = 0.02  # of the speed's deviation, over which dry friction reverses
_LARGEST = 10.0  # times the force's deviation; no part of it is larger
_MOST_SAMPLES = 4000  # of a recording; more are decimated, to save time


def moves_freely(recording: Recording) -> bool:
    """Return whether mass, damper and dry friction, none of them negative, give most of the force.

    The acceleration of a swing is opposite to its depth, so that a spring looks like a negative
    mass, which is excluded.
    """
    half = half_window(recording.position, recording.dt, 2)
    _, v, a = differentiate(recording.position, recording.dt, half)
    force = without_lone(recording.force)
    used = recording.mask > 0.0
    used[: 2 * half] = used[-2 * half :] = False
    step = max(1, force.size // _MOST_SAMPLES)
    a, v, force = (row[used][::step] for row in (a, v, force))
    scale = _RUBBING_SPEED * float(np.std(v)) if v.size else 0.0
    if scale <= 0.0:
        return False
    rows = np.array([_unit(row) for row in (a, v, np.tanh(v / scale))])
    wanted = force - np.mean(force)
    most = np.full(len(rows), _LARGEST * float(np.linalg.norm(wanted)))
    sizes = within_bounds(rows @ rows.T, rows @ wanted, np.zeros(len(rows)), most)
    left = wanted - sizes @ rows
    return bool(left @ left < (1.0 - _FOLLOWS) * float(wanted @ wanted))


def _unit(row: Vector) -> Vector:
    rest = row - np.mean(row)
    return np.asarray(rest / max(float(np.linalg.norm(rest)), 1e-300))
