"""Detection of a force channel that reads an end of its range."""

from __future__ import annotations

import numpy as np

from teleop_rt.diagnosis.criteria import SIGMAS
from teleop_rt.recordings.recording import Recording
from teleop_rt.recordings.rows import force_noise, stretches

_EXTREME = 1e-3  # of the readings, which may be outliers, beyond each end of the range
_SLACK = 0.02  # of the range of the readings; the force of a slack body is as small
_MOVES_ON = 3.0  # times the way in which the force changes by its noise elsewhere


def reads_an_end(recording: Recording) -> bool:
    """Return whether the force stays at its highest or lowest reading while the tool moves on.

    By the mean stiffness the force would leave the band of its noise on the way. A friction that
    slips alone reads so as well. Hardly any force is no end, but that of a body that goes slack.
    """
    force, x = recording.force, recording.position
    lowest, highest = np.quantile(force, (_EXTREME, 1.0 - _EXTREME))
    span = max(float(highest - lowest), 1e-300)
    band = 2.0 * SIGMAS * force_noise(force, recording.force_step) + recording.force_step
    way = _MOVES_ON * band * float(np.ptp(x)) / span
    return any(
        float(np.ptp(x[first:past])) > way
        for end, at_end in ((highest, force > highest - band), (lowest, force < lowest + band))
        if abs(end) > _SLACK * span
        for first, past in stretches(at_end)
    )
