"""Note on noise that swings at one frequency."""

from __future__ import annotations

import numpy as np

from teleop_rt.diagnosis.models.fit import Problem

_LOWEST_HZ = 5.0  # Hz; swings of hand and rig lie below
_BESIDE = 2.0  # times the frequency of a peak, and its inverse: where the noise beside it is read
_PEAK_RATIO = 5.0  # of a peak's density over that of the noise beside it; less is a colour
_LEAST_SHARE = 0.3  # of the noise's power; a smaller part changes no answer


def of_resonance(problem: Problem) -> str | None:
    """Return the note on a resonance that makes a large part of the noise, None without one.

    A spectrum does not show whether the sensor swings in itself or the machine after each touch.
    """
    density = problem.whitener.density
    frequency = np.arange(density.size) / (problem.whitener.mask.size * problem.motion.dt)
    peak = int(np.argmax(np.where(frequency > _LOWEST_HZ, density, 0.0)))
    beside = [round(peak / _BESIDE), min(round(peak * _BESIDE), density.size - 1)]
    ground = float(np.sqrt(np.prod(density[beside])))
    if density[peak] < _PEAK_RATIO * max(ground, float(np.min(density[beside]))):
        return None
    hill = slice(*beside)
    share = float(np.sum(np.maximum(density[hill] - ground, 0.0)) / np.sum(density))
    if share < _LEAST_SHARE:
        return None
    return (
        f"the noise swings at {frequency[peak]:.3g} Hz ({share:.0%} of its power), as a sensor, its"
        " mount or a frame that rings: if it follows each touch or turn, the machine rings, and no"
        " effect describes that; see the figure of the residual"
    )
