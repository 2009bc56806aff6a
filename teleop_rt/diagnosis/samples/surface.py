"""Where the surface lies in a recording, and whether there is contact at all."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.recordings.recording import Recording, without_lone
from teleop_rt.diagnosis.samples.motion import force_noise
from teleop_rt.diagnosis.samples.onset import Surface, onset
from teleop_rt.errors import RecordingError

_ZERO_SURFACE_SHARE = 0.25  # of the depth; a surface guessed nearer to 0 may be 0
_GUESS_ERROR = 1.5  # of the estimated depth: uncertainty of a surface that was never left
_MIN_USABLE_SAMPLES = 20  # in contact; fewer leave no block to test stiffness and damping
_MIN_CONTACT_SAMPLES = 100  # fewer determine neither a stiffness nor a surface
_STIFFEST_N_PER_M = 1e6  # N/m; no rig of this kind presses on anything stiffer
_LONGEST_M = 2.0  # m; no rig here travels farther
_PULL_RATIO = 0.2  # of the force's range; a larger pull in contact means a wrong sign
_AIR_FORCE_RATIO = 5.0  # times the variation in contact; more in free air means a wrong sign
_FALLING_CORRELATION = 0.5  # of force and position, with negative sign, if one is inverted
_ONE_SIDED_RATIO = 3.0  # of the larger to the smaller extreme of a force with one sign
NO_CONTACT_HERE = (
    "or this side of the rig touches nothing, or its converter is saturated: then no sign helps"
)


def surface_of(recording: Recording) -> Surface:
    """Return the surface guessed from the onset of force, or what the recording itself says.

    What a recording says was found while a model ran that may lack an effect, so an approach that
    shows the onset is believed before it. A guess is where the force first rises, for later a body
    with a memory is met elsewhere; an encoder's zero near it says nothing. Only where no approach
    shows the onset, and 0 may be the surface, it is 0 (its error then is what `contact_offset`
    says). Raises RecordingError without contact.
    """
    position, force = recording.position, without_lone(recording.force)
    if recording.surface is not None:
        seen = onset(position, force, recording.dt)
        clear = seen is not None and seen.clear
        return seen if seen and clear else Surface(recording.surface, fixed=True)
    noise = force_noise(force)
    level = float(np.quantile(force, 0.99) - np.quantile(force, 0.01))
    if level < 6.0 * noise:
        raise RecordingError(
            f"{recording.name}: no contact: the force varies by {level:.3g} only, within its noise"
        )
    _refuse_turned_force(recording.name, position, force, 6.0 * noise)
    found = onset(position, force, recording.dt)
    if found is None:
        return _pressed_throughout(position, force, dt=recording.dt)
    deepest = float(np.max(position))
    near = deepest > 0.0 and abs(found.position) <= _ZERO_SURFACE_SHARE * (deepest - found.position)
    if near and not found.clear:
        return Surface(0.0, fixed=True)
    return found


def _refuse_turned_force(name: str, position: Vector, force: Vector, least: float) -> None:
    """Raise RecordingError where the force falls below 0 the deeper the tool is."""
    low, high = (float(q) for q in np.quantile(force, (0.01, 0.99)))
    falls = float(np.corrcoef(position, force)[0, 1]) < -_FALLING_CORRELATION
    if falls and -low > _ONE_SIDED_RATIO * max(high, least):
        raise RecordingError(
            f"{name}: wrong sign? the force falls to {low:.3g} the larger the position is, but it"
            " counts positive when the tool presses; turn it with a minus before the column's name,"
            f" --columns force=-NAME; {NO_CONTACT_HERE}"
        )


def refuse_turned(recording: Recording) -> None:
    """Raise RecordingError where force or position of a contact is counted the other way round.

    A force of both signs, as of a mass that is moved in the air, is left alone.
    """
    name, position, force = recording.name, recording.position, recording.force
    least = 6.0 * force_noise(force)
    if float(np.ptp(position)) == 0.0 or float(np.ptp(force)) <= least:
        return
    _refuse_turned_force(name, position, force, least)
    low, high = (float(q) for q in np.quantile(force, (0.01, 0.99)))
    falls = float(np.corrcoef(position, force)[0, 1]) < -_FALLING_CORRELATION
    if falls and high > _ONE_SIDED_RATIO * max(-low, least):
        raise RecordingError(
            f"{name}: wrong sign? the force rises to {high:.3g} the smaller the position is, but it"
            " counts positive into the environment; turn it with a minus before the column's name,"
            " --columns position=-NAME"
        )


def _pressed_throughout(position: Vector, force: Vector, dt: float) -> Surface:
    """Return the surface of a body that is pressed all along: 0 where it may be, or a guess.

    The line through force over position ends at 1 - 1/n of the depth where a body stiffens with the
    power n, and deeper than the surface where it relaxes, so 0 may be the surface unless that line
    ends farther within than a guess may be off, or the tool went beyond 0. Else the position counts
    from elsewhere, or the body stiffens much: a surface that is found does harm to neither.
    """
    nearest, deepest = float(np.min(position)), float(np.max(position))
    lines = np.array([np.ones_like(force), position - deepest, np.gradient(position, dt)])
    (level, slope, _), *_ = np.linalg.lstsq(lines.T, force, rcond=None)
    if slope <= 0.0 or level <= 0.0:
        return Surface(0.0, fixed=True)
    depth = float(level / slope)
    end = deepest - depth
    if (
        nearest > -_ZERO_SURFACE_SHARE * (deepest - nearest)
        and -deepest < end < _ZERO_SURFACE_SHARE * deepest
    ):
        return Surface(0.0, fixed=True)
    return Surface(min(end, nearest), fixed=False, within=_GUESS_ERROR * depth)


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
    if in_air > _AIR_FORCE_RATIO * in_contact:
        raise RecordingError(
            f"{recording.name}: wrong sign? in contact the force varies by {in_contact:.3g}, in"
            f" free air by {in_air:.3g}; positions count positive into the environment, forces"
            " positive when the tool presses: turn them with a minus before the column's name, or"
            f" check --surface; {NO_CONTACT_HERE}"
        )
    pressed = float(np.median(recording.force[penetration > 0.0]) - np.median(free))
    if -pressed > max(
        6.0 * force_noise(recording.force), _PULL_RATIO * float(np.ptp(recording.force))
    ):
        raise RecordingError(
            f"{recording.name}: wrong sign? in contact the force is {pressed:.3g}"
            f" {recording.units[1]} against free air, but it counts positive when the tool presses;"
            " turn it with a minus before the column's name, --columns force=-NAME;"
            f" {NO_CONTACT_HERE}"
        )


def refuse_untouched(recording: Recording, usable: Vector) -> None:
    """Raise RecordingError where hardly a sample beyond the surface shows the body's force.

    usable (n,): 1 for samples in contact from which something can be learnt.
    """
    left = int(np.count_nonzero(usable))
    if left < _MIN_USABLE_SAMPLES:
        raise RecordingError(
            f"{recording.name}: no contact: {left} samples beyond the surface have a force that is"
            " not that of free air, with their past known; check --surface, or record more presses"
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
