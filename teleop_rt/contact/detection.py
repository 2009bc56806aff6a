"""Contact detection: force with hysteresis and counted samples, and the surface it implies."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.lagged_onset import N_RECURSION, surface_behind_lag
from teleop_rt.contact.onset import surface_at_onset
from teleop_rt.contact.slow_onset import (
    MOST_SETTLING,
    N_ROOM,
    POINTS,
    surface_behind_averages,
)
from teleop_rt.kernels.jit import kernel

Matrix = NDArray[np.float64]

# The detector's state.
(
    IN_CONTACT,
    CONTACT_ID,
    ONSETS,
    SURFACE,
    SURFACE_KNOWN,
    SURFACE_VARIANCE,
    SURFACE_FIXED,
    ABOVE,
    BELOW,
    FREE_TICKS,
    FREE_SEEN,
    VERIFIED_FREE,
    ORIGIN,
    STARTED,
    HISTORY_NEXT,
    ONSET_AT,
    APART,
    CURVED_VARIANCE,
    MET_AT,
    MET_VARIANCE,
    AWAITED,
    N_DETECTOR,
) = range(22)

# The detector's settings.
(
    ONSET_FORCE,
    RELEASE_FORCE,
    ONSET_SAMPLES,
    RELEASE_SAMPLES,
    FREE_AIR_TICKS,
    FORCE_NOISE,
    RESOLUTION,
    LETS_GO,
    FOLLOWED,
    SETTLING,
    LAGGED,
    RECURSION,
    AVERAGE,
) = (*range(12), 11 + N_RECURSION)
# From RECURSION on there is that of a slow force channel, if it is LAGGED and known.
# From AVERAGE on there are the weights of a converter that settles in SETTLING samples.
N_DETECTION = AVERAGE + MOST_SETTLING * POINTS + 1

NEVER_FREE = -1e300  # VERIFIED_FREE [rig unit] before any free air: no place is less deep
NOTHING, ONSET, RELEASE, FOUND = range(4)
# Settling times of a slow force's converter until it places a surface: as much of its force lies
# behind the part that was averaged over the surface as before.
SETTLINGS = 2
HISTORY = 1024
"""Newest samples that the detector keeps, to search the surface of a contact in them."""
# An onset this far [resolutions] from the previous one shows that the environment has moved.
MOVED_RESOLUTIONS = 100.0
# ... and by so many deviations of two such onsets: between slow samples a fast tool goes far.
SURE_DEVIATIONS = 3.0
# An onset finds the surface of a curved law too deep, by up to this share of the depth at onset.
CURVED_SHARE = 0.2


@kernel
def place_surface(
    state: Vector, settings: Vector, onset_at: float, variance: float, position: float
) -> None:
    """Take the surface from an onset, unless one is known and the onset is where it used to be.

    Onsets are compared only with onsets: under a curved law all are too deep by the same amount,
    while a fit over the contact locates the surface better than any onset. A body that LETS_GO of
    the tool beyond its surface is met deeper the next time; that onset does not move the surface;
    nor does any on a surface whose motion is FOLLOWED.
    """
    if settings[FOLLOWED] > 0.0 and state[SURFACE_KNOWN] > 0.0:
        return
    gate = MOVED_RESOLUTIONS * settings[RESOLUTION]
    gate = max(gate, 0.3 * abs(state[ONSET_AT] - state[SURFACE]))
    gate = max(gate, SURE_DEVIATIONS * math.sqrt(2.0 * variance))
    deeper = onset_at - state[ONSET_AT]
    if state[SURFACE_KNOWN] > 0.0 and (abs(deeper) < gate or settings[LETS_GO] * deeper > 0.0):
        return
    depth = max(position - onset_at, settings[RESOLUTION])
    state[ONSET_AT] = onset_at
    state[SURFACE] = onset_at
    state[SURFACE_VARIANCE] = variance
    state[CURVED_VARIANCE] = (CURVED_SHARE * depth) ** 2
    state[SURFACE_KNOWN] = 1.0


@kernel
def last_in_air(state: Vector) -> float:
    """Return the deepest place that was surely in the air before the last onset seen from there.

    As deep as can be where there was no such onset.
    """
    if state[MET_VARIANCE] == 0.0:
        return np.inf
    return float(state[MET_AT] - SURE_DEVIATIONS * math.sqrt(state[MET_VARIANCE]))


@kernel
def surface_variance(state: Vector, curved: bool) -> float:
    """Return the variance of the surface for a law that is curved, or straight [rig unit^2]."""
    return float(state[SURFACE_VARIANCE] + (state[CURVED_VARIANCE] if curved else 0.0))


@kernel
def refine_surface(state: Vector, settings: Vector, found: float, variance: float) -> None:
    """Combine a surface fitted over a contact with those before, by variance [rig unit^2].

    The surface of an onset alone is replaced: its error is systematic.
    """
    floor = settings[RESOLUTION] * settings[RESOLUTION] / 12.0
    fitted = variance + floor
    if state[SURFACE] == state[ONSET_AT]:
        state[SURFACE] = found
        state[SURFACE_VARIANCE] = fitted
        state[CURVED_VARIANCE] = 0.0
        return
    gain = state[SURFACE_VARIANCE] / (state[SURFACE_VARIANCE] + fitted)
    state[SURFACE] += gain * (found - state[SURFACE])
    state[SURFACE_VARIANCE] = max((1.0 - gain) * state[SURFACE_VARIANCE], 0.1 * floor)


@kernel
def begin_contact(state: Vector) -> int:
    """Enter contact and return ONSET."""
    state[IN_CONTACT] = 1.0
    state[CONTACT_ID] += 1.0
    state[BELOW] = 0.0
    return ONSET


@kernel
def detect_by_position(state: Vector, settings: Vector, position: float) -> int:
    """Decide contact by position alone, for a surface that is given."""
    inside = position > state[SURFACE]
    if state[IN_CONTACT] == 0.0 and inside:
        state[ONSETS] += 1.0
        return begin_contact(state)
    if not inside:
        state[VERIFIED_FREE] = max(state[VERIFIED_FREE], position)
        if state[IN_CONTACT] > 0.0 and position < state[SURFACE] - settings[RESOLUTION]:
            state[IN_CONTACT] = 0.0
            return RELEASE
    return NOTHING


@kernel
def waits(settings: Vector) -> int:
    """Return the samples from an onset until a slow force places the surface."""
    span = int(settings[SETTLING])
    return SETTLINGS * span + (span + 1) // 2


@kernel
def place_behind_averages(
    state: Vector, settings: Vector, positions: Vector, forces: Vector, last: int, room: Vector
) -> None:
    """Take the surface from an averaged force, by all that came since the onset."""
    span, since = int(settings[SETTLING]), waits(settings) - int(state[AWAITED])
    state[AWAITED] = 0.0
    found, variance = surface_behind_averages(
        positions,
        forces,
        last,
        int(state[APART]) + since,
        since,
        settings[FORCE_NOISE],
        min(2.0 * settings[FORCE_NOISE], settings[RELEASE_FORCE]),
        settings[AVERAGE : AVERAGE + span * POINTS + 1],
        span,
        room,
    )
    state[MET_AT], state[MET_VARIANCE] = found, variance
    place_surface(state, settings, found, variance, positions[last])


@kernel
def stay_or_leave(
    state: Vector, settings: Vector, positions: Vector, forces: Vector, last: int, room: Vector
) -> int:
    """Advance a contact; return NOTHING, RELEASE, or FOUND where its surface was placed now."""
    left = state[BELOW] >= settings[RELEASE_SAMPLES]
    placed = False
    if state[AWAITED] > 0.0:
        state[AWAITED] -= 1.0
        if left or state[AWAITED] == 0.0:
            known = state[SURFACE]
            place_behind_averages(state, settings, positions, forces, last, room)
            placed = state[SURFACE] != known
    if left:
        state[IN_CONTACT] = 0.0
        state[FREE_TICKS] = state[APART] = 0.0
        return RELEASE
    return FOUND if placed else NOTHING


@kernel
def meet_surface(state: Vector, settings: Vector, history: Matrix, last: int, room: Vector) -> None:
    """Take the surface from an onset out of free air, or have it awaited from an averaged force."""
    positions, forces, apart = history[0], history[1], int(state[APART])
    state[ONSETS] += 1.0
    noise = settings[FORCE_NOISE]
    quiet = min(2.0 * noise, settings[RELEASE_FORCE])
    found, variance, before = surface_at_onset(
        positions, forces, history[2], last, apart, noise, quiet
    )
    if before >= settings[RELEASE_FORCE]:
        return
    if settings[SETTLING] > 0.0:
        state[AWAITED] = float(waits(settings))
        return
    # Where a surface is known, the position is made as slow as the force before it comes here.
    if settings[LAGGED] > 0.0 and state[SURFACE_KNOWN] == 0.0:
        recursion = settings[RECURSION : RECURSION + N_RECURSION]
        found, variance = surface_behind_lag(
            positions, forces, last, apart, noise, quiet, recursion, room
        )
    state[MET_AT], state[MET_VARIANCE] = found, variance
    place_surface(state, settings, found, variance, positions[last])


@kernel
def remember(state: Vector, history: Matrix, position: float, force: float, seen: bool) -> int:
    """Write a sample into the rings of the history (3, HISTORY); return its place there."""
    if state[STARTED] == 0.0:
        state[STARTED] = 1.0
        state[ORIGIN] = position
        state[VERIFIED_FREE] = NEVER_FREE
    index = int(state[HISTORY_NEXT]) % HISTORY
    history[0, index], history[1, index] = position, force
    history[2, index] = 1.0 if seen else 0.0
    state[HISTORY_NEXT] = index + 1.0
    return index


@kernel
def detect(
    state: Vector,
    settings: Vector,
    history: Matrix,
    room: Vector,
    position: float,
    force: float,
    seen: bool,
) -> int:
    """Advance the detector by one aligned sample; return NOTHING, ONSET, RELEASE or FOUND.

    history (3, HISTORY): positions, forces, and which were `seen`: the others bridge a gap. No such
    force makes an onset.

    An onset gives a surface only after free air was seen, and from there: a tool that rests inside
    with less force than an onset's, as damping lets it come to rest on its way out, has not left. A
    run that starts in contact has no surface until it lets go. An averaged force places the surface
    some samples later: FOUND.
    """
    index = remember(state, history, position, force, seen)
    positions, forces = history[0], history[1]
    if state[SURFACE_FIXED] > 0.0:
        return detect_by_position(state, settings, position)
    if force <= settings[ONSET_FORCE]:
        state[ABOVE] = 0.0
    elif seen:
        state[ABOVE] += 1.0
    state[BELOW] = state[BELOW] + 1.0 if force < settings[RELEASE_FORCE] else 0.0
    if state[IN_CONTACT] > 0.0:
        return stay_or_leave(state, settings, positions, forces, index, room)
    state[APART] += 1.0
    if state[BELOW] > 0.0:
        state[VERIFIED_FREE] = max(state[VERIFIED_FREE], position)
        state[FREE_TICKS] += 1.0
        if state[FREE_TICKS] >= settings[FREE_AIR_TICKS]:
            state[FREE_SEEN] = 1.0
    if state[ABOVE] >= settings[ONSET_SAMPLES]:
        if state[FREE_SEEN] > 0.0 and state[FREE_TICKS] >= settings[FREE_AIR_TICKS]:
            meet_surface(state, settings, history, index, room)
        return begin_contact(state)
    return NOTHING


@kernel
def detect_all(
    state: Vector,
    settings: Vector,
    rings: Matrix,
    room: Vector,
    positions: Vector,
    forces: Vector,
    found: Vector,
) -> int:
    """Put in `found` where the contacts of a recording met the surface; return their number.

    rings (3, HISTORY): the detector's history; positions, forces, found (n,).
    """
    count = 0
    for i in range(positions.size):
        state[MET_VARIANCE] = 0.0
        detect(state, settings, rings, room, positions[i], forces[i], True)  # noqa: FBT003
        if state[MET_VARIANCE] > 0.0:
            found[count] = state[MET_AT]
            count += 1
    return count


def surfaces_met(settings: Vector, positions: Vector, forces: Vector) -> Vector:
    """Return where each contact of a recording met the surface, as it is found on line.

    Off line this is one of two ways, because two problems differ. The detector has the samples up
    to now, presumes one mean force in free air and settings of the rig, and decides within a
    cycle. diagnosis/samples/onset.py has the whole recording, without settings, of a tool that may
    have friction and a weight: it searches all approaches for corners first, and uses the
    detector where none is clear. Contacts that begin elsewhere than in free air are left out.
    settings (N_DETECTION,); positions, forces (n,): aligned.
    """
    state, rings, room = np.zeros(N_DETECTOR), np.zeros((3, HISTORY)), np.zeros(N_ROOM)
    found = np.zeros(positions.size)
    return found[: detect_all(state, settings, rings, room, positions, forces, found)]
