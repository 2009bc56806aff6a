"""Where a tool met a surface, by a force channel that is known to be slow.

The force of such a channel leaves the noise late, and rises with the square of time at first. The
force of a linear body therefore passes through the channel's own recursion for each candidate place
of the surface: the depth behind it, and its change per sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.slow_onset import (
    AT_AIR,
    AT_ERRORS,
    AT_PATH,
    AT_SUMS,
    PLACES,
    likeliest_place,
    range_about,
    samples_of_rise,
    squared_residual,
    sum_air,
)
from teleop_rt.kernels.jit import kernel

N_RECURSION = 5
"""Coefficients of y_i = r0 y_(i-1) + r1 y_(i-2) + r2 u_i + r3 u_(i-1) + r4 u_(i-2)."""
_COMPARED = 40
"""Samples of the response to a pulse over which a recursion must repeat it."""
_ALIKE = 1e-6
"""Of the largest response; more is no channel of first or second order."""
_EARLIER = 2
"""Times the samples of the rise by which the search looks back: a slow force rises late."""


def recursion_of(respond: Callable[[float], float]) -> Vector:
    """Return the recursion (N_RECURSION,) of a channel; zeros for none of first or second order.

    `respond` takes one sample of the input and returns the channel's output, at rest at first.
    """
    respond(0.0)
    h = np.array([respond(1.0 if i == 0 else 0.0) for i in range(_COMPARED)])
    # From the third sample on, the response to a pulse repeats by its own last two values.
    past = np.column_stack([h[2:-1], h[1:-2]])
    kept = np.linalg.lstsq(past, h[3:], rcond=1e-9)[0]
    ahead = h[:3] - np.array([0.0, kept[0] * h[0], kept[0] * h[1] + kept[1] * h[0]])
    found = np.concatenate([kept, ahead])
    repeats = np.max(np.abs(past @ kept - h[3:])) <= _ALIKE * np.max(np.abs(h))
    return found if repeats else np.zeros(N_RECURSION)


@kernel
def lagged_error(
    positions: Vector, forces: Vector, last: int, near: int, recursion: Vector, air: Vector,
    place: float, sums: Vector,
) -> float:  # fmt: skip
    """Return the squares that the best body with its surface at a place leaves.

    air (3,): number, sum and sum of squares of the forces before the `near` newest samples.
    """
    sums[:] = 0.0
    sums[0], sums[3], sums[9] = air[0], air[1], air[2]
    y = before = u1 = u2 = 0.0
    for back in range(near - 1, -1, -1):
        here = (last - back) % positions.size
        u = max(positions[here] - place, 0.0)
        now = recursion[0] * y + recursion[1] * before
        now += recursion[2] * u + recursion[3] * u1 + recursion[4] * u2
        before, y, u2, u1 = y, now, u1, u
        f, rate = forces[here], y - before
        sums[0], sums[1], sums[2], sums[3] = (
            sums[0] + 1.0, sums[1] + y, sums[2] + rate, sums[3] + f,
        )  # fmt: skip
        sums[4], sums[5], sums[6] = sums[4] + y * y, sums[5] + y * rate, sums[6] + rate * rate
        sums[7], sums[8], sums[9] = sums[7] + y * f, sums[8] + rate * f, sums[9] + f * f
    return squared_residual(sums)


@kernel
def surface_behind_lag(
    positions: Vector, forces: Vector, last: int, apart: int, noise: float, quiet: float,
    recursion: Vector, room: Vector,
) -> tuple[float, float]:  # fmt: skip
    """Return where the tool met the surface, and the variance of that, in the rig's units.

    As `slow_onset.surface_behind_averages`, for the `recursion` (N_RECURSION,) of the channel.
    """
    rise = samples_of_rise(forces, last, 0, apart, quiet)
    near = int(min(_EARLIER * (rise + 1), apart, positions.size // 2))
    air, sums, errors = room[AT_AIR:AT_SUMS], room[AT_SUMS:AT_ERRORS], room[AT_ERRORS:AT_PATH]
    sum_air(forces, last, near, apart, air)
    low, high = range_about(positions, last, 0, near, 0)
    found, variance = 0.5 * (low + high), (high - low) ** 2 / 12.0
    for _ in range(2):
        step, best = (high - low) / (PLACES - 1), 0
        for j in range(PLACES):
            errors[j] = lagged_error(
                positions, forces, last, near, recursion, air, low + j * step, sums
            )
            best = j if errors[j] < errors[best] else best
        found, variance = likeliest_place(errors, best, low, step, noise, sums[0])
        if variance > step * step:
            break
        low, high = low + (best - 1.0) * step, low + (best + 1.0) * step
    return found, variance
