"""Detection of a body that is fixed to the tool, and of one that the tool leaves.

A body that is fixed pulls as well as pushes, and its force has a slope everywhere. A body that is
left only pushes, and beyond its surface the force does not depend on the motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.models.base import Base, base_of
from teleop_rt.diagnosis.samples.motion import differentiate
from teleop_rt.diagnosis.samples.smoothing import half_window
from teleop_rt.recordings.recording import Recording
from teleop_rt.recordings.rows import bulk, force_noise, quantisation_step, without_lone

HELD = (
    "the body pulls as well as pushes, and the force has a slope everywhere: no free air is seen,"
    " so the base is {base}, in which a bias and a rest position are one; if the body only pushes,"
    " give its place with --surface"
)
HELD_ABOUT = (
    "the body pulls on the one side of the place given as it pushes on the other, so the base is"
    " {base} about that place; {stated} would only push"
)
LEFT = (
    "the tool leaves the body: beyond a surface the force does not depend on the motion, so the"
    " base is {base}, which only pushes; for a body that is fixed to the tool, give the place at"
    " which its force is zero with --surface"
)
LEAST_PULL = 0.1  # of the force's range; less is a bias, or a little friction or adhesion
SURE_PULL = 0.2  # of the same; less may be the friction of an axis that leaves the body
_SLOPE_RATIO = 0.2  # of the stiffness above a surface; in free air guides and cables have less
_PLACES = 19  # surfaces tried, from 5 to 95 % of the samples
_LEFT_RATIO = 0.6  # energy that a force without slope beyond a surface leaves, over that of a line
_AIR_SLOPE, _AIR_FORCE = 0.35, 0.25
"""Of the slope in contact, and of the force's range above its least: largest of free air, behind a
slow sensor and beside other effects. Of 384 bodies that are fixed none has a ratio below 0.75 with
these."""
_PULL_SLOPE, _PULL_RATIO = -0.1, 0.3
"""Of the slope in contact, and of the energy that one line leaves: a force that grows outwards is a
pull that lets go. None of 379 bodies that are fixed has one."""
_OUTERMOST = 0.1  # of the travel, in which the force of free air hardly changes
_MOVED = 0.7  # of that part; of less, the tool may only have rested there
_FLAT_SLOPE, _FLAT_DEVIATION = 0.2, 0.02
"""Of the force's range over the travel, and of that range: largest there. Of 349 bodies that are
fixed none is as flat; of 135 that are left and have no clear surface 60 are."""
_REPEATED = 0.01  # of the readings; normal noise of a step repeats its lowest in a tenth of that
_LEFT_PLACES, _NEARER_PLACES = 49, 9  # surfaces tried for it, and then around the best
_MOST_SAMPLES = 4000  # of a recording; more are decimated, to save time
_BILATERAL = {
    "kelvin-voigt": "spring,viscous,bias",
    "mass-spring-damper": "mass,spring,viscous,bias",
}
_IN_CONTACT = {"spring": "stiffness", "viscous": "damping", "bias": "bias"}
"""Terms of a body that is fixed to the tool, and those of one that is left."""


def bilateral(base: Base, *, about_rest: bool = False) -> Base | None:
    """Return the base of the same body where it is fixed to the tool, None if there is none.

    `about_rest` where its place of rest is given: then it has no bias.
    """
    name = _BILATERAL.get(base.name)
    if name is None:
        return None
    return base_of(name.removesuffix(",bias") if about_rest else name)


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
    parts = _Parts.of(recording, force)
    place = parts.best(np.quantile(parts.x, np.linspace(0.05, 0.95, _PLACES)))
    below, above = parts.slopes(place)
    return min(below, above) > _SLOPE_RATIO * max(below, above)


def may_be_held(recording: Recording) -> bool:
    """Return whether a body pulls too much for one that the tool leaves, without any free air.

    The two parts of a damper by direction or of a dome that snaps through differ in more than their
    slopes, so `is_held` does not see them.
    """
    low, high = bulk(without_lone(recording.force))
    return min(-low, high) >= SURE_PULL * (high - low) and not is_left(recording)


def unilateral(base: Base) -> Base | None:
    """Return the base of the same body where the tool leaves it, None if there is none."""
    names = [_IN_CONTACT.get(name, "") for name in base.name.split(",")]
    if "stiffness" not in names or not all(names):
        return None
    joined = ",".join(names)
    return base_of("kelvin-voigt" if joined == "stiffness,damping" else joined)


def is_left(recording: Recording) -> bool:
    """Return whether the tool leaves the body, whose base states no contact.

    The force hardly changes over the outermost part of the travel; or a pull lets go beyond the
    best surface; or a force that has no slope there leaves much less than one straight line, the
    part beyond has next to none if it may have one, and it is near the least force. The lower end
    of a converter's range is no free air.
    """
    if _ends_below(recording.force):
        return False
    force = without_lone(recording.force)
    low, high = bulk(force)
    parts = _Parts.of(recording, force)
    if parts.is_flat_outside(high - low):
        return True
    place = parts.best(np.quantile(parts.x, np.linspace(0.02, 0.98, _LEFT_PLACES)))
    near = 0.03 * float(np.ptp(parts.x))
    place = parts.best(np.linspace(place - near, place + near, _NEARER_PLACES))
    below, above = parts.slopes(place)
    if below < _PULL_SLOPE * above:
        return parts.in_two(place) < _PULL_RATIO * parts.as_one_line()
    in_air = parts.force[parts.x <= place]
    if not in_air.size or float(np.mean(in_air)) - low > _AIR_FORCE * (high - low):
        return False
    even = abs(below) < _AIR_SLOPE * above
    return even and parts.without_slope_below(place) < _LEFT_RATIO * parts.as_one_line()


def _ends_below(force: Vector) -> bool:
    """Return whether the lowest reading repeats itself although the others show a noise.

    A converter reads the end of its range so, and free air shows the noise as well.
    """
    lowest = force == np.min(force)
    if np.mean(lowest) < _REPEATED:
        return False
    return force_noise(force[~lowest]) > quantisation_step(force)


class _Parts(NamedTuple):
    """Fits of a force (samples,) by straight parts, on either side of a surface."""

    x: Vector
    v: Vector
    force: Vector

    @classmethod
    def of(cls, recording: Recording, force: Vector) -> _Parts:
        half = half_window(recording.position, recording.dt, 1)
        x, v, _ = differentiate(recording.position, recording.dt, half)
        step = max(1, force.size // _MOST_SAMPLES)
        return cls(x[::step], v[::step], force[::step])

    def is_flat_outside(self, force_range: float) -> bool:
        """Return whether the force hardly changes over the outermost part of the travel."""
        travel, first = float(np.ptp(self.x)), float(np.min(self.x))
        outside = _Parts(*(row[self.x < first + _OUTERMOST * travel] for row in self))
        if float(np.ptp(outside.x)) < _MOVED * _OUTERMOST * travel:
            return False
        slope = float(outside._fit(outside.x, outside.v)[1][0])
        even = float(np.std(outside.force)) < _FLAT_DEVIATION * force_range
        return even and abs(slope) * travel < _FLAT_SLOPE * force_range

    def _fit(self, *rows: Vector) -> tuple[float, Vector]:
        matrix = np.array([*rows, np.ones_like(self.x)])
        theta = np.linalg.lstsq(matrix.T, self.force, rcond=None)[0]
        rest = self.force - theta @ matrix
        return float(rest @ rest), np.asarray(theta)

    def _in_two(self, place: float) -> tuple[float, Vector]:
        depth = self.x - place
        inside = touches(depth)
        return self._fit(np.minimum(depth, 0.0), np.maximum(depth, 0.0),
                         self.v * ~inside, self.v * inside)  # fmt: skip

    def best(self, places: Vector) -> float:
        """Return the place that divides the force best."""
        return float(min(places.tolist(), key=lambda place: self._in_two(place)[0]))

    def in_two(self, place: float) -> float:
        """Return the energy that two straight parts leave."""
        return self._in_two(place)[0]

    def slopes(self, place: float) -> tuple[float, float]:
        """Return the slopes below and above a place."""
        below, above, *_ = self._in_two(place)[1].tolist()
        return below, above

    def without_slope_below(self, place: float) -> float:
        """Return the energy that a force leaves which depends on the motion above a place only."""
        depth = np.maximum(self.x - place, 0.0)
        return self._fit(depth, self.v * touches(depth))[0]

    def as_one_line(self) -> float:
        """Return the energy that one straight line leaves."""
        return self._fit(self.x, self.v)[0]
