"""Stiffness that changes with the depth, by a power, an exponential or a level."""

from __future__ import annotations

from math import exp

from teleop_rt.contact.effect import WITHOUT_CONTACT, Amplitude, Effect, Shape, Vector
from teleop_rt.contact.law import spring_force
from teleop_rt.kernels.jit import kernel


@kernel
def _power(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return spring_force(max(x, 0.0), 1.0, eta[0])


@kernel
def _exponential(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    ratio = min(max(x, 0.0) / eta[0], 50.0)
    return float(exp(ratio) - 1.0 - ratio)


@kernel
def _levelling(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    depth = max(x, 0.0)
    return float(depth / (1.0 + (depth / eta[0]) ** eta[1]) ** (1.0 / eta[1]))


@kernel
def _at_once(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(1.0 - exp(-max(x, 0.0) / eta[0]))


@kernel
def _cubic(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return float((x - eta[0]) ** 3)


@kernel
def _odd_power(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    beside = x - eta[0]
    return float(abs(beside) ** eta[1] if beside > 0.0 else -(abs(beside) ** eta[1]))


# From beyond the stroke a power is one of a spring that only stiffens inwards. Of an odd number of
# places one is the middle, about which a held body is most often alike on both sides.
# The elastic force of a rounded tip (Hertz 1882), or of a body that is a cone or a rod.
SPRING_POWER = Shape("power", "1", 0.9, 2.6, 1.5, points=3)
CENTRE = Shape("centre", "{x}", -2.0, 2.0, 0.0, relative_to="place", points=9)
EFFECTS = (
    Effect(
        name="nonlinear_stiffening",
        law="power",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffening", "{f}/{x}^power", nonnegative=True),
        shapes=(Shape("power", "1", 1.4, 6.0, 2.5, points=7),),
        step=_power,
        sentence="The material stiffens with depth, with the power {power}.",
        compensation="render",
    ),
    Effect(
        name="nonlinear_stiffening",
        law="softening tangent",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness", "{f}/{x}^power", nonnegative=True),
        shapes=(Shape("power", "1", 0.25, 0.85, 0.5, points=3),),
        step=_power,
        sentence="The material's tangent falls with depth, with the power {power}.",
        compensation="render",
    ),
    Effect(
        name="nonlinear_stiffening",
        law="levelling off",  # a foam whose cells buckle
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness", "{f}/{x}", nonnegative=True),
        shapes=(
            Shape("length", "{x}", 0.1, 2.0, 0.5, logarithmic=True, relative_to="travel", points=6),
            Shape("sharpness", "1", 1.2, 10.0, 3.0, logarithmic=True, points=2, ideal="upper"),
        ),
        step=_levelling,
        sentence="A stiffness of {stiffness} levels off beyond {length}.",
        compensation="render",
    ),
    Effect(
        name="nonlinear_stiffening",
        law="exponential",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffening", "{f}", nonnegative=True),
        shapes=(
            Shape(
                "length", "{x}", 0.05, 2.0, 0.4, logarithmic=True, relative_to="travel", points=5
            ),
        ),
        step=_exponential,
        sentence="The material stiffens with depth, by e every {length}.",
        compensation="render",
    ),
    Effect(
        name="nonlinear_stiffening",
        law=WITHOUT_CONTACT,
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("cubic_stiffness", "{f}/{x}^3"),
        shapes=(CENTRE,),
        step=_cubic,
        sentence="The stiffness changes by {cubic_stiffness} about {centre}.",
        compensation="render",
        only_in_contact=False,
    ),
    Effect(
        name="nonlinear_stiffening",
        law=f"{WITHOUT_CONTACT}, power",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffening", "{f}/{x}^power"),
        shapes=(CENTRE, Shape("power", "1", 1.3, 6.0, 3.0, points=4)),
        step=_odd_power,
        sentence="The stiffness changes about {centre}, with the power {power}.",
        compensation="render",
        only_in_contact=False,
        extends=WITHOUT_CONTACT,
    ),
    Effect(
        name="preload",  # a plunger on its collar, a spring that is hooked in under tension
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("preload", "{f}", nonnegative=True),
        # Within more it is a body that levels off.
        shapes=(
            Shape(
                "within",
                "{x}",
                1e-4,
                0.03,
                3e-3,
                logarithmic=True,
                relative_to="travel",
                points=4,
                ideal="lower",
            ),
        ),
        step=_at_once,
        sentence="The body is preloaded: within {within} of its surface it pushes with {preload}.",
        compensation="render",
    ),
)
