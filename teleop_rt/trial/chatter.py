"""A tool that chatters on a body by itself, faster than a hand moves it: in one note."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig
from teleop_rt.master.swings import SMALLEST_FORCE, SMALLEST_SWING, SUSTAINED

Array = NDArray[np.float64]

LOWEST_HZ = 15.0
"""Slowest chatter: tremor of a hand reaches 12 Hz, and the tool follows it."""
SAMPLES = 8
"""Samples of a cycle at least: fewer are noise of the encoder."""


class Chatter(NamedTuple):
    """All that a tool chattered in a run."""

    began_s: float
    """Its beginning, from the first tick [s]."""
    lasted_s: float
    """Its duration, pauses left out [s]."""
    frequency_hz: float
    swing: float
    """Largest swing of the tool's force [N or Nm]."""
    left_hz: float
    """How often the tool lost the contact in a second."""


def chatter_note(trial: TrialConfig, slave: Mapping[str, Array]) -> list[str]:
    """Return the note that the tool chattered: how fast, how hard, and the next step."""
    if (found := chatter(trial, slave)) is None:
        return []
    said = (
        f"the tool chattered on the body at {found.frequency_hz:.0f} Hz for {found.lasted_s:.2g} s "
        f"in all, from {found.began_s:.1f} s on: its force swung by up to {found.swing:.3g} "
        f"{trial.rig.units.force}, and it lost the contact {found.left_hz:.0f} times a second"
    )
    if trial.contact.surface_tracking_hz == 0.0:
        return [f"{said}; if the surface moves, set contact.surface_tracking_hz"]
    step = "use a link with a shorter round trip, or raise slave.force_cap if the body bears it"
    return [f"{said}; {step}"]


def chatter(trial: TrialConfig, slave: Mapping[str, Array]) -> Chatter | None:
    """Return how the tool chattered; None where it did not.

    Its cycles are of 15 Hz and more, above the swing and the force that count for a handle, and as
    many in a row as there. The force swings by more than an onset of contact takes, and each cycle
    has a contact.
    """
    if not slave:
        return None
    from scipy.signal import find_peaks  # noqa: PLC0415 - no daemon waits for it

    used = slave["valid"] > 0
    t_s = 1e-9 * (slave["stamp_ns"][used] - slave["stamp_ns"][0])
    peaks, _ = find_peaks(slave["position"][used], prominence=SMALLEST_SWING)
    if peaks.size <= SUSTAINED:
        return None
    force, touches = slave["force"][used], slave["in_contact"][used] > 0
    swings = (np.maximum.reduceat(force, peaks) - np.minimum.reduceat(force, peaks))[:-1]
    counts = np.logical_or.reduceat(touches, peaks)[:-1]
    counts &= swings > max(SMALLEST_FORCE, trial.contact.onset_force)
    counts &= (np.diff(t_s[peaks]) < 1.0 / LOWEST_HZ) & (np.diff(peaks) >= SAMPLES)
    edges = np.flatnonzero(np.diff(counts, prepend=False, append=False))
    rows = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= SUSTAINED]
    if not rows:
        return None
    lasted_s = sum(float(t_s[peaks[b]] - t_s[peaks[a]]) for a, b in rows)
    left = touches[:-1] & ~touches[1:]
    return Chatter(
        began_s=float(t_s[peaks[rows[0][0]]]),
        lasted_s=lasted_s,
        frequency_hz=sum(int(b - a) for a, b in rows) / lasted_s,
        swing=max(float(swings[a:b].max()) for a, b in rows),
        left_hz=sum(int(np.count_nonzero(left[peaks[a] : peaks[b]])) for a, b in rows) / lasted_s,
    )
