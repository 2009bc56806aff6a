"""A base model with effects, and the order of their linear and nonlinear parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Amplitude, Effect, Scale, Shape, Vector
from teleop_rt.diagnosis.models.base import Base

POWER = Shape("n", "1", 0.6, 4.0, 1.3, points=1)
SURFACE = Amplitude("surface", "{x}", lower=-1.0, upper=1.0, relative_to="onset")


Past = Literal["none", "rest", "contacts"]
Clamp = Literal["none", "base", "body", "elastic"]
"""The force that contact cuts at zero, because it never pulls.

`base`: that of the base. `body`: that of base and material effects together, because a relaxed body
releases the tool before the base alone would. `elastic`: the same without the base's damping, as of
a body that releases the tool while a fluid still holds it.
"""
JUMPS = ("moves_position", "shifts_time")
"""Actions of effects that move a contact in place or time, where a damper's force jumps."""


class Coordinate(NamedTuple):
    """One nonlinear parameter: index of its effect (-1: the base), and its declaration."""

    owner: int
    shape: Shape | Amplitude


class Linear(NamedTuple):
    """One linear parameter: index of its effect (-1: the base), name, unit, and sign constraint."""

    owner: int
    name: str
    unit: str
    nonnegative: bool


def bounds(shape: Shape | Amplitude, scales: Mapping[Scale, float]) -> tuple[float, float]:
    """Return the bounds of a parameter in the rig's units."""
    return in_units(shape.lower, shape, scales), in_units(shape.upper, shape, scales)


def in_units(value: float, shape: Shape | Amplitude, scales: Mapping[Scale, float]) -> float:
    """Return a declared value of a parameter in the rig's units."""
    if shape.relative_to == "place":
        return scales["place"] + value * scales["travel"]
    if shape.relative_to == "range":
        return scales["middle"] + value * scales["range"]
    return value * scales[shape.relative_to]


def nonlinear_amplitude(effect: Effect) -> bool:
    """Return whether the effect's amplitude enters the prediction nonlinearly."""
    acts = effect.acts in {"moves_position", "deflects", "shifts_time"}
    return acts and not effect.amplitude.unity


def _is_of_the_body(effect: Effect) -> bool:
    """Return whether a body exerts the effect's force on the tool and can release the tool.

    Friction between them is such a force, too: it ends with the contact.
    """
    exerted = effect.stage == "material" or effect.family == "friction"
    in_contact = effect.only_in_contact and effect.acts == "adds_force"
    return exerted and in_contact and effect.family != "adhesion"


def _deforms(effect: Effect) -> bool:
    """Return whether an effect is a force of the body by its own depth."""
    material = effect.stage == "material" and effect.acts == "adds_force"
    return material and effect.family not in {"adhesion", "periodic"}


def phases(effect: Effect) -> bool:
    """Return whether two linear amplitudes at phases 0 and pi/2 represent the effect."""
    return any(s.phase for s in effect.shapes) and effect.acts == "adds_force"


@dataclass(frozen=True)
class CandidateModel:
    """A base and effects, in a fixed order of nonlinear and linear parameters.

    `past` is that of effects with a fading memory: the recording begins with a press ("none"), with
    the tool at rest where it had been all along ("rest"), or after earlier contacts, whose forces
    are estimated as well ("contacts").
    """

    base: Base
    effects: tuple[Effect, ...] = ()
    clamp: Clamp = "none"
    past: Past = "none"

    @cached_property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The nonlinear parameters, in the order of `zeta`."""
        found = [Coordinate(-1, POWER)] if self.base.has_power else []
        found += [Coordinate(-1, SURFACE)] if self.base.finds_surface else []
        for i, effect in enumerate(self.effects):
            if nonlinear_amplitude(effect):
                found.append(Coordinate(i, effect.amplitude))
            found += [Coordinate(i, s) for s in effect.shapes if not (s.phase and phases(effect))]
        return tuple(found)

    @cached_property
    def linear(self) -> tuple[Linear, ...]:
        """The linear parameters, in the order of the columns."""
        found = [Linear(-1, t.name, t.unit, t.nonnegative) for t in self.base.terms]
        for i, effect in enumerate(self.effects):
            amplitude = effect.amplitude
            if effect.acts != "adds_force":
                continue
            if phases(effect):
                found += [
                    Linear(i, f"{amplitude.name}_{p}", amplitude.unit, nonnegative=False)
                    for p in "sc"
                ]
            else:
                found.append(Linear(i, amplitude.name, amplitude.unit, amplitude.nonnegative))
            if self.past == "contacts":
                found += [
                    Linear(i, f"before_{j + 1}", "{f}", nonnegative=False)
                    for j in range(effect.fades)
                ]
        return tuple(found)

    @cached_property
    def nonnegative(self) -> NDArray[np.bool_]:
        """Which linear parameters may not be negative, in the order of the columns."""
        return np.array([linear.nonnegative for linear in self.linear], dtype=bool)

    @property
    def passes(self) -> int:
        """Number of successive linear fits, more than 1 if the columns depend on the parameters."""
        if any(effect.acts == "deflects" for effect in self.effects):
            return 6
        limits = any(effect.acts in {"slackens", "limits_force"} for effect in self.effects)
        return 3 if limits or self.clamp != "none" else 1

    @property
    def clamps(self) -> tuple[Clamp, ...]:
        """The distinct clamps of this model."""
        if not self.base.touches:
            return ("none",)
        if not any(self._of_the_body):
            return ("none", "base")
        return ("none", "base", "body", "elastic")

    @property
    def cut(self) -> tuple[bool, ...]:
        """Which effects a clamp cuts together with the base."""
        whole = self.clamp in {"body", "elastic"}
        return self._of_the_body if whole else (False,) * len(self.effects)

    @cached_property
    def cut_terms(self) -> NDArray[np.bool_]:
        """Which terms of the base a clamp cuts: those of the body, no bias of the sensor."""
        damping = self.clamp == "elastic"
        cut = [term.in_contact and not (damping and term.damps) for term in self.base.terms]
        return np.array(cut, dtype=bool)

    @cached_property
    def _of_the_body(self) -> tuple[bool, ...]:
        stiff = not any(effect.acts == "deflects" for effect in self.effects)
        return tuple(stiff and _is_of_the_body(effect) for effect in self.effects)

    @cached_property
    def carried(self) -> tuple[bool, ...]:
        """Which effects a joint carries with the base: those of the body, which give way with it.

        Adhesion lets go of the tool, and is evaluated at the depth of the drive.
        """
        springy = any(term.name == "k" for term in self.base.terms)
        jointed = springy and any(effect.acts == "deflects" for effect in self.effects)
        return tuple(jointed and _deforms(effect) for effect in self.effects)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.coordinates) + len(self.linear)

    def moves_contact(self, coordinate: Coordinate) -> bool:
        """Return whether a nonlinear parameter moves a contact in place or time.

        A damper's force jumps there, and so does chi-square, sample by sample.
        """
        if coordinate.owner < 0:
            return coordinate.shape is SURFACE
        return self.effects[coordinate.owner].acts in JUMPS

    def shift(self, zeta: Vector) -> float:
        """Return the distance by which the surface is nearer than the motion assumes."""
        return float(zeta[int(self.base.has_power)]) if self.base.finds_surface else 0.0

    def shifted(self, zeta: Vector, shift: float) -> Vector:
        """Return the nonlinear parameters with the estimated surface nearer by a shift."""
        zeta = zeta.copy()
        zeta[int(self.base.has_power)] = shift
        return zeta

    def split(self, zeta: Vector) -> tuple[float, list[tuple[float, Vector]]]:
        """Return the base's power and, for each effect, its amplitude (or 1) and its eta."""
        power = float(zeta[0]) if self.base.has_power else 1.0
        position = int(self.base.has_power) + int(self.base.finds_surface)
        found: list[tuple[float, Vector]] = []
        for effect in self.effects:
            amplitude = 1.0
            if nonlinear_amplitude(effect):
                amplitude = float(zeta[position])
                position += 1
            eta = np.zeros(max(1, len(effect.shapes)))
            for j, shape in enumerate(effect.shapes):
                if shape.phase and phases(effect):
                    continue
                eta[j] = zeta[position]
                position += 1
            found.append((amplitude, eta))
        return power, found
