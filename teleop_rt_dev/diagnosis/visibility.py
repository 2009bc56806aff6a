"""Visibility of an effect: the residual of the base's own refit on a force without noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, nnls

from teleop_rt_dev.diagnosis.foreign_motions import RATE_HZ
from teleop_rt_dev.diagnosis.foreign_plants import Foreign, recorded

Array = NDArray[np.float64]
_WIDEST = 0.5
"""Possible error of the surface, as a share of the deepest penetration."""
_CLAMPED_FITS = 4


def foreign_lambda(record: Foreign, *, surface_found: bool) -> float:
    """Return the energy of the true effect that the base's refit leaves, over the noise's power.

    The base is fitted to the force without noise along the path without the encoder's steps, with
    physical signs, with a contact that pulls and one that does not, and with the surface free where
    it must be found. The residual of a refit without effects is the error of this figure, and is
    subtracted.
    """
    rig = record.rig
    if rig is None:
        return 0.0
    every = round((record.t[1] - record.t[0]) * RATE_HZ)
    v = np.gradient(rig.x, 1.0 / RATE_HZ)
    x, v, a = (recorded(row, every) for row in (rig.x, v, np.gradient(v, 1.0 / RATE_HZ)))
    widest = _WIDEST * rig.depth if surface_found else 0.0
    changed, nothing = (
        min(_left((x, v, a), force, record.base, widest, pulls) for pulls in (_pulling, _pushing))
        for force in (record.clean, record.plain)
    )
    # The force's error by the encoder's steps counts as noise, too.
    stiffness = float(np.std(record.plain) / np.std(np.maximum(x, 0.0)))
    steps = (stiffness * float(record.notes["encoder"])) ** 2 / 12.0
    return max(changed - nothing, 0.0) / (record.noise**2 + steps)


def _pulling(design: Array, force: Array) -> float:
    """Return the energy that columns (samples x n) leave of a force, none of them turned."""
    return float(nnls(design, force)[1] ** 2)


def _pushing(design: Array, force: Array) -> float:
    """Return the same if their sum is cut at zero: it is fitted where it is positive."""
    kept, left = np.ones(force.size, dtype=bool), np.inf
    for _ in range(_CLAMPED_FITS):
        made = design @ nnls(design[kept], force[kept])[0]
        left = min(left, float(np.sum((np.maximum(made, 0.0) - force) ** 2)))
        kept = made > 0.0
        if not kept.any():
            break
    return left


def _left(
    motion: tuple[Array, Array, Array],
    force: Array,
    base: str,
    widest: float,
    energy_left: Callable[[Array, Array], float],
) -> float:
    """Return the energy that the base leaves; its surface may move by `widest` at most [m]."""
    x, v, a = motion
    powers = base == "hunt-crossley"

    def energy(at: Array) -> float:
        shift, n = float(np.clip(at[0], -1.0, 1.0)) * widest, float(np.clip(at[1], 0.7, 3.5))
        depth = np.maximum(x + shift, 0.0)
        inside = depth > 0.0
        columns = [depth**n, depth**n * v] if powers else [depth, inside * v]
        columns += [inside * a] if base == "mass-spring-damper" else []
        design = np.array(columns).T
        return energy_left(design / np.linalg.norm(design, axis=0), force)

    shifts = np.linspace(-1.0, 1.0, 21) if widest else np.zeros(1)
    exponents = np.linspace(0.8, 2.8, 11) if powers else np.ones(1)
    starts = [np.array([s, n]) for s in shifts for n in exponents]
    begin = min(starts, key=energy)
    simplex = begin + np.array([[0.0, 0.0], [0.05, 0.0], [0.0, 0.1]])
    settings: Any = {"xatol": 1e-7, "fatol": 0.0, "maxfev": 300, "initial_simplex": simplex}
    found = minimize(energy, begin, method="Nelder-Mead", options=settings)
    return min(float(found.fun), energy(begin))
