"""The stiffest and the most damped wall that a simulated handle renders passively: the optimum.

From the plant alone: its damping, latency and motor lag. A period is divided into substeps, the
device moves by a_i in each, and friction takes at least b |a_i|^2/h of it. The command of a sample
acts a latency later, held for a period, through the motor's first-order lag. The port is passive
for every hand if, for every tone, the Hermitian part of the matrix from all a_i to all forces,
plus b/h, has no negative eigenvalue. Nothing here is shared with the bound of the product.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]
SUBSTEPS, TONES, HALVINGS = 50, 60, 11
MOST_DAMPING = 200.0
"""Where the search of the best damping [N s/m] ends."""


def forces(z: complex, latency: float, lag: float) -> Complex:
    """Return the force (SUBSTEPS,) of each substep per unit command of sample 0, at a tone z.

    latency and lag in periods.
    """
    steps = np.arange(SUBSTEPS)
    late = round(latency * SUBSTEPS)
    newest = np.where(steps >= late % SUBSTEPS, 0, 1) + late // SUBSTEPS
    command: Complex = np.power(z, -newest.astype(np.float64)).astype(np.complex128)
    if lag <= 0.0:
        return command
    kept = math.exp(-1.0 / (SUBSTEPS * lag))
    force, response = 0.0 + 0.0j, np.empty(SUBSTEPS, dtype=np.complex128)
    for i in range(SUBSTEPS):
        force = kept * force + (1 - kept) * command[i]
        response[i] = force
    before = force / (z - kept**SUBSTEPS)
    held: Complex = (response + before * kept ** (steps + 1)).astype(np.complex128)
    return held


def needed(
    stiffness: float, damping: float, cutoff_hz: float, period_s: float, latency_s: float,
    lag_s: float,
) -> float:  # fmt: skip
    """Return the least friction with which the port is passive for every hand."""
    pole = math.exp(-2 * math.pi * cutoff_hz * period_s)
    most = 0.0
    for angle in np.geomspace(3e-3, np.pi, TONES):
        z = complex(np.exp(1j * angle))
        velocity = (1 - pole) / (1 - pole / z) * (1 - 1 / z) / period_s
        gain = (stiffness + damping * velocity) / (z - 1)
        column = gain * forces(z, latency_s / period_s, lag_s / period_s)
        matrix = np.repeat(column[:, None], SUBSTEPS, axis=1)
        least = float(np.linalg.eigvalsh(0.5 * (matrix + matrix.conj().T))[0])
        most = max(most, -least * period_s / SUBSTEPS)
    return most


def stiffest(friction: float, period_s: float, latency_s: float, lag_s: float) -> float:
    """Return the stiffest undamped wall."""
    return friction / needed(1.0, 0.0, 0.0, period_s, latency_s, lag_s)


def most_damped(
    friction: float, stiffness: float, cutoff_hz: float, period_s: float, latency_s: float,
    lag_s: float,
) -> float:  # fmt: skip
    """Return the largest damping beside a stiffness."""
    low, high = 0.0, MOST_DAMPING
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        least = needed(stiffness, middle, cutoff_hz, period_s, latency_s, lag_s)
        low, high = (middle, high) if least <= friction else (low, middle)
    return low
