"""The part of a long recording with the most information."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.recordings.filters import fast_length_within
from teleop_rt.recordings.recording import Recording

MOST_SAMPLES = 30_000  # 30 s at 1 kHz: an answer within a minute
_STEPS_PER_WINDOW = 4  # places tried: a quarter of the part is lost at most
_DECIMATED = 4  # times, from 1 kHz to the lowest rate of a search
_DECIMATED_PERIOD_S = 1.001e-3  # s; slower recordings are searched at their own rate


def most_active(recording: Recording) -> tuple[Recording, float]:
    """Return the part with the most movement of force and position, and its start [s].

    It has at most 30 000 samples: the busiest half minute of an hour shows all effects except a
    slower drift. The length is rounded down by at most a few hundredths so that it has small prime
    factors, and so has a fourth of it where a search takes every fourth sample: other lengths make
    Fourier transforms ten times slower. A part is copied, so that the whole need not stay in
    memory, and is its own most active part.
    """
    available = min(recording.position.size, MOST_SAMPLES)
    every = _DECIMATED if recording.dt < _DECIMATED_PERIOD_S else 1
    length = every * fast_length_within(available // every)
    starts = range(0, recording.position.size - length + 1, MOST_SAMPLES // _STEPS_PER_WINDOW)

    def movement(start: int) -> float:
        part = slice(start, start + length)
        work = float(np.std(recording.force[part])) * float(np.std(recording.position[part]))
        return work * float(np.mean(recording.mask[part]))

    best = max(starts, key=movement)
    part = slice(best, best + length)
    reference = recording.reference
    chosen = replace(
        recording,
        position=recording.position[part].copy(),
        force=recording.force[part].copy(),
        mask=recording.mask[part].copy(),
        reference=None if reference is None else reference[part].copy(),
        start_s=recording.start_s + best * recording.dt,
    )
    return chosen, chosen.start_s
