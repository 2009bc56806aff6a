"""Effects of the force sensor's zero: a bias, and drifts of it."""

from __future__ import annotations

from math import exp, log1p

from teleop_rt.contact.effect import Amplitude, Effect, Shape, Vector
from teleop_rt.kernels.jit import kernel


@kernel
def _one(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return 1.0


@kernel
def _creeping(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return 1.0 - exp(-t / eta[0])


@kernel
def _power_of_time(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(t ** eta[0])


@kernel
def _logarithm_of_time(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return log1p(t / eta[0])


EFFECTS = (
    Effect(
        name="force_bias",
        family="bias",
        belongs_to="rig",
        stage="sensor",
        amplitude=Amplitude("bias", "{f}"),
        step=_one,
        sentence="The force sensor reads {bias} where the force is zero.",
        compensation="subtract_force",
        only_in_contact=False,
    ),
    Effect(
        name="force_drift",
        law="exponential",
        family="drift",
        belongs_to="rig",
        stage="sensor",
        amplitude=Amplitude("drift", "{f}"),
        shapes=(
            Shape(
                "time_constant",
                "s",
                0.03,
                5.0,
                0.5,
                logarithmic=True,
                relative_to="duration",
                points=8,
            ),
        ),
        step=_creeping,
        sentence="The force sensor drifts by {drift} with the time constant {time_constant}.",
        compensation="subtract_force",
        only_in_contact=False,
    ),
    Effect(
        name="force_drift",
        law="power of time",
        family="drift",
        belongs_to="rig",
        stage="sensor",
        amplitude=Amplitude("drift", "{f}/s^power"),
        shapes=(Shape("power", "1", 0.3, 3.0, 1.0, logarithmic=True, points=5),),
        step=_power_of_time,
        sentence="The force sensor drifts by {drift}, with the power {power} of time.",
        compensation="subtract_force",
        only_in_contact=False,
    ),
    Effect(
        name="force_drift",
        law="logarithm of time",
        family="drift",
        belongs_to="rig",
        stage="sensor",
        amplitude=Amplitude("drift", "{f}"),
        shapes=(
            Shape(
                "time_constant",
                "s",
                3e-3,
                1.0,
                0.1,
                logarithmic=True,
                relative_to="duration",
                points=4,
            ),
        ),
        step=_logarithm_of_time,
        sentence="The force sensor creeps: {drift} for each e-fold of time past {time_constant}.",
        compensation="subtract_force",
        only_in_contact=False,
    ),
)
