"""From scaled regression parameters to those of the model, with their standard deviations."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.models import DeclaredParameter
from teleop_rt.estimation.estimates import Places
from teleop_rt.estimation.physical import NONE
from teleop_rt.estimation.rows import RowSpec
from teleop_rt.estimation.settings import PipelineSettings, covariance_slot

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]


_MOST_LOG = 230.0
"""Logarithm of 1e100, in the rig's units: no body is so stiff, and products stay below 1e308."""


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
    """Return [k, b, n] (samples, 3) of [ln k', b'/k', n] (2.6, x in units of `length`).

    Not-a-number where a nearly singular solution is beyond all bodies: k or b would overflow.
    """
    log_k = theta[:, 0] - theta[:, 2] * math.log(length)
    ratio = theta[:, 1] * time / length
    known = (np.abs(log_k) < _MOST_LOG) & (np.abs(ratio) < math.exp(_MOST_LOG))
    k = np.exp(np.where(known, log_k, np.nan))
    return np.column_stack([k, np.where(known, ratio, np.nan) * k, theta[:, 2]])


def traced(row: RowSpec) -> tuple[DeclaredParameter, ...]:
    """Return the parameters that a row's own theta holds, a free offset apart."""
    return row.parameters if row.linear else row.declared.parameters


def traced_names(row: RowSpec) -> list[str]:
    """Return the names of the parameters that a row's own theta holds."""
    return [p.name for p in traced(row)]


def leading(row: RowSpec) -> str:
    """Return the parameter that represents a row: k, or m of a model without a k."""
    return "k" if "k" in traced_names(row) else "m"


def physical_over_time(row: RowSpec, theta: Matrix, length: float, time: float) -> Matrix:
    """Return the parameters (samples, parameters) in rig units of scaled theta (samples, ...)."""
    names = traced_names(row)
    own: Matrix = theta[:, : len(names)]
    if not row.linear:
        return _hunt_crossley(own, length, time)
    scaled: Matrix = own * _scales(row, names, length, time)
    return scaled


def _stiffness_place(row: RowSpec) -> int:
    """Return the place in a row's theta that a wrong surface changes, NONE if there is none."""
    names = [p.name for p in row.declared.parameters]
    name = "k" if row.linear else "n"
    return names.index(name) if name in names else NONE


class Conversion:
    """Conversion of one row's scaled theta into rig units, with its places computed once.

    `names` are those of the estimate. `entries` gives row, place and scale of each name that is a
    scaled entry of a row's theta. `companion` is the row beside a Hunt-Crossley one that finds the
    effects' amplitudes.
    """

    def __init__(
        self, row: RowSpec, number: int, companion: int, settings: PipelineSettings
    ) -> None:
        self._row, self._settings = row, settings
        self._number, self._companion = number, companion
        self.entries: dict[str, tuple[int, int, float]]
        if row.linear:
            self.names = [*(p.name for p in traced(row)), "offset"]
            self._scales = _scales(row, self.names, settings.length, settings.time)
            scaled = enumerate(zip(self.names, self._scales.tolist(), strict=True))
            self.entries = {name: (number, place, scale) for place, (name, scale) in scaled}
        else:
            self.names = [p.name for p in row.parameters]
            effects = len(self.names) - len(row.declared.parameters)
            self._scales = np.array((row.scales or [1.0] * effects)[:effects], dtype=np.float64)
            beside = enumerate(
                zip(self.names[len(self.names) - effects :], self._scales.tolist(), strict=True)
            )
            self.entries = {name: (companion, 2 + place, scale) for place, (name, scale) in beside}

    def write_places(self, out: Places) -> None:
        """Write where the estimate comes from, and the errors that samples do not average out.

        A force that is late by dt reads f - f' dt, and k x - k v dt reduces the damping by k dt:
        one error of all samples. Damping moves mass in the same way. Friction has one sign on the
        way in and the other on the way out: at the bank's scales of length and speed it is a
        stiffness and a damping. Longer ways show them better.
        """
        row, settings, names = self._row, self._settings, self.names
        forgetting = settings.solver_settings().forgetting
        out.row, out.names, out.linear = self._number, len(names), row.linear
        out.slot, out.place = covariance_slot(row, forgetting), _stiffness_place(row)
        out.integral, out.scaled = row.solver == "iec", len(self._scales)
        out.scales[: len(self._scales)] = self._scales
        out.companion = self._companion
        beside = replace(row, solver="rls", regression="direct")
        out.companion_slot = covariance_slot(beside, forgetting)
        out.k_at, out.b_at, out.m_at = (
            names.index(name) if name in names else NONE for name in "kbm"
        )
        out.lag_s = settings.force_lag_deviation_s
        if row.linear:
            out.friction_k = settings.friction_deviation / settings.length
            out.friction_b = settings.friction_deviation / (settings.length / settings.time)
