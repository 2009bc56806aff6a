"""The declaration of a physical effect: the one place that simulation, regression, on-line
estimation, compensation, rendering and the report's sentence are derived from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
StepFunction = Callable[[Vector, float, float, float, float, float, Vector], float]
"""Compiled `(state, x, v, a, t, dt, eta) -> value`.

Value is the effect per unit amplitude at penetration x, velocity v and acceleration a (rig
units), time t [s]; `state` is the effect's own memory, advanced in place by dt [s]; `eta` holds
the shape parameters in the order of their declaration.
"""

BelongsTo = Literal["environment", "rig"]
Stage = Literal["kinematics", "material", "tool", "sensor"]
Compensation = Literal["render", "subtract_force", "correct_position", "shift_time", "mask"]
Family = Literal[
    "adhesion",
    "bias",
    "damping",
    "delay",
    "drift",
    "elastic",
    "friction",
    "hysteresis",
    "inertia",
    "lost motion",
    "outliers",
    "periodic",
    "relaxation",
    "ripple",
    "saturation",
    "stiffening",
]


@dataclass(frozen=True, slots=True)
class Shape:
    """A shape parameter η: it enters the effect nonlinearly and has bounds."""

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    logarithmic: bool = False


@dataclass(frozen=True, slots=True)
class Amplitude:
    """The factor in front of an effect: it enters linearly and is estimated on-line."""

    name: str
    unit: str
    nonnegative: bool = False


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect.

    `unit` strings use the placeholders {x} and {f} for the rig's units of position and force.
    `sentence` is what the report says, with the parameters' names as placeholders.
    """

    name: str
    family: Family
    belongs_to: BelongsTo
    stage: Stage
    amplitude: Amplitude
    step: StepFunction
    sentence: str
    compensation: Compensation
    shapes: tuple[Shape, ...] = ()
    state_size: int = 0
    derivative_order: int = 0
    only_in_contact: bool = True
