"""Detection of a body that is fixed to the tool: it pulls as well as pushes, and is never left."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.models.base import Base, base_of
from teleop_rt.diagnosis.recordings.recording import Recording
from teleop_rt.diagnosis.samples.motion import differentiate
from teleop_rt.diagnosis.samples.rows import bulk, without_lone
from teleop_rt.diagnosis.samples.smoothing import half_window

HELD = (
    "the body pulls as well as pushes, and the force has a slope everywhere: no free air is seen,"
    " so the base is {base}, in which a bias and a rest position are one; if the body only pushes,"
    " give its place with --surface"
)
LEAST_PULL = 0.1  # of the force's range; less is a bias, or a little friction or adhesion
SURE_PULL = 0.2  # of the same; less may be the friction of an axis that leaves the body
_SLOPE_RATIO = 0.2  # of the stiffness above a surface; in free air guides and cables have less
_PLACES = 19  # surfaces tried, from 5 to 95 % of the samples
_BILATERAL = {
    "kelvin-voigt": "spring,viscous,bias",
    "mass-spring-damper": "mass,spring,viscous,bias",
}


def bilateral(base: Base) -> Base | None:
    """Return the base of the same body where it is fixed to the tool, None if there is none."""
    name = _BILATERAL.get(base.name)
    return None if name is None else base_of(name)


def is_held(recording: Recording, least_pull: float = LEAST_PULL) -> bool:
    """Return whether a body is fixed to the tool, so that no surface exists.

    A body that is left has a force without slope beyond its surface. At the surface that divides
    the force best into two straight parts, both parts of a held body have a slope. It pulls by
    `least_pull` of the force's range or more.
    """
    force = without_lone(recording.force)
    low, high = bulk(force)
    if min(-low, high) < least_pull * (high - low):
        return False
    half = half_window(recording.position, recording.dt, 1)
    x, v, _ = differentiate(recording.position, recording.dt, half)
    fits = []
    for surface in np.quantile(x, np.linspace(0.05, 0.95, _PLACES)):
        depth = x - surface
        inside = touches(depth)
        rows = np.array([np.minimum(depth, 0.0), np.maximum(depth, 0.0),
                         v * ~inside, v * inside, np.ones_like(x)])  # fmt: skip
        theta, energy, *_ = np.linalg.lstsq(rows.T, force, rcond=None)
        fits.append((float(np.sum(energy)), theta[0], theta[1]))
    _, below, above = min(fits)
    return bool(min(below, above) > _SLOPE_RATIO * max(below, above))
