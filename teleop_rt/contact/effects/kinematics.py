"""A surface that lies elsewhere than assumed, and a force that is read late."""

from __future__ import annotations

from teleop_rt.contact.effect import Amplitude, Effect, Vector
from teleop_rt.kernels.jit import kernel


@kernel
def _one(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return 1.0


CONTACT_OFFSET = Effect(
    name="contact_offset",
    family="stiffening",
    belongs_to="environment",
    stage="kinematics",
    amplitude=Amplitude("shift", "{x}", lower=-0.3, upper=0.3, relative_to="travel", points=6),
    step=_one,
    sentence="The surface lies {shift} nearer than assumed.",
    turned="The surface lies {-shift} farther than assumed.",
    compensation="render",
    only_in_contact=False,
    acts="moves_position",
)
CHANNEL_DELAY = Effect(
    name="channel_delay",
    family="delay",
    belongs_to="rig",
    stage="kinematics",
    amplitude=Amplitude("lag", "s", lower=-0.15, upper=0.15, points=8),
    step=_one,
    sentence="The force is recorded {lag} behind the position.",
    turned=(
        "The force is recorded {-lag} ahead of the position, which is late or filtered; a filter of"
        " the position also moves the damping."
    ),
    compensation="shift_time",
    only_in_contact=False,
    acts="shifts_time",
)
