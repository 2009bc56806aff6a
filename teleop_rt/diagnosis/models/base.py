"""Base models for diagnosis: sums of terms that are linear in their parameters at a given power."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import spring_force, touches
from teleop_rt.errors import ExpectedError

TermFunction = Callable[[Vector, Vector, Vector], Vector]


@dataclass(frozen=True, slots=True)
class BaseTerm:
    """One term of a base model: `function(x, v, a)` times the parameter `name`.

    `in_contact` terms are the material's; of them `uses_power` states that x means x^n.
    """

    name: str
    unit: str
    function: TermFunction
    nonnegative: bool = True
    in_contact: bool = True
    uses_power: bool = False

    @property
    def damps(self) -> bool:
        """Return whether the term is a material's damping."""
        return self.in_contact and self.function in {_speed, _forward, _damping}


@dataclass(frozen=True, slots=True)
class Base:
    """A base model: its terms and, for Hunt-Crossley, the free power n.

    `finds_surface`: the surface is not given, so its place is a parameter of the base.
    """

    name: str
    terms: tuple[BaseTerm, ...]
    finds_surface: bool = False

    @property
    def has_power(self) -> bool:
        """Return whether a power n is estimated as well."""
        return any(term.uses_power for term in self.terms)

    @property
    def has_mass(self) -> bool:
        """Return whether a term asks for the acceleration."""
        return any(term.function is _acceleration for term in self.terms)

    @property
    def moves_mass(self) -> bool:
        """Return whether the tool's own mass is a term, which acts in free air as well."""
        return TERMS["mass"] in self.terms

    @property
    def has_spring(self) -> bool:
        """Return whether a body's stiffness is a term."""
        return any(term.function is _depth for term in self.terms)

    @property
    def bias_place(self) -> int | None:
        """Return the place among the terms of the force that is always there, None without one."""
        places = (i for i, term in enumerate(self.terms) if term.function is _constant)
        return next(places, None)

    @property
    def has_bias(self) -> bool:
        """Return whether a force that is always there is a term."""
        return self.bias_place is not None

    @property
    def touches(self) -> bool:
        """Return whether the model is one of contact, not of a drive in free motion."""
        return any(term.in_contact for term in self.terms)

    def columns(self, x: Vector, v: Vector, a: Vector, power: float) -> list[Vector]:
        """Return one column per term; contact terms are zero outside of contact."""
        contact = touches(x)
        depth = np.maximum(x, 0.0)
        raised = depth
        if self.has_power:  # in contact alone: powers of 0 are slow
            raised = np.zeros_like(depth)
            raised[contact] = spring_force(depth[contact], 1.0, power)
        found = []
        for term in self.terms:
            if not term.in_contact:
                found.append(term.function(x, v, a))
                continue
            column = term.function(raised if term.uses_power else depth, v, a)
            found.append(np.where(contact, column, 0.0))
        return found


def _depth(x: Vector, v: Vector, a: Vector) -> Vector:  # noqa: ARG001 - one signature
    return x


def _speed(x: Vector, v: Vector, a: Vector) -> Vector:  # noqa: ARG001 - one signature
    return v


def _forward(x: Vector, v: Vector, a: Vector) -> Vector:  # noqa: ARG001 - one signature
    return np.maximum(v, 0.0)


def _acceleration(x: Vector, v: Vector, a: Vector) -> Vector:  # noqa: ARG001 - as above
    return a


def _damping(x: Vector, v: Vector, a: Vector) -> Vector:  # noqa: ARG001 - as above
    return x * v


def _constant(x: Vector, v: Vector, a: Vector) -> Vector:  # noqa: ARG001 - as above
    return np.ones_like(x)


TERMS = {
    "stiffness": BaseTerm("k", "{f}/{x}", _depth),
    "damping": BaseTerm("b", "{f} s/{x}", _speed),
    "unilateral-damping": BaseTerm("b", "{f} s/{x}", _forward),
    "contact-mass": BaseTerm("m", "{f} s^2/{x}", _acceleration),
    "power-stiffness": BaseTerm("k", "{f}/{x}^n", _depth, uses_power=True),
    "power-damping": BaseTerm("b", "{f} s/{x}^(n+1)", _damping, uses_power=True),
    "spring": BaseTerm("k", "{f}/{x}", _depth, nonnegative=False, in_contact=False),
    "mass": BaseTerm("m", "{f} s^2/{x}", _acceleration, in_contact=False),
    "viscous": BaseTerm("c", "{f} s/{x}", _speed, in_contact=False),
    "bias": BaseTerm("f0", "{f}", _constant, nonnegative=False, in_contact=False),
}

MODELS: dict[str, tuple[str, ...]] = {
    "mass": ("mass",),
    "mass-damper": ("mass", "viscous", "bias"),
    "kelvin-voigt": ("stiffness", "damping"),
    "kelvin-voigt-unilateral": ("stiffness", "unilateral-damping"),
    "mass-spring-damper": ("contact-mass", "stiffness", "damping"),
    "hunt-crossley": ("power-stiffness", "power-damping"),
}


def base_of(description: str) -> Base:
    """Return the base model of an id, or of terms joined by commas ("none" for no term at all).

    Raises ExpectedError that lists the known names.
    """
    if description == "none":
        return Base("none", ())
    names = MODELS.get(description, tuple(part.strip() for part in description.split(",")))
    unknown = [name for name in names if name not in TERMS]
    if unknown:
        near = get_close_matches(unknown[0], [*MODELS, *TERMS], n=1)
        hint = f"did you mean {near[0]!r}? There are" if near else "take one of"
        raise ExpectedError(
            f"unknown base {', '.join(unknown)!r}: {hint} {', '.join(MODELS)}, or terms"
            f" joined by commas: {', '.join(TERMS)}"
        )
    terms = tuple(TERMS[name] for name in names)
    for term in terms:
        if sum(term.name == other.name for other in terms) > 1:
            raise ExpectedError(
                f"base {description!r}: more than one of its terms has the parameter {term.name}:"
                " no data separate them by name; leave all but one out"
            )
    return Base(description, terms)
