"""The states of a model along a motion, which depend on its nonlinear parameters alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Effect, Matrix, Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.models.model import CandidateModel, phases
from teleop_rt.diagnosis.models.simulate import late, over_steps, rate_of, run_step
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.recordings.filters import running_rank

_SPIKE = 5  # samples; the spike of a closing play is narrower
_AT_REST = inf  # duration [s] of a past in which the tool held the body still elsewhere
_PASTS_S = (2.0, 0.2, 20.0)
"""Durations [s] of the earlier contacts that are fitted; an effect with one arm uses the first."""


class Moved(NamedTuple):
    """The movement of the tool at the material."""

    x: Vector
    v: Vector
    a: Vector
    t: Vector
    dt: float


@dataclass(frozen=True)
class Course:
    """The course that depends on the nonlinear parameters alone, not on the linear ones.

    `felt` is the position of the tool at the material, `a` its acceleration, and `lag` the delay of
    the force [s].
    """

    model: CandidateModel
    motion: RecordedMotion
    power: float
    parameters: list[tuple[float, Vector]]
    felt: Place
    a: Vector
    lag: float

    @classmethod
    def of(cls, model: CandidateModel, motion: RecordedMotion, zeta: Vector) -> Course:
        """Return the course of a motion."""
        power, parameters = model.split(zeta)
        pairs = list(zip(model.effects, parameters, strict=True))
        x, v, a = motion.x, motion.v, motion.a
        shift, still = model.shift(zeta), True
        if shift:
            x = x + shift
        for effect, (amplitude, eta) in pairs:
            if effect.acts == "moves_position":
                way, rate = _way(effect, motion, Place(x, v, shift if still else None), eta)
                x, v, still = x + amplitude * way, v + amplitude * rate, False
                if effect.belongs_to == "rig" and effect.moves_mass and model.base.has_mass:
                    a = a + amplitude * _smooth_part(rate_of(rate, motion.dt))
        lag = sum(amplitude for effect, (amplitude, _) in pairs if effect.acts == "shifts_time")
        felt = Place(x, v, shift if still else None)
        return cls(model, motion, power, parameters, felt, a, lag)

    @cached_property
    def moved(self) -> Moved:
        """The movement, late by the lag of the force's channel.

        The movement is delayed instead of the force, which may jump at a contact between samples.
        The acceleration is delayed only for a base with a mass, which alone uses it.
        """
        x, v, a, motion = self.felt.x, self.felt.v, self.a, self.motion
        if self.lag:
            x, v = late(x, self.lag / motion.dt), late(v, self.lag / motion.dt)
            a = late(a, self.lag / motion.dt) if self.model.base.has_mass else a
        return Moved(x, v, a, motion.t, motion.dt)

    @cached_property
    def base(self) -> Matrix:
        """The columns of the base, as if nothing depended on its force."""

        def make() -> Matrix:
            rows = self.model.base.columns(self.moved.x, self.moved.v, self.moved.a, self.power)
            return np.array(rows).reshape(len(rows), self.moved.x.size)

        if self.felt.shift is None or self.lag:
            return make()
        return self.motion.remembered((self.model.base, self.power, self.felt.shift), make)

    @cached_property
    def added(self) -> list[Vector]:
        """The columns of the effects that add to the force."""
        return [row for rows, _ in self._additive for row in rows]

    @cached_property
    def behind(self) -> list[bool]:
        """Which of the added columns act in the sensor."""
        return [sensed for rows, sensed in self._additive for _ in rows]

    @cached_property
    def cut(self) -> NDArray[np.bool_]:
        """Which of the added columns a clamp cuts with the base's."""
        return self._columns_of(self.model.cut)

    @cached_property
    def carried(self) -> NDArray[np.bool_]:
        """Which of the added columns act behind a joint."""
        return self._columns_of(self.model.carried)

    def _columns_of(self, chosen: tuple[bool, ...]) -> NDArray[np.bool_]:
        """Return which of the added columns belong to the chosen of the model's effects."""
        adding = [one for e, one in zip(self.model.effects, chosen, strict=True)
                  if e.acts == "adds_force"]  # fmt: skip
        rows = zip(adding, self._additive, strict=True)
        return np.array([one for one, (values, _) in rows for _ in values], dtype=bool)

    def carried_rows(self, tool: Place) -> list[Vector]:
        """Return the columns of the effects behind a joint, at the tool's place in the body."""
        found = []
        for effect, one, (_, eta) in zip(
            self.model.effects, self.model.carried, self.parameters, strict=True
        ):
            if one:
                found += self._rows(effect, tool, eta)
        return found

    def _rows(self, effect: Effect, place: Place, eta: Vector) -> list[Vector]:
        """Return the columns of an effect that adds a force, at a place, with those of its past."""
        model, motion = self.model, self.motion
        values = _values(effect, motion, place, eta)
        if model.past == "contacts":
            values += _traces(effect, motion, eta)
        elif model.past == "rest" and effect.fades:
            values = [value - _first_press(effect, motion, place, eta) for value in values]
        if effect.only_in_contact:
            values = [np.where(touches(place.x), value, 0.0) for value in values]
        return values

    @cached_property
    def _additive(self) -> list[tuple[list[Vector], bool]]:
        motion, felt, lag = self.motion, self.felt, self.lag
        own = Place(motion.x, motion.v, 0.0)
        found = []
        for effect, (_, eta) in zip(self.model.effects, self.parameters, strict=True):
            if effect.acts != "adds_force":
                continue
            at_body = effect.stage == "material" or effect.only_in_contact
            values = self._rows(effect, felt if at_body else own, eta)
            if lag and effect.stage != "sensor":
                values = [late(value, lag / motion.dt) for value in values]
            found.append((values, effect.stage == "sensor"))
        return found


class Place(NamedTuple):
    """Penetration and velocity; `shift` is their offset to the motion, None if not constant."""

    x: Vector
    v: Vector
    shift: float | None


def _run(effect: Effect, motion: RecordedMotion, place: Place, eta: Vector) -> Vector:
    """Return the effect's value at every sample."""

    def make() -> Vector:
        v = _advance(motion, place.v) if effect.state_size else place.v
        return run_step(effect, place.x, v, motion.a, motion.t, motion.dt, eta)

    if place.shift is None:
        return make()
    key = (effect.step, effect.state_size, place.shift, eta.tobytes())
    return motion.remembered(key, make)


def _advance(motion: RecordedMotion, v: Vector) -> Vector:
    """Return the velocity by which a memory advances to each sample: 0 at rest."""
    midway = over_steps(v)
    return midway if motion.moves is None else motion.moves * midway


def _way(
    effect: Effect, motion: RecordedMotion, place: Place, eta: Vector
) -> tuple[Vector, Vector]:
    """Return the shift of the position by an effect of unit amplitude, and its rate."""
    way = _run(effect, motion, place, eta)
    if place.shift is None:
        return way, rate_of(way, motion.dt)
    key = (effect.step, "rate", place.shift, eta.tobytes())
    return way, motion.remembered(key, lambda: rate_of(way, motion.dt))


def _smooth_part(rate: Vector) -> Vector:
    """Return a rate of change without the spikes at which a play closes.

    The tip's mass rests in the gap and moves with the tool beyond it. In between is an impact; the
    samples do not show its duration.
    """
    return running_rank(rate, _SPIKE, 0.5)


def _values(effect: Effect, motion: RecordedMotion, place: Place, eta: Vector) -> list[Vector]:
    """Return the effect's value, or both its values at phases 0 and pi/2."""
    if not phases(effect):
        return [_run(effect, motion, place, eta)]
    turned = next(j for j, shape in enumerate(effect.shapes) if shape.phase)
    found = []
    for angle in (0.0, np.pi / 2):
        eta = eta.copy()
        eta[turned] = angle
        found.append(_run(effect, motion, place, eta))
    return found


def _first_press(effect: Effect, motion: RecordedMotion, place: Place, eta: Vector) -> Vector:
    """Return the effect's response to the press with which its law begins, held all along.

    Of a linear memory it is all that distinguishes a tool that had rested there.
    """

    def make() -> Vector:
        still = np.zeros_like(place.x)
        held = np.full_like(place.x, place.x[0])
        return run_step(effect, held, still, still, motion.t, motion.dt, eta)

    if place.shift is None:
        return make()
    return motion.remembered((effect.step, "press", place.shift, eta.tobytes()), make)


def _traces(effect: Effect, motion: RecordedMotion, eta: Vector) -> list[Vector]:
    """Return the effect's response to earlier contacts that end as the recording begins.

    One row (samples,) [effect per unit amplitude] for each fading mode of the memory. In each
    earlier contact the tool was at its largest depth, for another duration; the response of a
    linear fading memory to other pasts is similar. A body that is held all along may have been at
    rest elsewhere until then.
    """

    def trace(length: float) -> Vector:
        # A memory begins at rest where its first sample is.
        first, held = (0, 1) if length == _AT_REST else (1, max(1, round(length / motion.dt)))
        before = first + held
        still = np.zeros(before + motion.x.size)
        x = still.copy()
        x[first:before] = motion.scales["travel"]
        t = motion.dt * np.arange(-before, motion.x.size, dtype=np.float64)
        return run_step(effect, x, still, still, t, motion.dt, eta)[before:]

    pasts = _PASTS_S[: effect.fades]
    if effect.fades and effect.without_contact:
        pasts = (_AT_REST, *pasts[:-1])
    return [
        motion.remembered((effect.step, length, eta.tobytes()), partial(trace, length))
        for length in pasts
    ]
