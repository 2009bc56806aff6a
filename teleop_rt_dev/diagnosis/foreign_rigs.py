"""The rigs of the second generator: a movement, a bare material, and places for effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from teleop_rt_dev.diagnosis.foreign_laws import hunt_crossley_behind
from teleop_rt_dev.diagnosis.foreign_motions import RATE_HZ, Array, movement

H = 1.0 / RATE_HZ
MARGIN_S = 0.5
_PASSES = 8  # of force and depth behind a soft tool; each leaves a third of the error, or less
Operation = Callable[[Array, float], Array]


@dataclass
class Rig:
    """The movement and the bare material; operations are added to its five places."""

    rng: np.random.Generator
    t: Array
    x: Array
    base: str
    k: float
    b: float
    n: float
    m: float
    moves: list[tuple[Operation, float]] = field(default_factory=list)
    material: list[tuple[Operation, float]] = field(default_factory=list)
    tool: list[tuple[Operation, float]] = field(default_factory=list)
    channel: list[tuple[Operation, float]] = field(default_factory=list)
    soft: float = 0.0

    @property
    def depth(self) -> float:
        """The deepest penetration."""
        return float(np.max(self.x))

    def force(self) -> Array:
        """Return the force that the channel gives, at 10 kHz, without noise."""
        tip = self.x.copy()
        for operation, gain in self.moves:
            tip = operation(tip, gain)
        force = self._body(tip)
        for operation, gain in self.tool:
            force = force + operation(self.x, gain)
        for operation, gain in self.channel:
            force = operation(force, gain)
        return force

    def _body(self, tip: Array) -> Array:
        """Return the force of the material with its effects, which a soft tool gives way to."""
        more = np.zeros_like(tip)
        for _ in range(_PASSES if self.soft > 0.0 and self.material else 1):
            bare = self._bare(tip - self.soft * more)
            place = tip - self.soft * (bare + more)
            more = np.zeros_like(tip)
            for operation, gain in self.material:
                more = more + np.where(place > 0.0, operation(place, gain), 0.0)
        return bare + more

    def _bare(self, tip: Array) -> Array:
        if self.soft > 0.0:
            power = self.n if self.base == "hunt-crossley" else 0.0
            return np.asarray(hunt_crossley_behind(tip, self.k, self.b, power, 1.0 / self.soft))
        depth, v = np.maximum(tip, 0.0), np.gradient(tip, H)
        if self.base == "hunt-crossley":
            return np.asarray(np.maximum(depth**self.n * (self.k + self.b * v), 0.0))
        force = self.k * depth + self.b * v
        if self.base == "mass-spring-damper":
            force = force + self.m * np.gradient(v, H)
        return np.where(tip > 0.0, force, 0.0)


def rig(rng: np.random.Generator, base: str, kind: str, seconds: float, air: float) -> Rig:
    """Return a rig on a random material: foam of 300 N/m to a wall of 40 kN/m."""
    stiffness = float(np.exp(rng.uniform(np.log(300.0), np.log(40_000.0))))
    depth = float(np.clip(rng.uniform(5.0, 40.0) / stiffness, 8e-4, 0.04))
    t, x = movement(rng, kind, depth, seconds, air)
    speed = float(np.quantile(np.abs(np.gradient(x, H)), 0.95))
    damping = rng.uniform(0.03, 0.4) * stiffness * depth / speed
    n = rng.uniform(1.15, 2.1) if base == "hunt-crossley" else 1.0
    inertia = float(np.quantile(np.abs(np.gradient(np.gradient(x, H), H)), 0.95))
    mass = rng.uniform(0.03, 0.2) * stiffness * depth / inertia
    k, b = stiffness * depth ** (1.0 - n), damping / (depth**n if n > 1.0 else 1.0)
    return Rig(rng, t, x, base, k, b, n, mass)


def as_lever(r: Rig) -> None:
    """Turn the stroke into an angle: 1 rad deep, with the same force."""
    d, r.x = r.depth, r.x / r.depth
    r.k *= d**r.n
    r.b *= d ** (r.n if r.base == "hunt-crossley" else 0.0) * d
    r.m *= d


Drawn = Callable[[Rig, int], Operation]
"""Draws an effect for a rig, in the form of this number."""
