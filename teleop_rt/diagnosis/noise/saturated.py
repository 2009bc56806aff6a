"""The flexible description: a basis for the force that motion and time may cause.

It has no physical names. Its residual is noise; energy in it beyond a named model is structure
that the model lacks.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.models.simulate import first_order
from teleop_rt.diagnosis.noise.whiten import Whitener
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.kernels.jit import kernel

_MEMORIES_S = (0.004, 0.012, 0.04, 0.12, 0.4, 1.2, 4.0)
"""Time constants [s], half a decade apart, from a few samples to the length of a record."""
_DRAWS = 24  # of the noise; they give the mean energy within a few percent
_WEAKEST = 1e-7  # of the strongest direction's energy; a weaker one is a rounding error
_PLAYS = (0.003, 0.01, 0.03, 0.1, 0.3)  # of the travel; half a decade apart


def _play(x: Vector, radius: float) -> Vector:
    lost = np.empty_like(x)
    _advance_play(x, radius, lost)
    return lost


@kernel
def _advance_play(x: Vector, radius: float, out: Vector) -> None:
    state = x[0]
    for i in range(x.size):
        state = min(max(state, x[i] - radius), x[i] + radius)
        out[i] = x[i] - state


def _memory(row: Vector, tau: float, dt: float) -> Vector:
    decay = float(np.exp(-dt / tau))
    return first_order(row, decay, 1.0 - decay, row[0])


def basis(motion: RecordedMotion) -> Matrix:
    """Return rows that span depth, speed, memory, hysteresis, damage, drift and inertia."""
    return motion.made("basis", lambda: _basis(motion))


def _basis(motion: RecordedMotion) -> Matrix:
    travel, speed = motion.scales["travel"], motion.scales["speed"]
    x, v, t = motion.x / travel, motion.v / max(speed, 1e-12), motion.t / motion.t[-1]
    a = motion.a / max(float(np.std(motion.a)), 1e-12)
    c = touches(x).astype(np.float64)
    depth = np.maximum(x, 0.0)
    deepest = np.maximum.accumulate(depth)
    rows = [c * depth**i * v**j for i in range(4) for j in range(4) if i + j <= 4]
    rows += [c * v * np.abs(v), c * depth * v * np.abs(v), c * np.abs(v), c * depth * np.abs(v)]
    rows += [np.maximum(depth - d, 0.0) for d in (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)]
    rows += [np.tanh(v / w) for w in (0.003, 0.01, 0.03, 0.1, 0.3)]
    rows += [c * np.tanh(v / 0.02), depth * np.tanh(v / 0.02), c * deepest, depth * deepest]
    rows += [_memory(depth, tau, motion.dt) * c for tau in _MEMORIES_S]
    rows += [_memory(depth, tau, motion.dt) for tau in (0.01, 0.1, 1.0)]
    rows += [_memory(v, tau, motion.dt) for tau in (0.01, 0.1)]
    rows += [_play(x, radius) for radius in _PLAYS]
    rows += [_play(depth, radius) * depth for radius in (0.01, 0.1)]
    rows += [np.ones_like(x), t, t**2, t**3, c * t, depth * t, depth * t**2, c * v * t]
    rows += [a, c * a, depth * a, v, np.maximum(v, 0.0), x, x * x, np.gradient(a)]
    withdrawing = (v < 0.0).astype(np.float64)
    rows += [w * np.exp(-np.abs(x) / r) for w in (withdrawing, 1.0 - c) for r in (0.02, 0.1)]
    return np.array(rows)


class Flexible:
    """The whitened flexible description; energy in it beyond a model is structure.

    `directions` (values x rank) are an orthonormal basis of it.
    """

    def __init__(self, whitener: Whitener, rows: Matrix) -> None:
        self._whitener = whitener
        whitened = whitener(rows)
        size = np.linalg.norm(whitened, axis=1)
        unit = whitened[size > 0.0] / size[size > 0.0, None]
        values, vectors = np.linalg.eigh(unit @ unit.T)
        keep = values > _WEAKEST * values[-1]
        self.directions: Matrix = unit.T @ (vectors[:, keep] / np.sqrt(values[keep]))

    @cached_property
    def noise(self) -> Matrix:
        """Whitened draws of the noise, with the leakage of red noise beside left-out samples."""
        return self._whitener.draws(_DRAWS)

    @cached_property
    def _noise_inside(self) -> Vector:
        return np.asarray(np.sum((self.noise @ self.directions) ** 2, axis=1))

    @cached_property
    def _taken(self) -> Vector:
        return np.asarray(np.sum(self.directions**2, axis=1))

    def _further(self, own: Matrix) -> Matrix:
        """Return an orthonormal basis (columns) of the part of `own` outside the description."""
        beyond = own - self.directions @ (self.directions.T @ own)
        values, vectors = np.linalg.eigh(beyond.T @ beyond)
        keep = values > _WEAKEST
        return np.asarray(beyond @ (vectors[:, keep] / np.sqrt(values[keep])))

    def energy(self, residuals: Matrix, own: Matrix) -> tuple[Vector, int]:
        """Return the energy of each residual in the description beyond `own`, and its rank."""
        inside = np.sum((residuals @ self.directions) ** 2, axis=1)
        return self._beyond(inside, residuals, own)

    def energy_beside_noise(self, residual: Vector, own: Matrix) -> tuple[float, Vector, int]:
        """Return the energy of the residual beyond `own`, that of each draw of noise, the rank."""
        (inside,), rank = self.energy(residual[None, :], own)
        return float(inside), self._beyond(self._noise_inside, self.noise, own)[0], rank

    def _beyond(self, inside: Vector, rows: Matrix, own: Matrix) -> tuple[Vector, int]:
        """Return energy and rank beyond `own` of rows whose energy `inside` is known.

        The energy is that of the joint span: the description is large and shared by all models.
        """
        further = self._further(own)
        rank = self.directions.shape[1] + further.shape[1] - own.shape[1]
        added, removed = (np.sum((rows @ one) ** 2, axis=1) for one in (further, own))
        return np.maximum(inside + added - removed, 0.0), rank

    def beside(self, residual: Vector, own: Matrix) -> tuple[Vector, Vector]:
        """Return a residual without its energy in the description beyond `own`, and leverages.

        A leverage is the share of a value that description and `own` fit together.
        """
        further = self._further(own)
        left = residual + own @ (own.T @ residual)
        for one in (further, self.directions):
            left -= one @ (one.T @ residual)
        return left, self._taken + np.sum(further**2, axis=1)


def orthonormal(rows: Matrix) -> Matrix:
    """Return an orthonormal basis (columns) of the rows' span, weak directions left out."""
    scaled = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    gram = scaled @ scaled.T
    values, vectors = np.linalg.eigh(gram)
    keep = values > 1e-8 * values[-1]
    found: Matrix = (scaled.T @ vectors[:, keep]) / np.sqrt(values[keep])
    return found
