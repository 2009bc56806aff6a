"""Where a tool met a surface, by a force that its converter averages while it settles.

Near the surface such a force is not a function of the averaged position, because a part of the
average was taken in the air. The force of a linear body is therefore averaged for each candidate
place of the surface: (x - place) where it is positive, and the speed there.
"""

from __future__ import annotations

import math

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.onset import LEAST_AIR
from teleop_rt.kernels.jit import kernel

POINTS = 4
"""Of the path in each sample: at 80 samples a second 3 ms apart, or 0.1 mm at 40 mm/s."""
MOST_SETTLING = 8
"""Samples in which a converter settles at most; sinc filters have orders up to 5."""
PLACES = 32
"""Tried between the shallowest and the deepest, and again between the best one's neighbours."""
MOST_NEAR = 64
"""Samples about the surface at most: behind it two settling times are waited for."""
SPARE = 4
"""Parameters that a fit uses up: place, stiffness, damping, and the force in the air."""

# The room to work in: sums over the air, sums of a fit, errors of the places, the path.
AT_AIR, AT_SUMS, AT_ERRORS = 0, 3, 13
AT_PATH = AT_ERRORS + PLACES
N_ROOM = AT_PATH + (MOST_NEAR + MOST_SETTLING) * POINTS + 1


def settling_weights(span: int) -> Vector:
    """Return the weights (span POINTS + 1,) of a converter that averages once a conversion.

    That is a sinc filter of that order (Candy, Temes: Oversampling Delta-Sigma Data Converters,
    1992). Raises ValueError for more than MOST_SETTLING samples.
    """
    if span > MOST_SETTLING:
        raise ValueError(f"a force that settles in {span} samples, {MOST_SETTLING} at most")
    average = np.full(POINTS + 1, 1.0 / POINTS)
    average[0] = average[-1] = 0.5 / POINTS
    weights: Vector = np.ones(1)
    for _ in range(span):
        weights = np.convolve(weights, average)
    return weights


@kernel
def sample_at(positions: Vector, last: int, back: int) -> float:
    """Return the position `back` samples before the last, and the last itself for later ones."""
    return float(positions[(last - max(back, 0)) % positions.size])


@kernel
def true_position(positions: Vector, last: int, back: int, span: int) -> float:
    """Undo an average over `span` conversions, whose variance is span / 12, in second order."""
    here = sample_at(positions, last, back)
    if back <= 0:
        return here
    curvature = sample_at(positions, last, back - 1) - 2.0 * here
    curvature += sample_at(positions, last, back + 1)
    return here - span / 24.0 * curvature


@kernel
def fill_path(path: Vector, positions: Vector, last: int, oldest: int, span: int) -> None:
    """Write the path, POINTS a sample by straight lines, from `oldest` samples before the last."""
    before = true_position(positions, last, oldest, span)
    for i in range((path.size - 1) // POINTS):
        after = true_position(positions, last, oldest - i - 1, span)
        for j in range(POINTS):
            path[POINTS * i + j] = before + j / POINTS * (after - before)
        before = after
    path[path.size - 1] = before


@kernel
def averaged_body(path: Vector, weights: Vector, first: int, place: float) -> tuple[float, float]:
    """Average depth and speed [per sample] behind a place, by the converter's weights.

    The speed behind it is the depth's derivative, so its average is one by the weights' own slope.
    """
    depth = speed = 0.0
    taps = weights.size
    for m in range(taps):
        inside = path[first + m] - place
        if inside > 0.0:
            earlier = weights[m - 1] if m > 0 else 0.0
            later = weights[m + 1] if m + 1 < taps else 0.0
            depth += weights[m] * inside
            speed += 0.5 * POINTS * (earlier - later) * inside
    return depth, speed


@kernel
def squared_residual(sums: Vector) -> float:
    """Return the squares that force = c + k depth + b speed leaves, k and b not below zero.

    sums (10,): of 1, depth, speed, force and their products, in the order of `fit_error`.
    """
    n = sums[0]
    dd, dv = sums[4] - sums[1] * sums[1] / n, sums[5] - sums[1] * sums[2] / n
    vv, df = sums[6] - sums[2] * sums[2] / n, sums[7] - sums[1] * sums[3] / n
    vf, ff = sums[8] - sums[2] * sums[3] / n, sums[9] - sums[3] * sums[3] / n
    determinant = dd * vv - dv * dv
    if determinant > 1e-9 * dd * vv:
        k, b = (vv * df - dv * vf) / determinant, (dd * vf - dv * df) / determinant
        if k > 0.0 and b > 0.0:
            return float(max(ff - k * df - b * vf, 0.0))
    if dd > 0.0 and df > 0.0:
        return float(max(ff - df * df / dd, 0.0))
    return float(max(ff, 0.0))


@kernel
def fit_error(
    path: Vector,
    weights: Vector,
    forces: Vector,
    last: int,
    near: int,
    margin: int,
    air: Vector,
    place: float,
    sums: Vector,
) -> float:
    """Return the squares that the best body with its surface at a place leaves.

    air (3,): number, sum and sum of squares of the forces before those `near` samples, of which
    the newest `margin` are left out: their averages are not complete yet.
    """
    sums[:] = 0.0
    sums[0], sums[3], sums[9] = air[0], air[1], air[2]
    for i in range(near - margin):
        f = forces[(last - (near - 1 - i)) % forces.size]
        first = POINTS * (i + margin) - weights.size // 2
        depth, speed = averaged_body(path, weights, first, place)
        sums[0], sums[1], sums[2], sums[3] = (
            sums[0] + 1.0, sums[1] + depth, sums[2] + speed, sums[3] + f,
        )  # fmt: skip
        sums[4], sums[5], sums[6] = (
            sums[4] + depth * depth, sums[5] + depth * speed, sums[6] + speed * speed,
        )  # fmt: skip
        sums[7], sums[8], sums[9] = (
            sums[7] + depth * f, sums[8] + speed * f, sums[9] + f * f,
        )  # fmt: skip
    return squared_residual(sums)


@kernel
def samples_of_rise(forces: Vector, last: int, since: int, apart: int, quiet: float) -> int:
    """Return how many samples ago the force was still quiet, or as far as is looked."""
    rise = since
    while rise < min(apart, MOST_NEAR) and forces[(last - rise) % forces.size] > quiet:
        rise += 1
    return rise


@kernel
def sum_air(forces: Vector, last: int, near: int, apart: int, air: Vector) -> None:
    """Write number, sum and sum of squares of the forces before the `near` newest into air (3,)."""
    air[:] = 0.0
    for back in range(near, min(near + LEAST_AIR, apart)):
        f = forces[(last - back) % forces.size]
        air[0], air[1], air[2] = air[0] + 1.0, air[1] + f, air[2] + f * f


@kernel
def range_about(
    positions: Vector, last: int, rise: int, near: int, span: int
) -> tuple[float, float]:
    """Return the shallowest and the deepest position at which the surface may be."""
    low = high = sample_at(positions, last, rise)
    for back in range(max(rise - 1 - span, 0), near):
        x = sample_at(positions, last, back)
        low, high = min(low, x), max(high, x)
    return low, high


@kernel
def weigh_places(errors: Vector, best: int, step: float, scale: float) -> tuple[float, float]:
    """Return how far from the best place the mean by likelihood is, and the variance about it.

    errors (PLACES,): the squares left by places that are `step` apart; `scale` the variance that
    the force has about the body.
    """
    total = first = second = 0.0
    for j in range(PLACES):
        weight = math.exp(-0.5 * (errors[j] - errors[best]) / scale)
        away = (j - best) * step
        total, first, second = total + weight, first + weight * away, second + weight * away**2
    first /= total
    return first, second / total - first * first


@kernel
def likeliest_place(
    errors: Vector, best: int, low: float, step: float, noise: float, samples: float
) -> tuple[float, float]:
    """Return the mean place by likelihood, and its variance, of places a step apart from `low`.

    errors (PLACES,): the squares that each leaves of so many samples, least at `best`.
    """
    scale = max(noise * noise, errors[best] / max(samples - SPARE, 1.0))
    mean, spread = weigh_places(errors, best, step, scale)
    return low + best * step + mean, spread + step * step / 12.0


@kernel
def surface_behind_averages(
    positions: Vector, forces: Vector, last: int, apart: int, since: int, noise: float,
    quiet: float, weights: Vector, span: int, room: Vector,
) -> tuple[float, float]:  # fmt: skip
    """Return where the tool met the surface, and the variance of that, in the rig's units.

    positions, forces (n,): a ring of averaged samples, the newest at `last`; contact was seen
    `since` samples before, and the `apart` newest came since the last release. `noise` is the
    force's deviation, `quiet` a force below which the tool may be in the air, weights
    (span POINTS + 1,) those of a converter that settles in `span` samples;
    room (N_ROOM,) is its working memory.
    """
    rise = samples_of_rise(forces, last, since, apart, quiet)
    half, near = (span + 1) // 2, min(rise + span + 1, MOST_NEAR)
    path = room[AT_PATH : AT_PATH + (near - 1 + half) * POINTS + 1]
    fill_path(path, positions, last, near - 1 + half, span)
    air, sums, errors = room[AT_AIR:AT_SUMS], room[AT_SUMS:AT_ERRORS], room[AT_ERRORS:AT_PATH]
    sum_air(forces, last, near, apart, air)
    low, high = range_about(positions, last, rise, near, span)
    found, variance = 0.5 * (low + high), (high - low) ** 2 / 12.0
    for _ in range(2):
        step, best = (high - low) / (PLACES - 1), 0
        for j in range(PLACES):
            errors[j] = fit_error(
                path, weights, forces, last, near, half, air, low + j * step, sums
            )
            best = j if errors[j] < errors[best] else best
        found, variance = likeliest_place(errors, best, low, step, noise, sums[0])
        if variance > step * step:
            break
        low, high = low + (best - 1.0) * step, low + (best + 1.0) * step
    return found, variance
