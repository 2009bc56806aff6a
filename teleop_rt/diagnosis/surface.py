"""Where the surface lies in a recording, and whether there is contact at all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.recording import Recording
from teleop_rt.errors import RecordingError

_NEAR = 0.25
_FLAT = 0.1
_STIFFEST_END, _BENT = 0.6, 1.5
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
_MOST_AIR = 0.8
_MOST_SAMPLES = 4000
_MIN_CONTACT_SAMPLES = 100
_STIFFEST_N_PER_M = 1e6
_LONGEST_M = 2.0
_PULLED = 0.2
_LIVELIER = 5.0


def force_noise(force: Vector) -> float:
    """Return the standard deviation of the force's fast noise, from third differences."""
    third = np.diff(force, 3)
    robust = float(np.median(np.abs(third - np.median(third)))) / 0.6745
    if robust <= 0.0:
        robust = float(np.std(third))
    return robust / float(np.sqrt(20.0))


class Surface(NamedTuple):
    """Position of the surface, told or a guess, and how far off a guess may be [rig unit].

    `clear` where an approach shows it.
    """

    position: float
    told: bool
    within: float = 0.0
    clear: bool = False


def surface_of(recording: Recording) -> Surface:
    """Return the surface guessed from the onset of force, or what the recording itself says.

    What a recording says was found while a model ran that may lack an effect, so an approach that
    shows the onset is believed before it. A position that already counts from the surface is kept
    so: where nothing is said and the onset lies within a quarter of the largest penetration from
    0, or cannot be seen for lack of free air and 0 may be the surface, it is 0 (its error then is
    what `contact_offset` says). A guess is where the force first rises, for later a body with a
    memory is met elsewhere. Raises RecordingError without contact.
    """
    position, force = recording.position, recording.force
    if recording.surface is not None:
        seen = _onset(position, force, recording.dt)
        clear = seen is not None and seen.clear
        return seen if seen and clear else Surface(recording.surface, told=True)
    noise = force_noise(force)
    level = float(np.quantile(force, 0.99) - np.quantile(force, 0.01))
    if level < 6.0 * noise:
        raise RecordingError(
            f"{recording.name}: no contact: the force varies by {level:.3g} only, within its noise"
        )
    found = _onset(position, force, recording.dt)
    if found is None:
        return _never_left(position, force, dt=recording.dt)
    deepest = float(np.max(position))
    if deepest > 0.0 and abs(found.position) <= _NEAR * (deepest - found.position):
        return Surface(0.0, told=True)
    return found


def _never_left(position: Vector, force: Vector, dt: float) -> Surface:
    """Return the surface of a body that is pressed all along: 0 where it may be, or a guess.

    The line through force over position ends at 1 - 1/n of the depth where a body stiffens with the
    power n, and deeper than the surface where it relaxes, so 0 may be the surface unless that line
    ends far from it, or the tool went beyond 0. Else the position counts from elsewhere.
    """
    nearest, deepest = float(np.min(position)), float(np.max(position))
    lines = np.array([np.ones_like(force), position - deepest, np.gradient(position, dt)])
    (level, slope, _), *_ = np.linalg.lstsq(lines.T, force, rcond=None)
    if slope <= 0.0 or level <= 0.0:
        return Surface(0.0, told=True)
    depth = float(level / slope)
    end = deepest - depth
    if nearest > -_NEAR * (deepest - nearest) and -deepest < end < _STIFFEST_END * deepest:
        return Surface(0.0, told=True)
    return Surface(min(end, nearest), told=False, within=_BENT * depth)


def _onset(position: Vector, force: Vector, dt: float) -> Surface | None:
    """Return where the force begins to rise with the position; None if that is nowhere seen.

    A corner that no approach shows, or before which the tool is pressed already, is one inside the
    body, and what lies before that corner is searched again. Where none is shown at all, the force
    must be flat before the corner beside what it is after.
    """
    every = max(1, position.size // _MOST_SAMPLES)
    rows = np.array([position, np.gradient(position, dt), force])[:, ::every]
    crude = None
    for _ in range(_LAYERS):
        corner, before, after = _corner(*rows)
        found = _first_touch(position, force, dt, corner)
        if found.clear and _out_of_body(position, force, found.position):
            return found
        if crude is None and abs(before) < _FLAT * after:
            crude = found
        rows = rows[:, rows[0] <= corner]
        if rows.shape[1] < _MIN_CONTACT_SAMPLES:
            break
    return crude


def _out_of_body(position: Vector, force: Vector, onset: float) -> bool:
    """Tell whether the force just before an onset is that of the farthest withdrawal."""
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
    late sensor tells it deeper the faster the approach; so the least deep onset is the surface.
    """
    speed = np.gradient(position, dt)
    travel = float(np.max(position)) - onset
    noise, level = force_noise(force), float(np.ptp(force))
    found = Surface(onset, told=False, within=_CRUDE * travel)
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
        found = Surface(place, told=False, within=within, clear=True)
    return found


def _steepest(rows: Vector, corner: float, slope: float, noise: float) -> float:
    """Return the steepest slope before a corner that the few samples there leave possible."""
    before = rows[0, rows[0] <= corner]
    spread = float(np.linalg.norm(before - np.mean(before)))
    return abs(slope) + _UNSURE * noise / spread if spread > 0.0 else np.inf


def _struck(rows: Vector, corner: float) -> float:
    """Return by how much the force jumps at a corner, 0 if it varied as much before.

    A damper's force, or a heavy tool's, is there at once and may fall while the spring's rises.
    What the force has risen by since the corner is no jump: a spring alone does that.
    """
    soon = corner + _SOON * (float(np.max(rows[0])) - corner)
    near = (rows[0] > corner) & (rows[0] < soon)
    before, beyond = rows[2, rows[0] <= corner], rows[2, near]
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
        theta, *_ = np.linalg.lstsq(lines.T, force, rcond=None)
        left = float(np.sum((force - theta @ lines) ** 2))
        if left < best:
            best, found = left, (float(corner), float(theta[1]), float(theta[2]))
    return found


def refuse_unlearnable(recording: Recording, penetration: Vector, noise: float) -> None:
    """Raise RecordingError without contact, without movement in it, or if signs look turned."""
    inside = penetration[penetration > 0.0]
    if inside.size < _MIN_CONTACT_SAMPLES:
        raise RecordingError(
            f"{recording.name}: no contact: {inside.size} samples lie beyond the surface; check"
            " the sign of the position (> 0 into the environment) and --surface"
        )
    if float(np.ptp(inside)) < 20.0 * noise:
        raise RecordingError(
            f"{recording.name}: no excitation: in contact the position moves by"
            f" {float(np.ptp(inside)):.3g} {recording.units[0]} only, close to its noise"
        )
    free = recording.force[penetration < 0.0]
    if free.size < _MIN_CONTACT_SAMPLES:
        return
    in_air, in_contact = (
        float(np.subtract(*np.quantile(f, (0.99, 0.01))))
        for f in (free, recording.force[penetration > 0.0])
    )
    if in_air > _LIVELIER * in_contact:
        raise RecordingError(
            f"{recording.name}: wrong sign? in contact the force varies by {in_contact:.3g}, in"
            f" free air by {in_air:.3g}; positions count positive into the environment, forces"
            " positive when the tool presses: turn them with a minus before the column's name, or"
            " check --surface"
        )
    pressed = float(np.median(recording.force[penetration > 0.0]) - np.median(free))
    if -pressed > max(6.0 * force_noise(recording.force), _PULLED * float(np.ptp(recording.force))):
        raise RecordingError(
            f"{recording.name}: wrong sign? in contact the force is {pressed:.3g}"
            f" {recording.units[1]} against free air, but it counts positive when the tool presses;"
            " turn it with a minus before the column's name, --columns force=-NAME"
        )


def refuse_wrong_units(recording: Recording, stiffness: float | None) -> None:
    """Raise RecordingError where the figures hint at a wrong unit of a linear rig."""
    if recording.units[0] != "m":
        return
    travel = float(np.ptp(recording.position))
    if travel > _LONGEST_M:
        raise RecordingError(
            f"{recording.name}: wrong unit? the position moves by {travel:.3g} m; if it is in mm,"
            " say so with --units position=mm"
        )
    if stiffness is not None and stiffness > _STIFFEST_N_PER_M:
        raise RecordingError(
            f"{recording.name}: wrong unit? a spring of {stiffness:.2g} N/m is stiffer than what"
            " such a rig can press on; check the units of position and force"
        )
