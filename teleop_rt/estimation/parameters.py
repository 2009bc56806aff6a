"""From scaled regression parameters to those of the model, with their standard deviations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.models import Parameter
from teleop_rt.estimation import layout
from teleop_rt.estimation import state as index
from teleop_rt.estimation.physical import (
    NONE,
    read_hunt_crossley,
    read_linear,
    write_hunt_crossley,
    write_linear,
)
from teleop_rt.estimation.rows import RowSpec
from teleop_rt.estimation.settings import PipelineSettings, covariance_slot

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]
Write = Callable[[index.StateArray, Vector, Vector], bool]

LAG_MOVES = (("b", "k"), ("m", "b"))
"""Parameters that an error of the force's lag moves, each by which one."""


def scale_of(name: str, length: float, time: float) -> float:
    """Return the factor from a scaled parameter to the rig's unit, for the linear models."""
    return {"k": 1.0 / length, "b": time / length, "m": time * time / length}.get(name, 1.0)


def _scales(row: RowSpec, names: list[str], length: float, time: float) -> Vector:
    """Return the factor of each named parameter of a row: of its model, or of an effect."""
    effects = [row.scale_of_effect(name) for name in names]
    return np.array(
        [
            scale_of(name, length, time) if scale is None else scale
            for name, scale in zip(names, effects, strict=True)
        ]
    )


def _hunt_crossley(theta: Matrix, length: float, time: float) -> Matrix:
    """Return [k, b, n] (samples, 3) of [ln k', b'/k', n] (2.6, x in units of `length`)."""
    log_k = theta[:, 0] - theta[:, 2] * math.log(length)
    k = np.exp(np.clip(log_k, -700.0, 700.0))
    return np.column_stack([k, theta[:, 1] * time / length * k, theta[:, 2]])


def traced(row: RowSpec) -> tuple[Parameter, ...]:
    """Return the parameters that a row's own theta holds, a free offset apart."""
    return row.parameters if row.linear else row.declared.parameters


def physical_over_time(row: RowSpec, theta: Matrix, length: float, time: float) -> Matrix:
    """Return the parameters (samples, parameters) in rig units of scaled theta (samples, ...)."""
    names = [p.name for p in traced(row)]
    own: Matrix = theta[:, : len(names)]
    if not row.linear:
        return _hunt_crossley(own, length, time)
    scaled: Matrix = own * _scales(row, names, length, time)
    return scaled


def _stiffness_place(row: RowSpec) -> int:
    """Return where a row's theta holds what a wrong surface moves, NONE where nothing is moved."""
    names = [p.name for p in row.declared.parameters]
    name = "k" if row.linear else "n"
    return names.index(name) if name in names else NONE


def _with_lag_error(write: Write, names: list[str], deviation_s: float) -> Write:
    """Return `write` whose deviations count that the force's lag is known to no better than this.

    A force that is late by dt reads f - f' dt, and k x - k v dt reduces the damping by k dt: one
    error of all samples, which does not average out. Damping moves mass in the same way.
    """
    places = [(names.index(of), names.index(by)) for of, by in LAG_MOVES if {of, by} <= set(names)]

    def write_with_lag(one: index.StateArray, values: Vector, deviations: Vector) -> bool:
        known = write(one, values, deviations)
        for of, by in places:
            deviations[of] = math.hypot(deviations[of], values[by] * deviation_s)
        return known

    return write_with_lag


def _with_friction_error(write: Write, names: list[str], settings: PipelineSettings) -> Write:
    """Return `write` whose deviations count the friction that may be left in the force.

    It has one sign on the way in and the other on the way out: at the bank's scales of length and
    speed it is a stiffness and a damping that does not average out. Longer ways show them better.
    """
    friction, speed = settings.friction_deviation, settings.length / settings.time
    moved = {"k": friction / settings.length, "b": friction / speed}
    places = [(names.index(name), by) for name, by in moved.items() if name in names]

    def write_with_friction(one: index.StateArray, values: Vector, deviations: Vector) -> bool:
        known = write(one, values, deviations)
        for of, by in places:
            deviations[of] = math.hypot(deviations[of], by)
        return known

    return write_with_friction


class Conversion:
    """Conversion of one row's scaled theta into rig units, with its places computed once.

    `write(one, values, deviations)` writes both, as long as `names`, from the pipeline's record,
    and returns whether the deviations are known; `read(one, values)` writes only the values.
    `companion` is the row beside a Hunt-Crossley one that finds the effects' amplitudes. `places`
    gives row, place and scale of each name that is a scaled entry of a row's theta.
    """

    def __init__(
        self, row: RowSpec, number: int, companion: int, settings: PipelineSettings
    ) -> None:
        forgetting = settings.solver_settings().forgetting
        place, integral = _stiffness_place(row), row.solver == "iec"
        slot, room = (
            covariance_slot(row, forgetting),
            np.zeros((layout.MAX_PARAMETERS, layout.MAX_PARAMETERS)),
        )
        where = (number, slot, place, integral)
        self.write: Write
        self.read: Callable[[index.StateArray, Vector], None]
        self.places: dict[str, tuple[int, int, float]]
        if row.linear:
            self.names = [*(p.name for p in traced(row)), "offset"]
            scales = _scales(row, self.names, settings.length, settings.time)
            self.places = {
                name: (number, place, scales.item(place)) for place, name in enumerate(self.names)
            }
            self.write = lambda one, values, deviations: write_linear(
                one, *where, scales, room, values, deviations
            )
            self.read = lambda one, values: read_linear(one, number, scales, values)
        else:
            self.names = [p.name for p in row.parameters]
            beside = replace(row, solver="rls", regression="direct")
            more = (companion, covariance_slot(beside, forgetting))
            effects = len(self.names) - len(row.declared.parameters)
            amplitudes = np.array((row.scales or [1.0] * effects)[:effects], dtype=np.float64)
            named = zip(self.names[-effects:] if effects else [], amplitudes.tolist(), strict=True)
            self.places = {
                name: (companion, 2 + number, scale) for number, (name, scale) in enumerate(named)
            }
            self.write = lambda one, values, deviations: write_hunt_crossley(
                one, *where, amplitudes, *more, room, values, deviations
            )
            self.read = lambda one, values: read_hunt_crossley(
                one, number, amplitudes, companion, values
            )
        if settings.force_lag_deviation_s > 0.0:
            self.write = _with_lag_error(self.write, self.names, settings.force_lag_deviation_s)
        if settings.friction_deviation > 0.0 and row.linear:
            self.write = _with_friction_error(self.write, self.names, settings)
