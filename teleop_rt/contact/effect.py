"""The declaration of a physical effect.

It is the one place that simulation, regression, on-line estimation, compensation, rendering and
the report's sentence are derived from.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = Vector  # the type does not know the number of dimensions
StepFunction = Callable[[Vector, float, float, float, float, float, Vector], float]
"""Compiled `(state, x, v, a, t, dt, eta) -> value`.

Value is the effect per unit amplitude at penetration x, velocity v and acceleration a (rig
units), time t [s]; `state` is the effect's own memory, advanced in place by dt [s]; `eta` holds
the shape parameters in the order of their declaration.
"""

MOST_SHAPES = 16
"""Shape parameters of one effect: a drafted law has up to 11, and a model message carries all."""

BelongsTo = Literal["environment", "rig"]
Stage = Literal["kinematics", "material", "tool", "sensor"]
Compensation = Literal["render", "subtract_force", "correct_position", "shift_time", "mask", "none"]
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


Acts = Literal[
    "adds_force",
    "moves_position",
    "deflects",
    "slackens",
    "filters_force",
    "limits_force",
    "shifts_time",
]
"""How amplitude times value acts on the model's force.

`adds_force`: is added to it. `moves_position`: is added to the penetration that the material
sees. `deflects`: is taken off the penetration; the step sees the force in the place of x.
`slackens`: as `limits_force`, of the force that the tip passes on, before the sensor reads it.
`filters_force`: is the measured force; the step sees the true force as x and its rate as v.
`limits_force`: as `filters_force`, but not linear in the force. `shifts_time`: is the lag [s]
of the measured force.
"""
WITHOUT_CONTACT = "on both sides"
"""The law of a body that is held all along, as a spring or an oil: for bases that do not touch.

Other laws of such a body begin with these words and a comma."""
OF_THE_SPRING = "of the spring"
"""The end of a law whose force is a share of the elastic force of a base with a power.

It is possible beside such a base alone, and takes the place there of the law without these words.
"""
Scale = Literal[
    "", "travel", "speed", "duration", "compliance", "force", "onset", "place", "middle", "range"
]


def handling_in_words(compensation: str) -> str:
    """Return the words for the on-line handling of an effect, by its `Compensation`."""
    return "not corrected" if compensation == "none" else compensation.replace("_", " ")


@dataclass(frozen=True, slots=True)
class Shape:
    """A shape parameter η: it enters the effect nonlinearly and has bounds.

    Bounds, start and `neutral` are multiples of `relative_to`, a scale of the recording (its
    largest penetration, peak speed, length, penetration over force, or force), or absolute where
    that is empty. A "place" counts in travels from the middle of the stroke, because the zero of a
    body that is held all along is arbitrary, and a "range" in halves of the force's range from its
    middle. `points` is how finely a search looks at it, in even steps of the value, of its
    logarithm or of its reciprocal. A `phase` [rad] turns the effect within the plane of its values
    at 0 and pi/2, so a search gets it from two linear amplitudes.
    At its `neutral` value, if it has one, the effect does not deserve its name. At its `ideal`
    bound it is just that, as friction that turns over at once; at any other bound a law stands in
    for something else.
    """

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    logarithmic: bool = False
    reciprocal: bool = False
    relative_to: Scale = ""
    points: int = 8
    phase: bool = False
    neutral: float | None = None
    ideal: Literal["", "lower", "upper"] = ""


@dataclass(frozen=True, slots=True)
class Amplitude:
    """The factor in front of an effect: it enters linearly and is estimated on-line.

    Where the effect acts on position or time it enters nonlinearly, and the bounds (as in
    `Shape`) hold. A `unity` amplitude is 1: the shape parameters alone say the effect's size.
    """

    name: str
    unit: str
    nonnegative: bool = False
    lower: float = 0.0
    upper: float = 0.0
    relative_to: Scale = ""
    points: int = 8
    unity: bool = False


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect.

    `unit` strings use the placeholders {x} and {f} for the rig's units of position and force.
    `sentence` is the report's sentence, with the parameters' names as placeholders, `turned` the
    one of a negative amplitude, which it names with a minus, as {-shift}. Several
    declarations may share a name: the name is the physics, the `law` one mathematical form of it.
    `like` are the names of a set that gives the same force while the tool moves: where the data
    do not exclude it, it stays in the answer beside this law.
    `fades` is the number of terms by which a past that nobody recorded still acts on a memory that
    is linear in the penetration and fades: a fit has to find each of them.
    `moves_mass` states that a position that the rig moves carries the tool's mass along.
    `extends` is the law of the same name to which this one adds shapes: its fit starts there.
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
    acts: Acts = "adds_force"
    law: str = ""
    like: tuple[str, ...] = ()
    fades: int = 0
    extends: str | None = None
    moves_mass: bool = True
    turned: str = ""

    @property
    def without_contact(self) -> bool:
        """Return whether this is a law of a body that is held all along."""
        return self.law.split(",")[0] == WITHOUT_CONTACT
