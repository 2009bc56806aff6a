"""Whether the operator would feel another model: over the positions and velocities just seen."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import damped_velocity, linear_force, power_force, touches
from teleop_rt.estimation import rows
from teleop_rt.estimation.walls import AMPLITUDES, COUNT, MODEL, OFFSET, SURFACE, B, K, N
from teleop_rt.kernels.jit import kernel
from teleop_rt.link.messages import MOST_EFFECTS

Matrix = NDArray[np.float64]

FELT_SHARE = 0.02
"""A change of less than this share of the range of the force is not felt, nor is noise."""
NEW, SENT = range(2)
NO_MODEL = -1.0
"""Code of a wall before the first model was sent."""
N_WALL = AMPLITUDES + MOST_EFFECTS
POSITION, VELOCITY, TERMS = range(3)
N_SEEN = TERMS + MOST_EFFECTS


@kernel
def wall_force(wall: Vector, position: float, velocity: float) -> float:
    """Return the force of a wall, without its inertia and effects."""
    depth, total = position - wall[SURFACE], float(wall[OFFSET])
    if not touches(depth):
        return total
    if wall[MODEL] == rows.HUNT_CROSSLEY:
        return total + power_force(depth, velocity, wall[K], wall[B], wall[N])
    damped = damped_velocity(velocity, one_way=wall[MODEL] == rows.UNILATERAL)
    return total + linear_force(depth, damped, wall[K], wall[B])


@kernel
def is_felt(walls: Matrix, seen: Matrix, noise: float, share: float) -> bool:
    """Return whether the forces of the new and the sent wall differ by more than can be felt.

    walls (2, N_WALL): both, the sent one's model NO_MODEL before the first; seen (N_SEEN,
    samples): positions, not-a-number where there was no contact, velocities, and values of effects
    per unit amplitude. The bar is `noise`, and either `share` of the force at each sample or, with
    none (0), FELT_SHARE of the range of the forces.
    """
    new, sent = walls[NEW], walls[SENT]
    if new[MODEL] != sent[MODEL] or new[COUNT] != sent[COUNT]:
        return True
    largest, lowest, highest = 0.0, math.inf, -math.inf
    for i in range(seen.shape[1]):
        position, velocity = seen[POSITION, i], seen[VELOCITY, i]
        if not math.isfinite(position):
            continue
        force = wall_force(new, position, velocity)
        change = force - wall_force(sent, position, velocity)
        for j in range(MOST_EFFECTS):
            change += (new[AMPLITUDES + j] - sent[AMPLITUDES + j]) * seen[TERMS + j, i]
        change = abs(change)
        if share > 0.0 and change > max(noise, share * abs(force)):
            return True
        largest = max(largest, change)
        lowest, highest = min(lowest, force), max(highest, force)
    return share <= 0.0 and largest > max(noise, FELT_SHARE * (highest - lowest))
