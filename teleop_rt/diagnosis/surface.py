"""Where the surface lies in a recording, and whether there is contact at all."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.recording import Recording
from teleop_rt.errors import RecordingError

_NEAR = 0.25
_MIN_CONTACT_SAMPLES = 100
_STIFFEST_N_PER_M = 1e6
_LONGEST_M = 2.0


def force_noise(force: Vector) -> float:
    """Return the standard deviation of the force's fast noise, from third differences."""
    third = np.diff(force, 3)
    robust = float(np.median(np.abs(third - np.median(third)))) / 0.6745
    if robust <= 0.0:
        robust = float(np.std(third))
    return robust / float(np.sqrt(20.0))


def surface_of(recording: Recording) -> float:
    """Return the surface [rig unit], from the recording itself or from the onset of force.

    A position that already counts from the surface is kept so: where the onset lies within a
    quarter of the largest penetration from 0, or cannot be seen for lack of free air, the surface
    is 0 (its error then is what `contact_offset` says). Raises RecordingError without contact.
    """
    if recording.surface is not None:
        return recording.surface
    position, force = recording.position, recording.force
    noise = force_noise(force)
    level = float(np.quantile(force, 0.99) - np.quantile(force, 0.01))
    if level < 6.0 * noise:
        raise RecordingError(
            f"{recording.name}: no contact: the force varies by {level:.3g} only, within its noise"
        )
    deepest = float(np.max(position))
    order = np.argsort(position)
    free = force[order[: max(20, order.size // 100)]]
    threshold = float(np.median(free)) + max(6.0 * noise, 0.03 * level)
    start = float(np.median(free))
    light = (force > threshold) & (force < 5.0 * threshold - 4.0 * start)
    # The onset is where the line through the light contacts meets the force of free air.
    onset = 0.0
    if np.count_nonzero(light) > _MIN_CONTACT_SAMPLES // 10:
        slope, height = np.polyfit(position[light], force[light], 1)
        onset = float((start - height) / slope) if slope > 0.0 else float(np.min(position[light]))
    seen = onset > float(np.min(position)) + 0.02 * (deepest - float(np.min(position)))
    if not seen or (deepest > 0.0 and abs(onset) <= _NEAR * (deepest - onset)):
        return 0.0
    return onset


def refuse_unlearnable(recording: Recording, penetration: Vector, noise: float) -> None:
    """Raise RecordingError where there is no contact, or no movement in it."""
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
