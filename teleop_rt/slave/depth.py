"""The depth at which the model in use reaches a force."""

from __future__ import annotations

import math

from teleop_rt.kernels.jit import kernel
from teleop_rt.slave.pace import DEPTH_SHARE
from teleop_rt.slave.record import Tick

NO_MODEL, LINEAR, HUNT_CROSSLEY = range(3)
LEAST_EXPONENT = 0.1
"""A smaller exponent is not that of a stiffening contact, and gives no depth."""


@kernel
def model_depth(tick: Tick, force: float, velocity: float) -> float:
    """Return the depth at which the model in use reaches `force`; infinite while unknown.

    The damping force at this velocity, when it goes deeper, is subtracted from the spring's. An
    effect beside the model counts with its largest slope up to the depth of the model alone.
    """
    if tick.model == NO_MODEL or tick.model_k <= 0.0 or tick.model_n < LEAST_EXPONENT:
        return math.inf
    stiffness = tick.model_k + tick.model_added
    damping = max(0.0, tick.model_b) * max(0.0, velocity)
    if tick.model == HUNT_CROSSLEY:
        stiffness += damping
    else:
        force -= damping
    return float((max(0.0, force) / stiffness) ** (1.0 / tick.model_n))


@kernel
def depth_cap(tick: Tick) -> float:
    """Return the depth at which the force cap is reached, by the model and by the measured force.

    In contact the model only says how much further the measured force leaves room: so an error
    of the surface, or of the stiffness so far, is none of the cap.
    """
    deepest = model_depth(tick, DEPTH_SHARE * tick.force_cap, tick.velocity)
    if tick.in_contact > 0 and math.isfinite(deepest):
        room = deepest - model_depth(tick, tick.force, tick.velocity)
        deepest = min(deepest, tick.position - tick.surface + room)
    return deepest
