"""The onset of force: the position at which the tool meets the surface in an approach."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from teleop_rt.contact import detection
from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.models.least_squares import least_squares, signed_solution
from teleop_rt.diagnosis.samples.motion import differentiate
from teleop_rt.diagnosis.samples.smoothing import half_window
from teleop_rt.recordings.rows import force_noise

_FLAT_SLOPE_RATIO = 0.1  # slope before over after a corner; a smaller one is that of free air
_CORNER_GRID = 60  # corners tried over the range of positions
_CORNER_ROUNDS = 3  # searches, each before the last corner: layers of a body have corners, too
_CRUDE_ERROR = 0.3  # of the travel beyond a crude onset: its uncertainty
_ERROR_PER_WAY = 4.0  # uncertainty over the way or the scatter of corners, which may share a bias
_AIR_WINDOW = 0.2  # of the way to the farthest withdrawal, at whose ends free air is compared
_PRESSED_RISE = 0.25  # of the force's range; a larger rise before an onset is contact
_WAY_SHARES = (0.3, 0.2, 0.12, 0.08, 0.05)
"""Of the travel: a stiffening body bends less over a shorter way."""
_FEWEST_SAMPLES = 12  # of an approach; fewer determine no two lines
_LEAST_RISE = 0.05  # of the force's range over the whole travel; a smaller rise is no contact
_ONSET_QUANTILE = 0.25  # of the corners: memory and delay make most of them too deep
_ENOUGH_SAMPLES = 1000  # of an approach; more are decimated, to save time
_MOST_APPROACHES = 12  # evenly chosen ones; more are left out, to save time
_CLEAR_SIGMAS = 10.0  # standard deviations of the force noise that a rise must exceed
_SLOPE_RATIO = 5.0  # slope after over before a corner of a contact
_SLOPE_SIGMAS = 3.0  # standard deviations of a slope that few samples leave possible
_AIR_WAY_SHARE = 0.8  # of the way to the farthest withdrawal that an approach must cover
_MOST_SAMPLES = 4000  # of a recording; more are decimated, to save time
_FRICTION_SPEED_RATIO = 0.02  # of the speed's deviation, over which dry friction reverses
_ALONG_STROKE = 3  # degree of a weight's force along the stroke: of less than a turn, an arc
_CORNER_ENERGY_RATIO = 0.5  # of the squared error without a corner; above it none is evident
_DETECTED_SAMPLES = 3  # in a row above a force, or below it, that begin or end a contact
_AIR_S = 0.02  # s, of free air before a contact that shows the surface
_FEWEST_CONTACTS = 2  # whose places must agree: one alone may be that of a tip pulled in
_LEAST_NOISE = 1e-4  # of the range of force or position; recordings without noise have some, too
_ANY_SIGN = np.zeros(4, dtype=bool)
MIN_CONTACT_SAMPLES = 100  # fewer determine neither a stiffness nor a surface


class Surface(NamedTuple):
    """Position of the surface, `fixed` or estimated within an uncertainty [rig unit].

    `clear` states that an approach shows the onset.
    """

    position: float
    fixed: bool
    within: float = 0.0
    clear: bool = False


def onset(position: Vector, force: Vector, dt: float) -> Surface | None:
    """Return the position at which the force begins to rise; None if no onset is detected.

    A body that stiffens much shows its corner inside it, and no approach a clear one; in quiet air
    the onset is then where the on-line detector sees it. Otherwise friction and inertia of the tool
    may hide it. They are estimated and subtracted, and the force is searched again.
    """
    found = _by_approaches(position, force, dt)
    if found is not None and found.clear:
        return found
    if (met := _as_met_on_line(position, force, dt)) is not None:
        return met
    own = _force_of_tool(position, force, dt)
    if own is None:
        return found
    cleaned = _by_approaches(position, force - own, dt)
    return found if cleaned is None else cleaned


def _as_met_on_line(position: Vector, force: Vector, dt: float) -> Surface | None:
    """Return the surface by the on-line detector, which presumes one mean force in free air.

    None unless contacts agree: they seem to meet it at different places where the air's force
    swings, and the place of a single one may be that of a tip that was pulled in.
    """
    noise, level = force_noise(force), float(np.ptp(force))
    least = max(_CLEAR_SIGMAS * noise, _LEAST_RISE * level)
    settings = np.zeros(detection.N_DETECTION)
    settings[detection.ONSET_FORCE] = least
    settings[detection.RELEASE_FORCE] = 0.5 * least
    settings[detection.ONSET_SAMPLES] = settings[detection.RELEASE_SAMPLES] = _DETECTED_SAMPLES
    settings[detection.FREE_AIR_TICKS] = max(round(_AIR_S / dt), _FEWEST_SAMPLES)
    settings[detection.FORCE_NOISE] = max(noise, _LEAST_NOISE * level)
    settings[detection.RESOLUTION] = _LEAST_NOISE * float(np.ptp(position))
    places = detection.surfaces_met(settings, position, force)
    if places.size < _FEWEST_CONTACTS:
        return None
    place = float(np.quantile(places, _ONSET_QUANTILE, method="lower"))
    way = _WAY_SHARES[-1] * (float(np.max(position)) - place)
    if float(np.ptp(places)) > way:
        return None
    return Surface(place, fixed=False, within=_ERROR_PER_WAY * way, clear=True)


def onset_behind_weight(position: Vector, force: Vector, dt: float) -> Surface | None:
    """Return the clear onset of a contact beside a force that varies smoothly along the stroke.

    A linkage's weight is such a force. A body that is pressed all along may look alike, so this
    surface is a hypothesis for the likelihood to judge.
    """
    own = _force_of_tool(position, force, dt, _ALONG_STROKE)
    found = None if own is None else _by_approaches(position, force - own, dt)
    return found if found is not None and found.clear else None


def _force_of_tool(position: Vector, force: Vector, dt: float, along: int = 0) -> Vector | None:
    """Return the force of the tool's friction and inertia, in free air and in contact.

    They are fitted with a corner, beyond which a body with a damper stiffens. A polynomial of
    degree `along` describes a force that varies along the stroke. None if the corner explains
    little: the forces of tool and body then cannot be separated.
    """
    _, v, a = differentiate(position, dt, half_window(position, dt))
    scales = float(np.std(v)), float(np.std(a))
    if min(scales) <= 0.0:
        return None
    place = (position - np.mean(position)) / np.ptp(position)
    own = np.array([
        v / scales[0], np.tanh(v / (_FRICTION_SPEED_RATIO * scales[0])), a / scales[1],
        *(place**degree for degree in range(1, along + 1)),
    ])  # fmt: skip
    every = max(1, position.size // _MOST_SAMPLES)
    x, rows, measured = position[::every], own[:, ::every], force[::every]
    travel = float(np.ptp(x))

    def fitted(corner: float) -> tuple[float, Vector]:
        depth = np.maximum(x - corner, 0.0) / travel
        damped = np.where(touches(depth), rows[0], 0.0)
        lines = np.array([*rows, np.ones_like(x), depth, depth**2, damped, depth * damped])
        theta = least_squares(lines, measured)
        return float(np.sum((measured - theta @ lines) ** 2)), theta

    corners = np.linspace(np.min(x), np.max(x), _CORNER_GRID + 1)[:-1]
    without, *tries = (fitted(corner) for corner in corners)
    left, theta = min(tries, key=lambda one: one[0])
    return theta[: len(own)] @ own if along or left < _CORNER_ENERGY_RATIO * without[0] else None


def _by_approaches(position: Vector, force: Vector, dt: float) -> Surface | None:
    """Return the position at which the force begins to rise; None if no onset is detected.

    A corner that no approach shows, or before which the tool is already pressed, lies inside the
    body; the samples before it are searched again. Without any clear corner, the force before a
    corner must be flat compared to the slopes after all corners so far.
    """
    every = max(1, position.size // _MOST_SAMPLES)
    rows = np.array([position, np.gradient(position, dt), force])[:, ::every]
    crude, slope = None, np.inf
    for _ in range(_CORNER_ROUNDS):
        corner, before, after = _corner(*rows)
        found = _first_touch(position, force, dt, corner)
        if found.clear and _out_of_body(position, force, found.position):
            return found
        slope = min(slope, after)
        if crude is None and abs(before) < _FLAT_SLOPE_RATIO * slope:
            crude = found
        rows = rows[:, rows[0] <= corner]
        if rows.shape[1] < MIN_CONTACT_SAMPLES:
            break
    return crude


def _out_of_body(position: Vector, force: Vector, onset: float) -> bool:
    """Return whether the force just before an onset equals that of the farthest withdrawal."""
    way = onset - float(np.min(position))
    beside = (position > onset - _AIR_WINDOW * way) & (position < onset)
    away = position < onset - (1.0 - _AIR_WINDOW) * way
    if not beside.any() or not away.any():
        return True
    rise = float(np.median(force[beside]) - np.median(force[away]))
    return rise < _PRESSED_RISE * float(np.ptp(force))


def _first_touch(position: Vector, force: Vector, dt: float, onset: float) -> Surface:
    """Return the least deep onset of force of all approaches, near a crude onset.

    Two lines are fitted over ever shorter ways, because a stiffening body bends the second line
    less over a short way. A body with memory is met deeper in later approaches, and a late sensor
    shows the onset deeper in fast ones; therefore the surface is the least deep onset.
    """
    speed = np.gradient(position, dt)
    travel = float(np.max(position)) - onset
    noise, level = force_noise(force), float(np.ptp(force))
    found = Surface(onset, fixed=False, within=_CRUDE_ERROR * travel)
    for share in _WAY_SHARES:
        way = share * travel
        corners = []
        approaches = _approaches(position, found.position, way)
        for first, last in approaches[:: max(1, len(approaches) // _MOST_APPROACHES)]:
            rows = np.array([position, speed, force])[:, first:last]
            every = max(1, rows.shape[1] // _ENOUGH_SAMPLES)
            corner, before, after = _corner(*rows[:, ::every])
            rise = after * (float(rows[0, -1]) - corner)
            least = max(
                _CLEAR_SIGMAS * noise,
                _LEAST_RISE * level * share,
                _SLOPE_RATIO * _steepest_slope(rows, corner, before, noise) * way,
            )
            if rows.shape[1] >= _FEWEST_SAMPLES and rise > least:
                corners.append(corner)
        if not corners:
            break
        place = float(np.quantile(corners, _ONSET_QUANTILE, method="lower"))
        # A mass that is struck, or a ripple, shifts all corners equally: their scatter misses it.
        within = min(_ERROR_PER_WAY * max(way, float(np.ptp(corners))), _CRUDE_ERROR * travel)
        found = Surface(place, fixed=False, within=within, clear=True)
    return found


def _steepest_slope(rows: Vector, corner: float, slope: float, noise: float) -> float:
    """Return the steepest slope before a corner that is compatible with the samples there."""
    before = rows[0, rows[0] <= corner]
    spread = float(np.linalg.norm(before - np.mean(before)))
    return abs(slope) + _SLOPE_SIGMAS * noise / spread if spread > 0.0 else np.inf


def _approaches(position: Vector, onset: float, way: float) -> list[tuple[int, int]]:
    """Return the approaches: stretches from `way` before the onset to as far beyond it.

    If the tool never withdraws by `way`, most of its farthest withdrawal suffices.
    """
    air = min(way, _AIR_WAY_SHARE * (onset - float(np.min(position))))
    outside, beyond = position <= onset - air, position >= onset + way
    found = []
    for last in np.flatnonzero(beyond[1:] & ~beyond[:-1]) + 1:
        before = np.flatnonzero(outside[:last])
        if before.size and not beyond[before[-1] : last].any():
            found.append((int(before[-1]), int(last) + 1))
    return found


def _corner(position: Vector, speed: Vector, force: Vector) -> tuple[float, float, float]:
    """Return the best corner of two lines of force over position, and the slopes of both.

    The fit includes a damper beyond the corner. Drift, friction and noise in free air have little
    influence on the corner.
    """
    order = np.argsort(position)
    x, v, f = (row[order] for row in (position, speed, force))
    middle, level = float(np.mean(x)), float(np.mean(f))
    corners = np.linspace(x[0], x[-1], _CORNER_GRID + 1)[1:-1]
    before = np.searchsorted(x, corners, side="right")
    best, found = np.inf, (0.0, 0.0, 0.0)
    sums = _running_sums(x - middle, v, f - level)
    for corner, number in zip(corners.tolist(), before.tolist(), strict=True):
        products = _products(corner - middle, sums[:, number], sums[:, -1] - sums[:, number])
        theta = signed_solution(products, _ANY_SIGN)
        left = -float(theta @ products[:, -1])  # beside the energy of the force, the same for all
        if left < best:
            best, found = left, (corner, float(theta[1]), float(theta[2]))
    return found


def _running_sums(x: Vector, v: Vector, f: Vector) -> Matrix:
    """Return the sums (9, samples + 1) of 1, x, x^2, f, x f, v, v^2, v x and v f up to a sample."""
    rows = np.array([np.ones_like(x), x, x * x, f, x * f, v, v * v, v * x, v * f])
    return np.concatenate((np.zeros((rows.shape[0], 1)), np.cumsum(rows, axis=1)), axis=1)


def _products(corner: float, before: Vector, beyond: Vector) -> Matrix:
    """Return the products of both lines and the damper with themselves and, last, with the force.

    The lines run over the way from the corner, the second one and the damper beyond it alone; their
    rows are 1, the first slope, the second slope and the damping.
    """
    n, x, xx, f, xf, v, vv, vx, vf = beyond
    ways = [(m, a - corner * m, b - 2.0 * corner * a + corner**2 * m, g, h - corner * g)
            for m, a, b, g, h in (before[:5], (n, x, xx, f, xf))]  # fmt: skip
    (m, first, first_2, g, first_f), (n, second, second_2, f, second_f) = ways
    damped = vx - corner * v
    return np.array([
        [m + n, first, second, v, g + f],
        [first, first_2, 0.0, 0.0, first_f],
        [second, 0.0, second_2, damped, second_f],
        [v, 0.0, damped, vv, vf],
    ])  # fmt: skip
