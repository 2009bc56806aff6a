"""Where a tool met a surface, by the force on its way in.

Two-phase regression (Hinkley 1969) of the approach: before the surface the force has one mean;
behind it, it is at least that, for damping makes it jump, and rises in proportion to the depth. Of
the places between two samples the one with the least squares is returned, with the variance of all
by their likelihood. A threshold of force alone would find a soft body late, by the depth at which
its force leaves the noise.
"""

from __future__ import annotations

import math

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.kernels.jit import kernel

# Samples in the air that are looked at beside the rise, at least.
LEAST_AIR = 32


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
def samples_of_approach(forces: Vector, last: int, apart: int, quiet: float) -> int:
    """Return how many samples the rise above `quiet` [force unit] and as much air before it have.

    Earlier forces of the tool's mass in free air are not counted.
    """
    ring = forces.size
    seen, rise = min(apart, ring), 0
    while rise < seen and forces[(last - rise) % ring] > quiet:
        rise += 1
    return int(min(seen, 2 * rise + LEAST_AIR))


@kernel
def step_back(measured: Vector, here: int, most: int) -> int:
    """Return how many samples before `here` the next measured one lies; 0 for none in `most`."""
    for step in range(1, most + 1):
        if measured[(here - step) % measured.size] > 0.0:
            return step
    return 0


@kernel
def sums_of_air(
    positions: Vector, forces: Vector, measured: Vector, last: int, count: int
) -> tuple[float, float, float, float, float]:
    """Return number, force and its square, and number and force of samples not on a way out.

    Of those measured among the `count` newest: the surface is thought behind all of them at first.
    A sample without one before it is on no way.
    """
    ring = positions.size
    number = total = squares = calm = calm_force = 0.0
    for back in range(count):
        here = (last - back) % ring
        if measured[here] == 0.0:
            continue
        f = forces[here]
        number, total, squares = number + 1.0, total + f, squares + f * f
        step = step_back(measured, here, count - 1 - back)
        if step > 0 and positions[here] >= positions[(here - step) % ring]:
            calm, calm_force = calm + 1.0, calm_force + f
    return number, total, squares, calm, calm_force


@kernel
def weigh(
    error: float, offset: float, least: float, weights: float, first: float, second: float
) -> tuple[float, float, float, float]:
    """Add a place to the sums of all by its likelihood, as a share of the likeliest one's.

    Return the least error, and the sums of weights, weighted offsets and their squares.
    """
    if error < least:
        fading = math.exp(error - least)
        weights, first, second = weights * fading, first * fading, second * fading
        least = error
    weight = math.exp(least - error)
    return least, weights + weight, first + weight * offset, second + weight * offset * offset


@kernel
def surface_at_onset(
    positions: Vector,
    forces: Vector,
    measured: Vector,
    last: int,
    apart: int,
    noise: float,
    quiet: float,
) -> tuple[float, float, float]:
    """Return where the tool met the surface, the variance of that, and the most force before it.

    In the rig's units. The last is an upper bound (3 deviations) of the mean force before, while
    the tool stood or went in: on its way out of a body damping may take all force away. Where that
    is no force of free air, the tool had come to rest inside, and the place found is no surface.

    positions, forces, measured (n,): a ring of aligned samples, the newest at `last`, of which the
    `apart` newest came since the last release (two or more); `noise` the force's deviation; `quiet`
    that of `samples_of_approach`. Samples that are not measured, which bridge a gap, say nothing:
    their straight line across the surface begins too early.
    """
    ring, count = positions.size, samples_of_approach(forces, last, apart, quiet)
    number, in_air, in_air_squared, calm, calm_force = sums_of_air(
        positions, forces, measured, last, count
    )
    end = found = positions[last]
    least, most, gap = np.inf, np.inf, 0.0
    weights = first = second = 0.0
    n = sx = sf = sxx = sxf = sff = 0.0
    for back in range(count - 1):
        here = (last - back) % ring
        step = step_back(measured, here, count - 1 - back) if measured[here] > 0.0 else 0
        if step == 0:
            continue
        x, f = positions[here] - end, forces[here]
        n, sx, sf = n + 1.0, sx + x, sf + f
        sxx, sxf, sff = sxx + x * x, sxf + x * f, sff + f * f
        in_air, in_air_squared = in_air - f, in_air_squared - f * f
        before = (here - step) % ring
        if positions[here] >= positions[before]:
            calm, calm_force = calm - 1.0, calm_force - f
        mean = in_air / (number - n)
        error = in_air_squared - in_air * mean + rise_error(n, sx, sf, sxx, sxf, sff, x, mean)
        error = error / (2.0 * noise * noise) - math.log(step)  # a wide place is as many
        place = 0.5 * (positions[here] + positions[before])
        if error < least:
            found, gap = place, positions[here] - positions[before]
            most = calm_force / calm + 3.0 * noise / math.sqrt(calm) if calm > 0.0 else np.inf
        least, weights, first, second = weigh(error, place - end, least, weights, first, second)
    first /= weights
    return found, max(second / weights - first * first, 0.0) + gap * gap / 12.0, most
