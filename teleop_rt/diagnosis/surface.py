"""Where the surface lies in a recording, and whether there is contact at all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.recording import Recording
from teleop_rt.errors import RecordingError

_NEAR = 0.25
_FLAT = 0.1
_CORNERS = 60
_LAYERS = 3
_MOST_SAMPLES = 4000
_MIN_CONTACT_SAMPLES = 100
_STIFFEST_N_PER_M = 1e6
_LONGEST_M = 2.0
_PULLED = 0.2


def force_noise(force: Vector) -> float:
    """Return the standard deviation of the force's fast noise, from third differences."""
    third = np.diff(force, 3)
    robust = float(np.median(np.abs(third - np.median(third)))) / 0.6745
    if robust <= 0.0:
        robust = float(np.std(third))
    return robust / float(np.sqrt(20.0))


class Surface(NamedTuple):
    """Position of the surface [rig unit], and whether it was told or is only a guess."""

    position: float
    told: bool


def surface_of(recording: Recording) -> Surface:
    """Return the surface from the recording itself, or guessed from the onset of force.

    A position that already counts from the surface is kept so: where the onset lies within a
    quarter of the largest penetration from 0, or cannot be seen for lack of free air, the surface
    is 0 (its error then is what `contact_offset` says). A guess is off by what a damper's force
    does to the onset: some per cent of the penetration. Raises RecordingError without contact.
    """
    if recording.surface is not None:
        return Surface(recording.surface, told=True)
    position, force = recording.position, recording.force
    noise = force_noise(force)
    level = float(np.quantile(force, 0.99) - np.quantile(force, 0.01))
    if level < 6.0 * noise:
        raise RecordingError(
            f"{recording.name}: no contact: the force varies by {level:.3g} only, within its noise"
        )
    onset = _onset(position, force, recording.dt)
    deepest = float(np.max(position))
    if onset is None or (deepest > 0.0 and abs(onset) <= _NEAR * (deepest - onset)):
        return Surface(0.0, told=True)
    return Surface(onset, told=False)


def _onset(position: Vector, force: Vector, dt: float) -> float | None:
    """Return where the force begins to rise with the position; None if that is nowhere seen.

    Before it the force must be flat beside what it is after; a corner where it is not is one
    inside the body, and what lies before that corner is searched again.
    """
    every = max(1, position.size // _MOST_SAMPLES)
    rows = np.array([position, np.gradient(position, dt), force])[:, ::every]
    for _ in range(_LAYERS):
        corner, before, after = _corner(*rows)
        if abs(before) < _FLAT * after:
            return corner
        rows = rows[:, rows[0] <= corner]
        if rows.shape[1] < _MIN_CONTACT_SAMPLES:
            break
    return None


def _corner(position: Vector, speed: Vector, force: Vector) -> tuple[float, float, float]:
    """Return where two lines of force over position meet best, and the slopes before and after.

    Beyond the corner there is a damper as well. Drift, friction and noise in free air move it
    little.
    """
    best, found = np.inf, (0.0, 0.0, 0.0)
    for corner in np.linspace(np.min(position), np.max(position), _CORNERS + 1)[1:-1]:
        beyond = position > corner
        offset = position - corner
        lines = np.array([np.ones_like(force), np.where(beyond, 0.0, offset),
                          np.where(beyond, offset, 0.0), np.where(beyond, speed, 0.0)])  # fmt: skip
        theta, *_ = np.linalg.lstsq(lines.T, force, rcond=None)
        left = float(np.sum((force - theta @ lines) ** 2))
        if left < best:
            best, found = left, (float(corner), float(theta[1]), float(theta[2]))
    return found


def refuse_unlearnable(recording: Recording, penetration: Vector, noise: float) -> None:
    """Raise RecordingError without contact, without movement in it, or if contact pulls."""
    inside = penetration[penetration > 0.0]
    if inside.size < _MIN_CONTACT_SAMPLES:
        raise RecordingError(
            f"{recording.name}: no contact: {inside.size} samples lie beyond the surface; check"
            " the sign of the position (> 0 into the environment) and --surface"
        )
    if float(np.ptp(inside)) < 20.0 * noise:
        raise RecordingError(
            f"{recording.name}: no excitation: in contact the position moves by"
            f" {float(np.ptp(inside)):.3g} {recording.units[0]} only, close to its noise"
        )
    free = recording.force[penetration < 0.0]
    if free.size < _MIN_CONTACT_SAMPLES:
        return
    pressed = float(np.median(recording.force[penetration > 0.0]) - np.median(free))
    if -pressed > max(6.0 * force_noise(recording.force), _PULLED * float(np.ptp(recording.force))):
        raise RecordingError(
            f"{recording.name}: wrong sign? in contact the force is {pressed:.3g}"
            f" {recording.units[1]} against free air, but it counts positive when the tool presses;"
            " turn it with a minus before the column's name, --columns force=-NAME"
        )


def refuse_wrong_units(recording: Recording, stiffness: float | None) -> None:
    """Raise RecordingError where the figures hint at a wrong unit of a linear rig."""
    if recording.units[0] != "m":
        return
    travel = float(np.ptp(recording.position))
    if travel > _LONGEST_M:
        raise RecordingError(
            f"{recording.name}: wrong unit? the position moves by {travel:.3g} m; if it is in mm,"
            " say so with --units position=mm"
        )
    if stiffness is not None and stiffness > _STIFFEST_N_PER_M:
        raise RecordingError(
            f"{recording.name}: wrong unit? a spring of {stiffness:.2g} N/m is stiffer than what"
            " such a rig can press on; check the units of position and force"
        )
