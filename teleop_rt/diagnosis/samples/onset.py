"""Where the force of a recording begins: the approach in which a tool meets the surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.models.least_squares import least_squares
from teleop_rt.diagnosis.samples.motion import differentiate, force_noise
from teleop_rt.diagnosis.samples.smoothing import half_window

_FLAT = 0.1
_CORNERS = 60
_LAYERS = 3
_CRUDE = 0.3
_BIASED = 4.0
_BESIDE = 0.2
_PRESSED = 0.25
_WAYS = (0.3, 0.2, 0.12, 0.08, 0.05)
_FEWEST = 12
_SOFTEST = 0.05
_EARLY = 0.25
_ENOUGH_SAMPLES = 1000
_MOST_APPROACHES = 12
_CLEAR = 10.0
_FLATTER = 5.0
_UNSURE = 3.0
_SOON = 0.2
_AS_FAST = 0.3
_MOST_AIR = 0.8
_MOST_SAMPLES = 4000
_CREEP = 0.02
_SHARP = 0.5
_MIN_CONTACT_SAMPLES = 100


class Surface(NamedTuple):
    """Position of the surface, `fixed` or a guess, and how far off a guess may be [rig unit].

    `clear` where an approach shows it.
    """

    position: float
    fixed: bool
    within: float = 0.0
    clear: bool = False


def onset(position: Vector, force: Vector, dt: float) -> Surface | None:
    """Return where the force begins to rise with the position; None if that is nowhere seen.

    Where no approach shows it, the tool's own friction and inertia may hide it: the force is
    searched once more without them.
    """
    found = _by_approaches(position, force, dt)
    if found is not None and found.clear:
        return found
    own = _force_of_tool(position, force, dt)
    if own is None:
        return found
    cleaned = _by_approaches(position, force - own, dt)
    return found if cleaned is None else cleaned


def _force_of_tool(position: Vector, force: Vector, dt: float) -> Vector | None:
    """Return what friction and inertia make of the force, in the air as in the body.

    Fitted together with a corner, beyond which a body with a damper stiffens. None where a corner
    says little: then nobody knows what is the tool's and what the body's.
    """
    _, v, a = differentiate(position, dt, half_window(position, dt))
    scales = float(np.std(v)), float(np.std(a))
    if min(scales) <= 0.0:
        return None
    own = np.array([v / scales[0], np.tanh(v / (_CREEP * scales[0])), a / scales[1]])
    every = max(1, position.size // _MOST_SAMPLES)
    x, rows, measured = position[::every], own[:, ::every], force[::every]
    travel = float(np.ptp(x))

    def fitted(corner: float) -> tuple[float, Vector]:
        depth = np.maximum(x - corner, 0.0) / travel
        damped = np.where(depth > 0.0, rows[0], 0.0)
        lines = np.array([*rows, np.ones_like(x), depth, depth**2, damped, depth * damped])
        theta = least_squares(lines, measured)
        return float(np.sum((measured - theta @ lines) ** 2)), theta

    corners = np.linspace(np.min(x), np.max(x), _CORNERS + 1)[:-1]
    without, *tries = (fitted(corner) for corner in corners)
    left, theta = min(tries, key=lambda one: one[0])
    return theta[: len(own)] @ own if left < _SHARP * without[0] else None


def _by_approaches(position: Vector, force: Vector, dt: float) -> Surface | None:
    """Return where the force begins to rise with the position; None if that is nowhere seen.

    A corner that no approach shows, or before which the tool is pressed already, is one inside the
    body, and what lies before that corner is searched again. Where none is shown at all, the force
    must be flat before the corner beside what it is after, there and in the body as a whole.
    """
    every = max(1, position.size // _MOST_SAMPLES)
    rows = np.array([position, np.gradient(position, dt), force])[:, ::every]
    crude, slope = None, np.inf
    for _ in range(_LAYERS):
        corner, before, after = _corner(*rows)
        found = _first_touch(position, force, dt, corner)
        if found.clear and _out_of_body(position, force, found.position):
            return found
        slope = min(slope, after)
        if crude is None and abs(before) < _FLAT * slope:
            crude = found
        rows = rows[:, rows[0] <= corner]
        if rows.shape[1] < _MIN_CONTACT_SAMPLES:
            break
    return crude


def _out_of_body(position: Vector, force: Vector, onset: float) -> bool:
    """Return whether the force just before an onset is that of the farthest withdrawal."""
    way = onset - float(np.min(position))
    beside = (position > onset - _BESIDE * way) & (position < onset)
    away = position < onset - (1.0 - _BESIDE) * way
    if not beside.any() or not away.any():
        return True
    rise = float(np.median(force[beside]) - np.median(force[away]))
    return rise < _PRESSED * float(np.ptp(force))


def _first_touch(position: Vector, force: Vector, dt: float, onset: float) -> Surface:
    """Return where the force rises at the earliest in any approach, near a crude onset.

    Two lines meet there again, over ever shorter ways: a body that stiffens bends the second line,
    and over a short way it bends little. A body that remembers is met deeper the next time, and a
    late sensor shows it deeper the faster the approach; so the least deep onset is the surface.
    """
    speed = np.gradient(position, dt)
    travel = float(np.max(position)) - onset
    noise, level = force_noise(force), float(np.ptp(force))
    found = Surface(onset, fixed=False, within=_CRUDE * travel)
    for share in _WAYS:
        way = share * travel
        corners = []
        approaches = _approaches(position, found.position, way)
        for first, last in approaches[:: max(1, len(approaches) // _MOST_APPROACHES)]:
            rows = np.array([position, speed, force])[:, first:last]
            every = max(1, rows.shape[1] // _ENOUGH_SAMPLES)
            corner, before, after = _corner(*rows[:, ::every])
            rise = after * (float(rows[0, -1]) - corner)
            lowest = max(_CLEAR * noise, _SOFTEST * level * share)
            least = max(lowest, _FLATTER * _steepest(rows, corner, before, noise) * way)
            if rows.shape[1] >= _FEWEST and (rise > least or _struck(rows, corner) > lowest):
                corners.append(corner)
        if not corners:
            break
        place = float(np.quantile(corners, _EARLY, method="lower"))
        # A mass struck at the touch, or a ripple, moves every corner alike.
        within = min(_BIASED * max(way, float(np.ptp(corners))), _CRUDE * travel)
        found = Surface(place, fixed=False, within=within, clear=True)
    return found


def _steepest(rows: Vector, corner: float, slope: float, noise: float) -> float:
    """Return the steepest slope before a corner that the few samples there leave possible."""
    before = rows[0, rows[0] <= corner]
    spread = float(np.linalg.norm(before - np.mean(before)))
    return abs(slope) + _UNSURE * noise / spread if spread > 0.0 else np.inf


def _struck(rows: Vector, corner: float) -> float:
    """Return by how much the force jumps at a corner, 0 if it varied as much before.

    A damper's force, or a heavy tool's, is there at once and may fall while the spring's rises.
    What the force has risen by since the corner is no jump: a spring alone does that. Nor is what a
    damper takes when the tool sets out from a rest inside the body.
    """
    soon = corner + _SOON * (float(np.max(rows[0])) - corner)
    near = (rows[0] > corner) & (rows[0] < soon)
    moving = rows[1] > _AS_FAST * (float(np.median(rows[1, near])) if near.any() else np.inf)
    before, beyond = rows[2, (rows[0] <= corner) & moving], rows[2, near]
    if min(before.size, beyond.size) < _FEWEST // 3:
        return 0.0
    lines = np.array([np.ones_like(beyond), rows[0, near] - corner])
    at_once = float(np.linalg.lstsq(lines.T, beyond, rcond=None)[0][0])
    jump = min(float(np.mean(beyond)), at_once) - float(np.median(before))
    varied = float(np.subtract(*np.quantile(before, (0.85, 0.15))))
    return jump if jump > _FLATTER * varied else 0.0


def _approaches(position: Vector, onset: float, way: float) -> list[tuple[int, int]]:
    """Return the stretches in which the position goes from `way` before the onset to as far beyond.

    Each ends where it gets there, and begins where it last was as far before, or most of the way
    to where the tool ever was.
    """
    air = min(way, _MOST_AIR * (onset - float(np.min(position))))
    outside, beyond = position <= onset - air, position >= onset + way
    found = []
    for last in np.flatnonzero(beyond[1:] & ~beyond[:-1]) + 1:
        before = np.flatnonzero(outside[:last])
        if before.size and not beyond[before[-1] : last].any():
            found.append((int(before[-1]), int(last) + 1))
    return found


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
        theta = least_squares(lines, force)
        left = float(np.sum((force - theta @ lines) ** 2))
        if left < best:
            best, found = left, (float(corner), float(theta[1]), float(theta[2]))
    return found
