"""Joints between encoder and body: compliance in series, which may seat, and play."""

from __future__ import annotations

from dataclasses import replace

from teleop_rt.contact.effect import (
    WITHOUT_CONTACT,
    Amplitude,
    Effect,
    Shape,
    StepFunction,
    Vector,
)
from teleop_rt.contact.effects.sensor import FIRST_ORDER_LAG
from teleop_rt.contact.effects.stiffening import CENTRE
from teleop_rt.contact.law import force_behind_joint, joint_deflection
from teleop_rt.kernels.jit import kernel


@kernel
def _force(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return x


@kernel
def _seating(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return joint_deflection(x, 1.0, eta[0])


@kernel
def _drag(state: Vector, x: float, behind: float, ahead: float) -> float:
    """Return the tip less the encoder's x, dragged within [-behind, ahead] of it [rig unit].

    state: where the tip is, whether it was placed.
    """
    if state[1] == 0.0:
        state[1] = 1.0
        state[0] = x
    state[0] = min(max(state[0], x - behind), x + ahead)
    return float(state[0] - x)


@kernel
def _play_centred(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Move the tip with the encoder ± half a gap."""
    return _drag(state, x, 0.5 * eta[0], 0.5 * eta[0])


@kernel
def _play_from_loading_flank(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Move the tip with the encoder when pressing, a gap behind it when withdrawing."""
    return _drag(state, x, 0.0, eta[0])


@kernel
def _play_from_unloading_flank(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Move the tip with the encoder when withdrawing, a gap behind it when pressing."""
    return _drag(state, x, eta[0], 0.0)


@kernel
def _slack_about_rest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Leave the tip at its rest eta[0] until the encoder is half a gap from it."""
    half = 0.5 * eta[1]
    return float(-min(max(x - eta[0], -half), half))


@kernel
def _behind_seating_joint(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return the force behind a joint, of which a rigid one would press the force x."""
    return force_behind_joint(x, eta[0], eta[1])


@kernel
def _slack_at_no_force(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return the force x of a tip without play, less the one that half of it would press."""
    return float(x - min(max(x, -eta[0]), eta[0]))


_UNITY = Amplitude("scale", "1", unity=True)
BEFORE_A_SPRING = f"{WITHOUT_CONTACT}, before the spring"  # law of a play that no damper passes
BEYOND_THE_MASS = "beyond the tool's mass"  # law of a play between the tool and its tip


def _play(law: str, step: StepFunction) -> Effect:
    """Declare a play by the flank on which the surface was given."""
    return Effect(
        name="backlash",
        law=law,
        family="lost motion",
        belongs_to="rig",
        stage="kinematics",
        amplitude=_UNITY,
        shapes=(
            Shape("gap", "{x}", 1e-3, 0.4, 0.02, logarithmic=True, relative_to="travel", points=10),
        ),
        step=step,
        sentence="A play of {gap} lies between encoder and tip.",
        compensation="correct_position",
        state_size=2,
        only_in_contact=False,
        acts="moves_position",
    )


_PLAY = _play("centred", _play_centred)
_JOINT = Effect(
    name="series_compliance",
    family="stiffening",
    belongs_to="rig",
    stage="kinematics",
    amplitude=Amplitude(
        "compliance",
        "{x}/{f}",
        nonnegative=True,
        lower=1e-3,
        upper=0.8,
        relative_to="compliance",
        points=8,
    ),
    step=_force,
    sentence="{compliance} of the rig lies in series between encoder and tip.",
    compensation="correct_position",
    only_in_contact=False,
    acts="deflects",
)
_SEATING = Shape(
    "seating_force",
    "{f}",
    0.02,
    5.0,
    0.3,
    logarithmic=True,
    relative_to="force",
    points=2,
    ideal="upper",
)
# A spring and a damper behind another spring are softer ones whose force is late: one force, two
# names. Held bodies show no other sign of the joint.
_JOINT_OF_A_HELD_BODY = replace(
    FIRST_ORDER_LAG,
    name="series_compliance",
    law=WITHOUT_CONTACT,
    family="stiffening",
    stage="kinematics",
    sentence="A joint in series with the body gives way: its force is late, as at {bandwidth}.",
)
EFFECTS = (
    _JOINT,
    replace(
        _JOINT,
        law="seating joint",
        amplitude=replace(_JOINT.amplitude, upper=4.0, points=5),
        shapes=(_SEATING,),
        step=_seating,
        sentence="{compliance} of the rig lies in series between encoder and tip; at"
        " {seating_force} the joint has seated and deflects half as far.",
    ),
    _JOINT_OF_A_HELD_BODY,
    replace(
        _JOINT,
        law=f"{WITHOUT_CONTACT}, seating",
        amplitude=_UNITY,
        shapes=(
            Shape("softness", "1", 0.03, 3.0, 0.3, logarithmic=True, points=3),
            replace(_SEATING, points=3, ideal=""),
        ),
        step=_behind_seating_joint,
        sentence="A joint in series gives by {softness} of the body's own way; at {seating_force}"
        " it has seated and gives half of that.",
        acts="slackens",
        compensation="none",
    ),
    _PLAY,
    _play("from the loading flank", _play_from_loading_flank),
    _play("from the unloading flank", _play_from_unloading_flank),
    replace(
        _play(BEYOND_THE_MASS, _play_centred),
        sentence="A play of {gap} lies between the tool and its tip.",
        moves_mass=False,
    ),
    replace(
        _PLAY,
        law=f"{WITHOUT_CONTACT}, about the rest",
        shapes=(replace(CENTRE, points=5), *_PLAY.shapes),
        step=_slack_about_rest,
        sentence="A body that is held has a play of {gap} about {centre}.",
        state_size=0,
    ),
    # Here the damping is the drive's own; in the laws above it is the tip's.
    replace(
        _PLAY,
        law=BEFORE_A_SPRING,
        amplitude=Amplitude("spring_stiffness", "{f}/{x}", nonnegative=True),
        sentence="A play of {gap} lies between the drive and a spring of {spring_stiffness}.",
        acts="adds_force",
        compensation="subtract_force",
    ),
    # Where a friction lies beyond the play, the play opens at no force, not at one place.
    replace(
        _PLAY,
        law=f"{WITHOUT_CONTACT}, at no force",
        shapes=(
            Shape(
                "slack_force",
                "{f}",
                2e-3,
                0.5,
                0.05,
                logarithmic=True,
                relative_to="force",
                points=8,
            ),
        ),
        step=_slack_at_no_force,
        sentence="A held body has a play at no force; half of it would press {slack_force}.",
        state_size=0,
        acts="slackens",
        compensation="none",
    ),
)
