"""Where the surface lies in a recording, and whether there is contact at all."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.recording import Recording, RecordingError

_NEAR = 0.25


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
    touching = position[force > threshold]
    onset = float(np.quantile(touching, 0.02)) if touching.size else 0.0
    seen = onset > float(np.min(position)) + 0.02 * (deepest - float(np.min(position)))
    if not seen or (deepest > 0.0 and abs(onset) <= _NEAR * (deepest - onset)):
        return 0.0
    return onset
