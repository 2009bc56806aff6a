"""The part of a long recording that says most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.diagnosis.recording import Recording

MOST_SAMPLES = 30_000
_STEPS_PER_WINDOW = 4


def most_telling(recording: Recording) -> tuple[Recording, float]:
    """Return the part with the most movement of force and position, and its start [s].

    At most 30 000 samples: an hour has the structure of its busiest half minute, but for a drift
    slower than that, which is not seen. A shorter recording is returned whole.
    """
    size = recording.position.size
    if size <= MOST_SAMPLES:
        return recording, 0.0
    starts = range(0, size - MOST_SAMPLES + 1, MOST_SAMPLES // _STEPS_PER_WINDOW)

    def movement(start: int) -> float:
        part = slice(start, start + MOST_SAMPLES)
        work = float(np.std(recording.force[part])) * float(np.std(recording.position[part]))
        return work * float(np.mean(recording.mask[part]))

    best = max(starts, key=movement)
    part = slice(best, best + MOST_SAMPLES)
    reference = recording.reference
    chosen = replace(
        recording,
        position=recording.position[part],
        force=recording.force[part],
        mask=recording.mask[part],
        reference=None if reference is None else reference[part],
    )
    return chosen, best * recording.dt
