"""Contact detection: force with hysteresis and counted samples, and the surface it implies."""

from __future__ import annotations

from teleop_rt.contact.effect import Vector
from teleop_rt.jit import kernel

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
    N_DETECTOR,
) = range(17)

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
    N_DETECTION,
) = range(9)

NOTHING, ONSET, RELEASE = range(3)
HISTORY = 128
# An onset this far [resolutions] from the one before tells that the environment has moved.
MOVED_RESOLUTIONS = 100.0


@kernel
def surface_at_onset(state: Vector, settings: Vector, positions: Vector, forces: Vector) -> float:
    """Return the last position before the onset whose force was lost in the noise.

    positions, forces: the ring of the last HISTORY aligned samples. That position is less deep
    than the one where the threshold was crossed; it is off by at most one tick's travel plus the
    depth that two standard deviations of force make.
    """
    quiet = min(2.0 * settings[FORCE_NOISE], settings[RELEASE_FORCE])
    last = int(state[HISTORY_NEXT]) - 1
    for back in range(HISTORY):
        index = (last - back) % HISTORY
        if forces[index] <= quiet:
            return float(positions[index])
    return float(positions[(last - int(settings[ONSET_SAMPLES])) % HISTORY])


@kernel
def place_surface(state: Vector, settings: Vector, onset_at: float, position: float) -> None:
    """Take the surface from an onset, unless one is known and the onset is where it used to be.

    Onsets are compared with onsets: on a soft environment they all come late by as much, while a
    fit over the contact has found the surface better than any onset can. A body that LETS_GO of
    the tool beyond its surface is met again deeper, which tells nothing of the surface.
    """
    gate = MOVED_RESOLUTIONS * settings[RESOLUTION]
    gate = max(gate, 0.3 * abs(state[ONSET_AT] - state[SURFACE]))
    deeper = onset_at - state[ONSET_AT]
    if state[SURFACE_KNOWN] > 0.0 and (abs(deeper) < gate or settings[LETS_GO] * deeper > 0.0):
        return
    depth = max(position - onset_at, settings[RESOLUTION])
    state[ONSET_AT] = onset_at
    state[SURFACE] = onset_at
    # The tool came in somewhere between: uniform over that depth.
    state[SURFACE_VARIANCE] = depth * depth / 12.0
    state[SURFACE_KNOWN] = 1.0


@kernel
def refine_surface(state: Vector, settings: Vector, found: float, variance: float) -> None:
    """Combine a surface fitted over a contact with those before, by variance [rig unit^2].

    The surface of an onset alone is replaced: what it is off by is no random error.
    """
    floor = settings[RESOLUTION] * settings[RESOLUTION] / 12.0
    fitted = variance + floor
    if state[SURFACE] == state[ONSET_AT]:
        state[SURFACE] = found
        state[SURFACE_VARIANCE] = fitted
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
def detect(
    state: Vector,
    settings: Vector,
    positions: Vector,
    forces: Vector,
    position: float,
    force: float,
) -> int:
    """Advance the detector by one aligned sample; return NOTHING, ONSET or RELEASE.

    An onset gives a surface only after free air was seen; a run that starts in contact has none
    until it lets go.
    """
    if state[STARTED] == 0.0:
        state[STARTED] = 1.0
        state[ORIGIN] = position
        state[VERIFIED_FREE] = -1e300
    index = int(state[HISTORY_NEXT]) % HISTORY
    positions[index] = position
    forces[index] = force
    state[HISTORY_NEXT] = index + 1.0
    if state[SURFACE_FIXED] > 0.0:
        return detect_by_position(state, settings, position)
    state[ABOVE] = state[ABOVE] + 1.0 if force > settings[ONSET_FORCE] else 0.0
    state[BELOW] = state[BELOW] + 1.0 if force < settings[RELEASE_FORCE] else 0.0
    if state[IN_CONTACT] > 0.0:
        if state[BELOW] >= settings[RELEASE_SAMPLES]:
            state[IN_CONTACT] = 0.0
            state[FREE_TICKS] = 0.0
            return RELEASE
        return NOTHING
    if state[BELOW] > 0.0:
        state[VERIFIED_FREE] = max(state[VERIFIED_FREE], position)
        state[FREE_TICKS] += 1.0
        if state[FREE_TICKS] >= settings[FREE_AIR_TICKS]:
            state[FREE_SEEN] = 1.0
    if state[ABOVE] >= settings[ONSET_SAMPLES]:
        if state[FREE_SEEN] > 0.0 and state[FREE_TICKS] >= settings[FREE_AIR_TICKS]:
            state[ONSETS] += 1.0
            found = surface_at_onset(state, settings, positions, forces)
            place_surface(state, settings, found, position)
        return begin_contact(state)
    return NOTHING
