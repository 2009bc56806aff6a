"""The surface of a recording by a flexible description of the first penetration, not by a model.

On-line the surface is refined by the models that run; where those lack an effect it is drawn away.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SURE = 0.05
"""A force this share of its range above the lowest tells that the tool is in contact or near."""
_CANDIDATES = 60
_DEEP_SHARE = 0.2
"""The first part of the penetration, over which the force is described."""
_MOST_SAMPLES = 4000
_LEAST_SHARE = 0.02
_LEAST_SAMPLES = 50
_WINDOW_S = 0.02


def surface_by_hinge(position: Array, force: Array, dt: float) -> float | None:
    """Return where force begins to grow with depth [rig unit], None where no free air is seen.

    In free air the force may have a bias and friction of either direction; from the surface on, a
    parabola of the depth and a damper add to it. The surface is where that leaves least.
    """
    half = max(2, round(0.5 * _WINDOW_S / dt))
    velocity = np.asarray(scipy.signal.savgol_filter(position, 2 * half + 1, 2, deriv=1, delta=dt))
    low, high = float(np.min(position)), float(np.max(position))
    grown = force > np.quantile(force, 0.01) + _SURE * np.ptp(force)
    if not grown.any() or high <= low:
        return None
    sure = float(np.quantile(position[grown], 0.01))
    top = min(high, sure + _DEEP_SHARE * (high - sure))
    # The first approach alone: a body with memory lags behind a tool that comes back.
    near = np.arange(int(np.argmax(position >= top)))
    near = near[:: max(1, near.size // _MOST_SAMPLES)]
    if near.size < _LEAST_SAMPLES:
        return None
    x, f, v = position[near], force[near], velocity[near]
    edges = np.array([low, top]) + np.array([_LEAST_SHARE, -_LEAST_SHARE]) * (top - low)
    grid = np.linspace(edges[0], edges[1], _CANDIDATES)
    left = [_left_over(s, x, f, v) for s in grid]
    best = int(np.argmin(left))
    if best == 0 or np.count_nonzero(x < grid[best]) < _LEAST_SHARE * x.size:
        return None
    around = (grid[max(0, best - 1)], grid[min(_CANDIDATES - 1, best + 1)])
    found = scipy.optimize.minimize_scalar(
        _left_over, bounds=around, args=(x, f, v), method="bounded", options={"xatol": 1e-7}
    )
    return float(found.x)


def _left_over(surface: float, x: Array, f: Array, v: Array) -> float:
    """Return the sum of squares that the description leaves with this surface."""
    depth = np.maximum(x - surface, 0.0)
    inside = (depth > 0.0).astype(np.float64)
    scale = max(float(np.max(depth)), 1e-12)
    speed = v / max(float(np.max(np.abs(v))), 1e-12)
    rows = np.column_stack(
        (np.ones_like(x), np.sign(v) * (np.abs(speed) > 0.02), speed,
         depth / scale, (depth / scale) ** 2, inside * speed, depth / scale * speed)
    )  # fmt: skip
    _, left, *_ = np.linalg.lstsq(rows, f, rcond=None)
    if left.size:
        return float(left[0])
    return float(np.sum((f - rows @ np.linalg.lstsq(rows, f, rcond=None)[0]) ** 2))
