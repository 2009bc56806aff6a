"""The force that a model predicts in free run, as columns of its linear parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.diagnosis.model import Model, phases
from teleop_rt.diagnosis.motion import Motion
from teleop_rt.diagnosis.simulate import press_in_series, run_step
from teleop_rt.diagnosis.whiten import Matrix

_STEP = 1e-4
_PASTS_S = (2.0, 0.2, 20.0)
"""Lengths of the pasts whose traces are fitted, the first of them alone for a single arm."""


class Columns(NamedTuple):
    """Prediction = offset + sum of theta_i columns_i."""

    offset: Vector
    columns: list[Vector]

    def sum(self, theta: Vector) -> Vector:
        """Return the prediction at these linear parameters."""
        total = self.offset.copy()
        for value, column in zip(theta, self.columns, strict=True):
            total += value * column
        return total


def columns(model: Model, motion: Motion, zeta: Vector, guess: Vector | None = None) -> Columns:
    """Return offset and columns of the prediction at the nonlinear parameters `zeta`.

    `guess` are linear parameters near the solution: a clamped base, a compliance and a saturation
    are linearised there (without it they are left out).
    """
    return Course.of(model, motion, zeta).columns(guess)


@dataclass(frozen=True)
class Course:
    """What the nonlinear parameters alone make of a motion: the same for any linear ones.

    `base` are the columns of the base as if nothing depended on its force, `added` those of the
    effects that add to it, and `behind` tells which of these do so in the sensor.
    """

    model: Model
    power: float
    parameters: list[tuple[float, Vector]]
    moved: Moved
    base: list[Vector]
    added: list[Vector]
    behind: list[bool]

    @classmethod
    def of(cls, model: Model, motion: Motion, zeta: Vector) -> Course:
        """Return the course of a motion."""
        power, parameters = model.split(zeta)
        pairs = list(zip(model.effects, parameters, strict=True))
        x, v, t = motion.x, motion.v, motion.t
        shift, still = model.shift(zeta), True
        if shift:
            x = x + shift
        for effect, (amplitude, eta) in pairs:
            if effect.acts == "moves_position":
                way, rate = _way(effect, motion, x, v, eta, shift if still else None)
                x, v, still = x + amplitude * way, v + amplitude * rate, False
        lag = sum(amplitude for effect, (amplitude, _) in pairs if effect.acts == "shifts_time")
        added: list[Vector] = []
        behind: list[bool] = []
        for effect, (_, eta) in pairs:
            if effect.acts != "adds_force":
                continue
            elsewhere = effect.stage == "material" and x is not motion.x
            values = _values(effect, motion, (x, v) if elsewhere else None, eta)
            if model.past:
                values += _traces(effect, motion, eta)
            if effect.only_in_contact:
                values = [np.where(x > 0.0, value, 0.0) for value in values]
            if lag and effect.stage != "sensor":
                values = [np.interp(t - lag, t, value) for value in values]
            added += values
            behind += [effect.stage == "sensor"] * len(values)
        moved = _at_surface(motion, x, v, lag)
        base = model.base.columns(moved.x, moved.v, moved.a, power)
        return cls(model, power, parameters, moved, base, added, behind)

    def columns(self, guess: Vector | None) -> Columns:
        """Return offset and columns of the prediction, linearised at the linear parameters."""
        offset, base = self._base_at(guess)
        rows, behind = [*base, *self.added], [False] * len(base) + self.behind
        t, dt = self.moved.t, self.moved.dt
        for effect, (_, eta) in zip(self.model.effects, self.parameters, strict=True):
            if effect.acts == "filters_force":
                offset = run_step(effect, offset, offset, offset, t, dt, eta)
                rows = [
                    row if late else run_step(effect, row, row, row, t, dt, eta)
                    for row, late in zip(rows, behind, strict=True)
                ]
        return _limited(self.model, Columns(offset, rows), self.parameters, guess)

    def _base_at(self, guess: Vector | None) -> tuple[Vector, list[Vector]]:
        """Return offset and columns of the base, as it is behind a compliance if there is one."""
        offset, base = np.zeros_like(self.moved.x), list(self.base)
        if guess is None:
            return offset, base
        if self.model.clamped:
            pulls = Columns(offset, base).sum(guess[: len(base)]) <= 0.0
            base = [np.where(pulls, 0.0, column) for column in base]
        for effect, (amplitude, _) in zip(self.model.effects, self.parameters, strict=True):
            if effect.acts == "deflects" and "k" in _names(self.model):
                offset = _press_through(self.model, self.moved, self.power, amplitude, guess, base)
        return offset, base


def _way(
    effect: Effect, motion: Motion, x: Vector, v: Vector, eta: Vector, shift: float | None
) -> Matrix:
    """Return by how much an effect of unit amplitude moves the position, and its rate.

    `shift` is what x lies beyond the motion's own; None where it differs by more than that.
    """

    def make() -> Matrix:
        way = run_step(effect, x, v, motion.a, motion.t, motion.dt, eta)
        return np.array([way, np.gradient(way, motion.dt)])

    if shift is None:
        return make()
    return motion.remembered((effect.step, "way", shift, eta.tobytes()), make)


class Moved(NamedTuple):
    """The movement that the material sees."""

    x: Vector
    v: Vector
    a: Vector
    t: Vector
    dt: float


def _at_surface(motion: Motion, x: Vector, v: Vector, lag: float) -> Moved:
    """Return the movement, late by the lag of the force's channel.

    The movement is delayed rather than the force, which may jump at a contact between samples.
    """
    a = motion.a
    if lag != 0.0:
        x, v, a = (np.interp(motion.t - lag, motion.t, row) for row in (x, v, a))
    return Moved(x, v, a, motion.t, motion.dt)


def _names(model: Model) -> list[str]:
    return [term.name for term in model.base.terms]


def _values(
    effect: Effect, motion: Motion, moved: tuple[Vector, Vector] | None, eta: Vector
) -> list[Vector]:
    """Return the effect's value, or both its values at phases 0 and pi/2.

    `moved` are penetration and velocity where they are not the motion's own.
    """
    a, t, dt = motion.a, motion.t, motion.dt

    def value(shape: Vector) -> Vector:
        if moved is not None:
            return run_step(effect, *moved, a, t, dt, shape)
        key = (effect.step, effect.state_size, shape.tobytes())
        return motion.remembered(key, lambda: run_step(effect, motion.x, motion.v, a, t, dt, shape))

    if not phases(effect):
        return [value(eta)]
    place = next(j for j, shape in enumerate(effect.shapes) if shape.phase)
    found = []
    for angle in (0.0, np.pi / 2):
        turned = eta.copy()
        turned[place] = angle
        found.append(value(turned))
    return found


def _traces(effect: Effect, motion: Motion, eta: Vector) -> list[Vector]:
    """Return what is left in the effect's memory of pasts that ended as the recording began.

    One row [effect per unit amplitude] of as many samples as the motion for each way in which the
    memory fades. In each past the tool was as deep as it ever is, for a length of its own: of a
    memory that is linear and fades, other pasts leave much the same.
    """

    def trace(length: float) -> Vector:
        before = max(1, round(length / motion.dt))
        still = np.zeros(before + motion.x.size)
        x = still.copy()
        x[:before] = motion.scales["travel"]
        t = motion.dt * np.arange(-before, motion.x.size, dtype=np.float64)
        return run_step(effect, x, still, still, t, motion.dt, eta)[before:]

    return [
        motion.remembered((effect.step, length, eta.tobytes()), partial(trace, length))
        for length in _PASTS_S[: effect.fades]
    ]


def _press_through(
    model: Model,
    moved: Moved,
    power: float,
    compliance: float,
    guess: Vector,
    early: list[Vector],
) -> Vector:
    """Replace the columns of k and b by the derivatives of the force behind the compliance.

    Returns the offset that makes the linearisation exact at the guess.
    """
    x, v, _, _, dt = moved
    names = _names(model)
    n, nb = (power, power) if model.base.has_power else (1.0, 0.0)
    speed = np.maximum(v, 0.0) if model.base.name == "kelvin-voigt-unilateral" else v
    ik, ib = names.index("k"), names.index("b") if "b" in names else -1
    k, b = max(float(guess[ik]), 1e-9), max(float(guess[ib]), 0.0) if ib >= 0 else 0.0

    def press(stiffness: float, damping: float) -> Vector:
        found: Vector = press_in_series(
            x, speed, stiffness, n, damping, nb, compliance, dt, model.clamped
        )
        return found

    force = press(k, b)
    by_k = (press(k * (1 + _STEP), b) - force) / (k * _STEP)
    offset: Vector = force - k * by_k
    early[ik] = by_k
    if ib >= 0:
        step = _STEP * max(b, 1e-3 * k * dt)
        by_b = (press(k, b + step) - force) / step
        early[ib] = by_b
        offset = offset - b * by_b
    return offset


def _limited(
    model: Model, found: Columns, parameters: list[tuple[float, Vector]], guess: Vector | None
) -> Columns:
    """Pass the prediction through a saturation, linearised at the guess."""
    if guess is None:
        return found
    for effect, (_, eta) in zip(model.effects, parameters, strict=True):
        if effect.acts == "limits_force" and effect.amplitude.unity:
            force = found.sum(guess)
            zero = np.zeros_like(force)
            step = 1e-4 * max(float(np.max(np.abs(force))), 1e-12)
            limited, further = (
                run_step(effect, row, zero, zero, zero, 1.0, eta) for row in (force, force + step)
            )
            slope = (further - limited) / step
            found = Columns(
                limited + slope * (found.offset - force),
                [slope * column for column in found.columns],
            )
    return found
