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
    N_DETECTOR,
) = range(16)

# The detector's settings.
(
    ONSET_FORCE,
    RELEASE_FORCE,
    ONSET_SAMPLES,
    RELEASE_SAMPLES,
    FREE_AIR_TICKS,
    FORCE_NOISE,
    RESOLUTION,
    N_DETECTION,
) = range(8)

NOTHING, ONSET, RELEASE = range(3)
HISTORY = 128
# A surface found this far [resolutions, standard deviations] from the known one replaces it.
MOVED_RESOLUTIONS = 100.0
MOVED_DEVIATIONS = 5.0


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
def adopt_surface(state: Vector, settings: Vector, found: float, variance: float) -> bool:
    """Combine a surface found with the known one by their variances [rig unit^2].

    Far from the known one it replaces it: the environment has moved. Returns whether it did, or
    whether none was known before.
    """
    floor = settings[RESOLUTION] * settings[RESOLUTION] / 12.0
    variance += floor
    known = state[SURFACE_KNOWN] > 0.0
    shift = found - state[SURFACE]
    spread = state[SURFACE_VARIANCE] + variance
    gate = MOVED_RESOLUTIONS * settings[RESOLUTION]
    moved = shift * shift > MOVED_DEVIATIONS * MOVED_DEVIATIONS * spread and abs(shift) > gate
    if known and not moved:
        gain = state[SURFACE_VARIANCE] / spread
        state[SURFACE] += gain * shift
        state[SURFACE_VARIANCE] = max((1.0 - gain) * state[SURFACE_VARIANCE], 0.1 * floor)
        return False
    state[SURFACE] = found
    state[SURFACE_VARIANCE] = variance
    state[SURFACE_KNOWN] = 1.0
    return True


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
            deepest = max(position - found, settings[RESOLUTION])
            adopt_surface(state, settings, found, deepest * deepest)
        return begin_contact(state)
    return NOTHING
