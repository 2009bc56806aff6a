"""The effects of the second generator by name, and how one is added to a rig."""

from __future__ import annotations

import numpy as np

from teleop_rt_dev.diagnosis.foreign_bodies import material_effect, surface_effect
from teleop_rt_dev.diagnosis.foreign_rigs import Rig
from teleop_rt_dev.diagnosis.foreign_tools import channel_effect, tool_effect

SLOTS = {
    "moves": surface_effect, "material": material_effect, "tool": tool_effect,
    "channel": channel_effect,
}  # fmt: skip
"""In this order each slot draws for an effect, also for one that is not its own."""
NAMES = (
    "contact_offset", "moving_surface", "permanent_set", "series_compliance", "backlash",
    "channel_delay", "stress_relaxation", "fractional_relaxation", "nonlinear_stiffening",
    "second_layer", "hysteresis", "mullins_softening", "softening", "quadratic_damping",
    "adhesion", "coulomb_friction", "stribeck_friction", "viscous_friction",
    "direction_dependent_damping", "gravity_torque", "tool_inertia", "position_ripple",
    "force_bias", "force_drift", "periodic_disturbance", "force_lag", "force_saturation",
    "outliers",
)  # fmt: skip


def add(r: Rig, name: str, size: float) -> None:
    """Add an effect that changes the force by `size` of its standard deviation."""
    before = r.force()
    goal = size * float(np.std(before))
    if name == "series_compliance":
        r.soft = size / (r.k * r.n * r.depth ** (r.n - 1.0))
        for _ in range(3):
            r.soft *= goal / float(np.sqrt(np.mean((r.force() - before) ** 2)))
        return
    for slot, make in SLOTS.items():
        operation = make(r, name)
        if operation is None:
            continue
        place = getattr(r, slot)
        gain = 0.1
        for _ in range(5):
            place.append((operation, gain))
            change = float(np.sqrt(np.mean((r.force() - before) ** 2)))
            place.pop()
            gain *= float(np.clip(goal / max(change, 1e-12), 0.05, 20.0))
        place.append((operation, gain))
        return
    raise ValueError(name)
