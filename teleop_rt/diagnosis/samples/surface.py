"""The surface of a recording, and refusal of recordings without usable contact."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.samples.free import moves_freely
from teleop_rt.diagnosis.samples.onset import (
    MIN_CONTACT_SAMPLES,
    Surface,
    onset,
    onset_behind_weight,
)
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.column_names import turned
from teleop_rt.recordings.recording import Recording
from teleop_rt.recordings.rows import bulk, force_noise, without_lone

_CONTRADICTED_SHARE = 0.25  # of the depth; a nearer surface is the effect `contact_offset`
_BEGIN_SHARE = 0.01  # of travel and force, below which both are at their beginning
_GUESS_ERROR = 1.5  # of the estimated depth: uncertainty of a surface that was never left
_MIN_USABLE_SAMPLES = 20  # in contact; fewer leave no block to test stiffness and damping
_SIGMAS = 6.0  # standard deviations of the noise; a smaller force is none
_PULL_RATIO = 0.2  # of the force's range; a larger pull in contact means a wrong sign
_AIR_FORCE_RATIO = 5.0  # times the variation in contact; more in free air means a wrong sign
_END_SHARE = 0.15  # of the samples, those nearest to either end of the travel
_FALLING_CORRELATION = 0.5  # of force and position, with negative sign, if one is inverted
_ONE_SIDED_RATIO = 3.0  # of the larger to the smaller extreme of a force with one sign
NO_CONTACT_HERE = (
    "or this side of the rig touches nothing, or its converter is saturated: then no sign helps"
)


def surface_of(recording: Recording) -> Surface:
    """Return the surface estimated from the onset of force, or the one stored in the recording.

    A stored surface was estimated with a model that may lack an effect, so a clear onset takes
    precedence. The estimate is the first onset, because a body with memory is met elsewhere later.
    Where no approach shows it clearly it is uncertain, but never the encoder's zero. Raises
    RecordingError without contact.
    """
    position, force = recording.position, without_lone(recording.force)
    if recording.surface is not None:
        seen = onset(position, force, recording.dt)
        clear = seen is not None and seen.clear
        return seen if seen and clear else Surface(recording.surface, fixed=True)
    noise = force_noise(force)
    level = float(np.ptp(bulk(force)))
    if level < _SIGMAS * noise:
        raise RecordingError(
            f"{recording.name}: no contact: the force varies by {level:.3g} only, within its noise;"
            " press harder, or name another column with --columns force=NAME"
        )
    _refuse_turned_force(recording, force, noise)
    if not moves_freely(recording):
        _refuse_turned_position(recording, force, noise)
    found = onset(position, force, recording.dt)
    if found is None or not found.clear:
        _refuse_both_turned(recording, force, noise)
    if found is None:
        return _pressed_throughout(position, force, dt=recording.dt)
    return found


def surface_behind_weight(recording: Recording) -> Surface | None:
    """Return the surface that shows only beside a force along the stroke, if there is one."""
    position, force = recording.position, without_lone(recording.force)
    found = onset_behind_weight(position, force, recording.dt)
    seen = onset(position, force, recording.dt)
    if found and seen and abs(seen.position - found.position) < seen.within:
        return None
    return found


def has_clear_onset(recording: Recording) -> bool:
    """Return whether an approach clearly shows where the force of a contact begins."""
    seen = onset(recording.position, without_lone(recording.force), recording.dt)
    return seen is not None and seen.clear


def onset_far_from(surface: float, recording: Recording) -> Surface | None:
    """Return the clear onset of force, if it lies too far from a given surface to be an offset."""
    seen = onset(recording.position, without_lone(recording.force), recording.dt)
    if seen is None or not seen.clear:
        return None
    depth = float(np.max(recording.position)) - seen.position
    apart = abs(seen.position - surface)
    return seen if apart >= max(_CONTRADICTED_SHARE * depth, seen.within) else None


def _side(force: Vector, noise: float) -> int:
    """Return 1 where the tool only presses, -1 where it only pulls, 0 where it does both."""
    low, high = bulk(force)
    sides = (1, high, -low), (-1, -low, high)
    larger = (side for side, one, other in sides
              if one > _ONE_SIDED_RATIO * max(other, _SIGMAS * noise))  # fmt: skip
    return next(larger, 0)


def _falls(position: Vector, force: Vector) -> bool:
    """Return whether the force falls with the depth."""
    return float(np.corrcoef(position, force)[0, 1]) < -_FALLING_CORRELATION


def _refuse_turned_force(recording: Recording, force: Vector, noise: float) -> None:
    """Raise RecordingError if the force is negative and falls with the depth."""
    if _falls(recording.position, force) and _side(force, noise) < 0:
        raise RecordingError(
            f"{recording.name}: wrong sign? the force falls to {bulk(force)[0]:.3g} the larger"
            " the position is, but it counts positive when the tool presses; turn it with a minus"
            f" before the column's name, {turned(recording.columns, 'force')}; {NO_CONTACT_HERE}"
        )


def _refuse_turned_position(recording: Recording, force: Vector, noise: float) -> None:
    """Raise RecordingError if the force is positive and falls with the depth."""
    if _falls(recording.position, force) and _side(force, noise) > 0:
        raise RecordingError(
            f"{recording.name}: wrong sign? the force rises to {bulk(force)[1]:.3g} the smaller"
            " the position is, but it counts positive into the environment; turn the position with"
            f" a minus before the column's name, {turned(recording.columns, 'position')}"
        )


def _refuse_both_turned(recording: Recording, force: Vector, noise: float) -> None:
    """Raise RecordingError where the tool only pulls, and its force is even at large positions.

    So a contact looks where position and force both count the other way, as in a testing machine
    that counts tension positive. A force with an offset is even at small positions.
    """
    if _side(force, noise) >= 0:
        return
    position = recording.position
    first, last = np.quantile(position, (_END_SHARE, 1.0 - _END_SHARE))
    ends = force[position <= first], force[position >= last]
    near, far = (float(np.ptp(bulk(end))) for end in ends)
    if near > _AIR_FORCE_RATIO * far:
        raise RecordingError(
            f"{recording.name}: wrong sign? the force is {bulk(force)[0]:.3g} where the position"
            " is small and nearly nothing where it is large; positions count positive into the"
            " environment, forces positive when the tool presses: where compression counts"
            f" negative, turn both, {turned(recording.columns, 'position', 'force')}"
        )


def refuse_turned(recording: Recording) -> None:
    """Raise RecordingError if force or position of a contact has the wrong sign.

    A force of both signs, such as that of a mass moved in free air, is accepted.
    """
    position, force = recording.position, recording.force
    noise = force_noise(force)
    if float(np.ptp(position)) == 0.0 or float(np.ptp(force)) <= _SIGMAS * noise:
        return
    _refuse_turned_force(recording, force, noise)
    _refuse_turned_position(recording, force, noise)


def _pressed_throughout(position: Vector, force: Vector, dt: float) -> Surface:
    """Return a first estimate of the surface of a body that the tool never leaves.

    It is where the line through force over position ends. The true one is at 1 - 1/n of that depth
    if the body stiffens with power n. That 0 is possible is no sign that it is the surface: most
    axes count from an arbitrary place, and an offset would be named for it. It is the surface where
    the travel and the force both begin at 0, as of a strip that is stretched from rest.
    """
    nearest, deepest = float(np.min(position)), float(np.max(position))
    begin = position <= nearest + _BEGIN_SHARE * (deepest - nearest)
    least = float(np.min(np.abs(force[begin])))
    if abs(nearest) <= _BEGIN_SHARE * deepest and least <= _BEGIN_SHARE * float(np.ptp(force)):
        return Surface(0.0, fixed=True)
    lines = np.array([np.ones_like(force), position - deepest, np.gradient(position, dt)])
    (level, slope, _), *_ = np.linalg.lstsq(lines.T, force, rcond=None)
    if slope <= 0.0 or level <= 0.0:
        return Surface(0.0, fixed=True)
    depth = float(level / slope)
    end = deepest - depth
    return Surface(min(end, nearest), fixed=False, within=_GUESS_ERROR * depth)


def refuse_unlearnable(recording: Recording, penetration: Vector, noise: float) -> None:
    """Raise RecordingError without contact, without motion in contact, or with a wrong sign."""
    inside = penetration[touches(penetration)]
    if inside.size < MIN_CONTACT_SAMPLES:
        raise RecordingError(
            f"{recording.name}: no contact: {inside.size} samples lie beyond the surface, and the"
            f" farthest at {float(penetration.max()):.4g} {recording.units[0]} from it; check the"
            " sign of the position (> 0 into the environment); --surface takes"
            f" {recording.units[0]}, or a unit as in 10mm"
        )
    if float(np.ptp(inside)) < 20.0 * noise:
        raise RecordingError(
            f"{recording.name}: no excitation: in contact the position moves by"
            f" {float(np.ptp(inside)):.3g} {recording.units[0]} only, close to its noise; press"
            " deeper, or with a finer encoder"
        )
    free = recording.force[penetration < 0.0]
    if free.size >= MIN_CONTACT_SAMPLES:
        _refuse_force_in_air(recording, free, recording.force[touches(penetration)])


def _refuse_force_in_air(recording: Recording, free: Vector, contact: Vector) -> None:
    """Raise RecordingError where the force is that of free air beyond the surface.

    The rig of a run knows its signs: there the surface is elsewhere, and no column can be turned.
    """
    in_air, in_contact = (float(np.ptp(bulk(row))) for row in (free, contact))
    if in_air > _AIR_FORCE_RATIO * in_contact:
        _refuse_moved_surface(recording, f"varies by {in_contact:.3g}, in free air by {in_air:.3g}")
        low, high = bulk(free)
        untouched = float(np.median(contact))
        presses = high - untouched > untouched - low
        roles = ("position",) if presses else ("position", "force")
        raise RecordingError(
            f"{recording.name}: wrong sign? in contact the force varies by {in_contact:.3g}, in"
            f" free air by {in_air:.3g}; positions count positive into the environment, forces"
            " positive when the tool presses: turn"
            f" {'the position' if presses else 'both'} with a minus before the column's name,"
            f" {turned(recording.columns, *roles)}, or check --surface;"
            f" {NO_CONTACT_HERE}"
        )
    pressed = float(np.median(contact) - np.median(free))
    least = _SIGMAS * force_noise(recording.force, recording.force_step)
    if -pressed > max(least, _PULL_RATIO * float(np.ptp(recording.force))):
        _refuse_moved_surface(recording, f"is {pressed:.3g} {recording.units[1]} against free air")
        raise RecordingError(
            f"{recording.name}: wrong sign? in contact the force is {pressed:.3g}"
            f" {recording.units[1]} against free air, but it counts positive when the tool presses;"
            " turn it with a minus before the column's name,"
            f" {turned(recording.columns, 'force')};"
            f" {NO_CONTACT_HERE}"
        )


def _refuse_moved_surface(recording: Recording, force: str) -> None:
    """Raise RecordingError for the recording of a run with such a force beyond its surface."""
    if recording.run:
        raise RecordingError(
            f"{recording.run}: moving surface? beyond the surface that the run found last the force"
            f" {force}: the body moved during the run, or its surface was taken for another; run"
            " again with the body at rest, or diagnose with its true --surface"
        )


def refuse_untouched(recording: Recording, usable: Vector) -> None:
    """Raise RecordingError if fewer than 20 samples in contact are usable.

    usable (n,): 1 for samples in contact with a known past and a force above that of free air.
    """
    left = int(np.count_nonzero(usable))
    if left < _MIN_USABLE_SAMPLES:
        raise RecordingError(
            f"{recording.name}: no contact: {left} samples beyond the surface have a force that is"
            " not that of free air, and enough samples around them for a velocity (at"
            f" {1.0 / recording.dt:.4g} samples/s); check --surface, record at a higher rate, or"
            " more presses"
        )
