"""Contact detection: force with hysteresis and counted samples, and the surface it implies."""

from __future__ import annotations

import math

import numpy as np

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
    APART,
    CURVED_VARIANCE,
    N_DETECTOR,
) = range(19)

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
HISTORY = 1024
# An onset this far [resolutions] from the one before tells that the environment has moved.
MOVED_RESOLUTIONS = 100.0
# Samples in the air that are looked at beside the rise, at least.
LEAST_AIR = 32
# An onset finds the surface of a curved law too deep, by up to this share of the depth at onset.
CURVED_SHARE = 0.2


@kernel
def rise_error(
    n: float, x: float, f: float, xx: float, xf: float, ff: float, at: float, air: float
) -> float:
    """Return the sum of squares that a line leaves which rises, and not from below `air` at `at`.

    n, x, f, xx, xf, ff: sums over the samples of 1, x, f and their products.
    """
    spread, covariance, variance = xx - x * x / n, xf - x * f / n, ff - f * f / n
    slope = max(covariance / spread, 0.0) if spread > 0.0 else 0.0
    if f / n + slope * (at - x / n) >= air:
        return max(variance - slope * covariance, 0.0)
    square, product = xx - 2.0 * at * x + n * at * at, xf - at * f - air * (x - n * at)
    slope = max(product / square, 0.0) if square > 0.0 else 0.0
    return max(ff - 2.0 * air * f + n * air * air - slope * product, 0.0)


@kernel
def surface_at_onset(
    state: Vector, settings: Vector, positions: Vector, forces: Vector
) -> tuple[float, float]:
    """Return where the tool met the surface, and the variance of that [rig unit, rig unit^2].

    Two-phase regression (Hinkley 1969) of the approach. positions, forces: the ring of the last
    HISTORY aligned samples. Of those since the last release count the rise out of the noise and as
    much before: what the tool's mass did in the air earlier is no matter. Before the surface the
    force has one mean; behind it, it is at least that, for damping makes it jump, and rises in
    proportion to the depth. Of the places between two samples the one with the least squares is
    returned, with the variance of all by their likelihood. A threshold of force alone would find a
    soft body late, by the depth at which its force leaves the noise.
    """
    last, seen = int(state[HISTORY_NEXT]) - 1, min(int(state[APART]), HISTORY)
    quiet = min(2.0 * settings[FORCE_NOISE], settings[RELEASE_FORCE])
    rise = 0
    while rise < seen and forces[(last - rise) % HISTORY] > quiet:
        rise += 1
    count = min(seen, 2 * rise + LEAST_AIR)
    in_air = in_air_squared = 0.0
    for back in range(count):
        f = forces[(last - back) % HISTORY]
        in_air, in_air_squared = in_air + f, in_air_squared + f * f
    end = found = positions[last]
    least, gap = np.inf, 0.0
    weights = first = second = 0.0
    n = sx = sf = sxx = sxf = sff = 0.0
    for back in range(count - 1):
        here, before = (last - back) % HISTORY, (last - back - 1) % HISTORY
        x, f = positions[here] - end, forces[here]
        n, sx, sf = n + 1.0, sx + x, sf + f
        sxx, sxf, sff = sxx + x * x, sxf + x * f, sff + f * f
        in_air, in_air_squared = in_air - f, in_air_squared - f * f
        mean = in_air / (count - n)
        error = in_air_squared - in_air * mean + rise_error(n, sx, sf, sxx, sxf, sff, x, mean)
        error /= 2.0 * settings[FORCE_NOISE] * settings[FORCE_NOISE]
        place = 0.5 * (positions[here] + positions[before])
        if error < least:
            fading = math.exp(error - least)
            weights, first, second = weights * fading, first * fading, second * fading
            least, found, gap = error, place, positions[here] - positions[before]
        weight, offset = math.exp(least - error), place - end
        weights, first, second = (
            weights + weight,
            first + weight * offset,
            second + weight * offset * offset,
        )
    first /= weights
    return found, max(second / weights - first * first, 0.0) + gap * gap / 12.0


@kernel
def place_surface(
    state: Vector, settings: Vector, onset_at: float, variance: float, position: float
) -> None:
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
    state[SURFACE_VARIANCE] = variance
    state[CURVED_VARIANCE] = (CURVED_SHARE * depth) ** 2
    state[SURFACE_KNOWN] = 1.0


@kernel
def surface_variance(state: Vector, curved: bool) -> float:
    """Return the variance of the surface for a law that is curved, or straight [rig unit^2]."""
    return float(state[SURFACE_VARIANCE] + (state[CURVED_VARIANCE] if curved else 0.0))


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
            state[FREE_TICKS] = state[APART] = 0.0
            return RELEASE
        return NOTHING
    state[APART] += 1.0
    if state[BELOW] > 0.0:
        state[VERIFIED_FREE] = max(state[VERIFIED_FREE], position)
        state[FREE_TICKS] += 1.0
        if state[FREE_TICKS] >= settings[FREE_AIR_TICKS]:
            state[FREE_SEEN] = 1.0
    if state[ABOVE] >= settings[ONSET_SAMPLES]:
        if state[FREE_SEEN] > 0.0 and state[FREE_TICKS] >= settings[FREE_AIR_TICKS]:
            state[ONSETS] += 1.0
            found, variance = surface_at_onset(state, settings, positions, forces)
            place_surface(state, settings, found, variance, position)
        return begin_contact(state)
    return NOTHING
