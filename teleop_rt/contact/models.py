"""The contact models of the report's chapter 2: each a tuple of effects with named parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from teleop_rt.contact.base_effects import (
    DAMPING,
    FREE_DAMPING,
    FREE_INERTIA,
    INERTIA,
    POWER_DAMPING,
    POWER_STIFFNESS,
    STIFFNESS,
    UNILATERAL_DAMPING,
)
from teleop_rt.contact.effect import Effect
from teleop_rt.contact.law import damped_velocity, linear_force, power_force, touches

ModelName = Literal[
    "mass",
    "mass-damper",
    "kelvin-voigt",
    "kelvin-voigt-unilateral",
    "mass-spring-damper",
    "hunt-crossley",
]


@dataclass(frozen=True, slots=True)
class DeclaredParameter:
    """A parameter of a model; the unit is written with {x} and {f} for the rig's units."""

    name: str
    unit: str


@dataclass(frozen=True, slots=True)
class ContactModel:
    """One contact model: `order` is that of its highest derivative, `equation` the report's."""

    name: ModelName
    equation: str
    effects: tuple[Effect, ...]
    order: int
    in_contact_only: bool = True
    extra: tuple[DeclaredParameter, ...] = ()

    @property
    def parameters(self) -> tuple[DeclaredParameter, ...]:
        """The parameters in the order of the regression vector, in rig units."""
        named = tuple(DeclaredParameter(e.amplitude.name, e.amplitude.unit) for e in self.effects)
        return named + self.extra

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def linear(self) -> bool:
        """Whether the force is linear in the parameters."""
        return not self.extra


MODELS: dict[str, ContactModel] = {
    model.name: model
    for model in (
        ContactModel("mass", "3.15", (FREE_INERTIA,), order=2, in_contact_only=False),
        ContactModel(
            "mass-damper", "-", (FREE_INERTIA, FREE_DAMPING), order=2, in_contact_only=False
        ),
        ContactModel("kelvin-voigt", "2.1", (STIFFNESS, DAMPING), order=1),
        ContactModel("kelvin-voigt-unilateral", "2.2", (STIFFNESS, UNILATERAL_DAMPING), order=1),
        ContactModel("mass-spring-damper", "2.3", (INERTIA, STIFFNESS, DAMPING), order=2),
        ContactModel(
            "hunt-crossley",
            "2.4",
            (POWER_STIFFNESS, POWER_DAMPING),
            order=1,
            extra=(DeclaredParameter("n", "1"),),
        ),
    )
}


def contact_force(
    model: str, parameters: Mapping[str, float], x: float, v: float, a: float = 0.0
) -> float:
    """Return the force of a model at penetration x, velocity v, acceleration a (2.1 to 2.4).

    Rig units; > 0 when the tool presses on the environment. Contact models give 0 for x <= 0, and
    Hunt-Crossley never pulls. Raises KeyError for an unknown model or a missing parameter.
    """
    declared = MODELS[model]
    if declared.in_contact_only and not touches(x):
        return 0.0
    m, k, b = (parameters[name] if name in declared.names else 0.0 for name in "mkb")
    damped = damped_velocity(v, one_way=model == "kelvin-voigt-unilateral")
    if declared.linear:
        return m * a + linear_force(x, damped, k, b)
    return power_force(x, damped, k, b, parameters["n"])
