"""The vocabulary of physical effects; a new effect is one new declaration."""

from __future__ import annotations

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import (
    adhesion,
    damage,
    damping,
    disturbance,
    friction,
    hysteresis,
    joints,
    kinematics,
    moving_surface,
    relaxation,
    return_spring,
    ripple,
    second_layer,
    sensor,
    sensor_zero,
    softening,
    stiffening,
    stribeck,
    swinging,
    tool,
)

LIBRARY: tuple[Effect, ...] = (
    kinematics.CONTACT_OFFSET,
    *moving_surface.EFFECTS,
    kinematics.CHANNEL_DELAY,
    *joints.EFFECTS,
    *stiffening.EFFECTS,
    *second_layer.EFFECTS,
    *softening.EFFECTS,
    *damping.EFFECTS,
    *relaxation.EFFECTS,
    *hysteresis.EFFECTS,
    *damage.EFFECTS,
    *adhesion.EFFECTS,
    *friction.EFFECTS,
    *stribeck.EFFECTS,
    *tool.EFFECTS,
    *return_spring.EFFECTS,
    *swinging.EFFECTS,
    *ripple.EFFECTS,
    *sensor_zero.EFFECTS,
    *disturbance.EFFECTS,
    *sensor.EFFECTS,
)
NAMES: tuple[str, ...] = tuple(dict.fromkeys(effect.name for effect in LIBRARY))


def find(name: str, law: str = "") -> Effect:
    """Return the declaration of an effect, its first law by default; KeyError if unknown."""
    for effect in LIBRARY:
        if effect.name == name and law in {"", effect.law}:
            return effect
    raise KeyError(f"no effect {name!r} of law {law!r}; effects: {', '.join(NAMES)}")
