"""Least squares over whole recordings, by the normal equations and one refinement."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector

Matrix = NDArray[np.float64]

# Beyond this condition number of the scaled normal matrix the digits are no longer safe.
WORST_CONDITION = 1e10
CHUNK = 65_536
"""Samples of one product of matrices, which stay in the processor's cache."""


def least_squares(phi: Matrix, y: Vector) -> Vector:
    """Return the theta (n,) that minimises |y - phi theta|: phi (samples, n), y (samples,).

    Columns are scaled and the solution of the normal equations (3.14) is refined once on the
    residual, which gives the digits of an orthogonal method at a fraction of its cost; where the
    scaled normal matrix is too ill-conditioned for that, the orthogonal method itself is used.
    Raises ValueError for input that is not finite, or fewer samples than parameters.
    """
    samples, n = phi.shape
    if samples < n:
        raise ValueError(f"{samples} samples cannot determine {n} parameters")
    normal, right = _normal_equations(phi, y)
    if not (np.all(np.isfinite(normal)) and np.all(np.isfinite(right))):
        raise ValueError("phi and y must be finite")
    scale = np.sqrt(np.diag(normal))
    scale[scale == 0.0] = 1.0
    scaled = normal / np.outer(scale, scale)
    if not np.linalg.cond(scaled) < WORST_CONDITION:
        return np.asarray(np.linalg.lstsq(phi, y, rcond=None)[0], dtype=np.float64)
    theta = np.linalg.solve(scaled, right / scale) / scale
    _, left = _normal_equations(phi, y, theta)
    refined: Vector = theta + np.linalg.solve(scaled, left / scale) / scale
    return refined


def _normal_equations(phi: Matrix, y: Vector, theta: Vector | None = None) -> tuple[Matrix, Vector]:
    """Return phi' phi and phi' (y - phi theta), summed in chunks that stay in the cache.

    With theta given only the second is wanted, and the first is left zero.
    """
    n = phi.shape[1]
    normal, right = np.zeros((n, n)), np.zeros(n)
    for start in range(0, len(y), CHUNK):
        part = phi[start : start + CHUNK]
        target = y[start : start + CHUNK]
        if theta is None:
            normal += part.T @ part
        else:
            target = target - part @ theta
        right += part.T @ target
    return normal, right
