"""What the true environment answers to any motion: the reference that a felt force is held to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def environment_force(truth: Mapping[str, Any], position: Array, velocity: Array) -> Array:
    """Return the force (n,) of a plant's environment at positions and velocities (n,).

    `truth` is what the plant wrote into truth.json; rig units, axis coordinates.
    """
    body = truth["environment"]
    depth = position - body["surface"]
    force = np.maximum(0.0, body["stiffness"] * depth + body["damping"] * velocity)
    return np.where(depth >= 0.0, force, 0.0)
