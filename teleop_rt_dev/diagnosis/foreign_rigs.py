"""The rigs of the second generator, and what each effect does to one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import bessel, fftconvolve, lfilter

from teleop_rt_dev.diagnosis.foreign_laws import (
    capillary,
    elasto_plastic,
    hunt_crossley_behind,
    jenkin,
    play,
)
from teleop_rt_dev.diagnosis.foreign_motions import RATE_HZ, Array, movement

H = 1.0 / RATE_HZ
MARGIN_S = 0.5
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
        force = self._bare(tip)
        for operation, gain in self.material:
            force = force + np.where(tip > 0.0, operation(tip, gain), 0.0)
        for operation, gain in self.tool:
            force = force + operation(self.x, gain)
        for operation, gain in self.channel:
            force = operation(force, gain)
        return force

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


def _surface(r: Rig, name: str) -> Operation | None:
    rng, u = r.rng, r.t / r.t[-1]
    sign = rng.choice([-1.0, 1.0])
    if name == "contact_offset":
        return lambda x, g: x + sign * g * r.depth
    if name == "moving_surface":
        tone = rng.uniform(0.08, 1.5)
        form = rng.integers(2)
        rows = (u, np.sin(2 * np.pi * tone * r.t + rng.uniform(0, 6.0)))
        return lambda x, g: x - sign * g * r.depth * rows[form]
    if name == "permanent_set":
        free = rng.uniform(0.0, 0.15) * r.depth

        def left(x: Array, g: float) -> Array:
            return x - g * np.maximum(np.maximum.accumulate(x) - free, 0.0)

        return left
    if name == "backlash":
        start = rng.uniform(-1.0, 1.0)
        return lambda x, g: np.asarray(play(x, g * r.depth, start))
    return None


def _material(r: Rig, name: str) -> Operation | None:  # noqa: C901, PLR0911 - one row per effect
    rng, t, d = r.rng, r.t, r.depth
    form = int(rng.integers(4))
    if name == "stress_relaxation":
        arms = 1 + form
        taus = np.sort(np.exp(rng.uniform(np.log(0.02), np.log(3.0), arms)))
        shares = rng.uniform(0.3, 1.0, arms)

        def relax(x: Array, g: float) -> Array:
            rate = np.gradient(np.maximum(x, 0.0), H)
            rows = [
                s * lfilter([H], [1.0, -np.exp(-H / tau)], rate)
                for s, tau in zip(shares, taus, strict=True)
            ]
            return np.asarray(g * r.k * np.sum(rows, axis=0))

        return relax
    if name == "fractional_relaxation":
        order = rng.uniform(0.12, 0.6)
        j = np.arange(1, t.size)
        weights = np.concatenate(([1.0], np.cumprod((j - 1.0 - order) / j)))

        def power_law(x: Array, g: float) -> Array:
            depth = np.maximum(x, 0.0) - max(x[0], 0.0)
            return np.asarray(g * r.k * fftconvolve(depth, weights)[: t.size] / (H**order))

        return power_law
    if name == "nonlinear_stiffening":
        laws: tuple[Callable[[Array], Array], ...] = (
            lambda s: s**3,
            lambda s: np.expm1(3.0 * s) - 3.0 * s,
            lambda s: s / (1.0 - 0.6 * s) - s,
            lambda s: s**2.2,
        )
        return lambda x, g: g * r.k * d * laws[form](np.maximum(x, 0.0) / d)
    if name == "second_layer":
        where, blur = rng.uniform(0.25, 0.75) * d, rng.choice([0.002, 0.02]) * d
        return lambda x, g: g * r.k * blur * np.logaddexp(0.0, (x - where) / blur)
    if name == "hysteresis":
        yields = np.exp(rng.uniform(np.log(0.01), np.log(0.3), 1 + 6 * form)) * d
        grows = form % 2

        def yielding(x: Array, g: float) -> Array:
            row = np.asarray(jenkin(np.maximum(x, 0.0), yields))
            return g * r.k * row * (np.maximum(x, 0.0) / d if grows else 1.0)

        return yielding
    if name == "mullins_softening":
        reach = rng.uniform(0.1, 0.6) * d

        def worn(x: Array, g: float) -> Array:
            depth = np.maximum(x, 0.0)
            below = np.maximum.accumulate(depth) - depth
            return -g * r.k * depth * (1.0 - np.exp(-below / reach))

        return worn
    if name == "softening":
        tau = rng.uniform(0.1, 0.6) * t[-1]
        loss = (t / t[-1], np.log1p(t / tau), 1.0 - 1.0 / (1.0 + t / tau), np.tanh(t / tau))[form]
        sign = rng.choice([-1.0, 1.0])
        return lambda x, g: sign * g * r.k * np.maximum(x, 0.0) * loss
    if name == "quadratic_damping":

        def turbulent(x: Array, g: float) -> Array:
            v = np.gradient(x, H)
            return np.asarray(g * r.k * d * v * np.abs(v) / np.quantile(np.abs(v), 0.95) ** 2)

        return turbulent
    return None


def _tool(r: Rig, name: str) -> Operation | None:  # noqa: PLR0911 - one row per effect
    rng, d = r.rng, r.depth
    form = int(rng.integers(3))
    top = float(np.quantile(np.abs(np.gradient(r.x, H)), 0.95))
    level = r.k * d**r.n
    asymmetry = rng.uniform(0.8, 1.2)
    if name == "adhesion":
        reach = rng.uniform(0.04, 0.25) * d
        return lambda x, g: g * level * np.asarray(capillary(x, reach))
    if name == "coulomb_friction":
        stretch = rng.uniform(5e-4, 5e-3) * d

        def dry(x: Array, g: float) -> Array:
            v = np.gradient(x, H)
            rows = (
                lambda: np.sign(v),
                lambda: elasto_plastic(v, 1.0, 1.0 / stretch, 0.6),
                lambda: 2 / np.pi * np.arctan(v / (0.01 * top)),
            )
            row = np.asarray(rows[form]())
            return np.asarray(g * level * np.where(row > 0.0, row, asymmetry * row))

        return dry
    if name == "stribeck_friction":
        slow = rng.uniform(0.05, 0.25) * top
        high = rng.uniform(0.7, 2.0)

        def stribeck(x: Array, g: float) -> Array:
            v = np.gradient(x, H)
            u = np.abs(v) / slow
            fall = (np.exp(-u), 1.0 / (1.0 + u**2), np.exp(-(u**2)))[form]
            return np.asarray(g * level * np.tanh(v / (0.005 * top)) * (1.0 + high * fall))

        return stribeck
    if name == "viscous_friction":
        return lambda x, g: g * level * np.gradient(x, H) / top
    if name == "direction_dependent_damping":
        ratio, everywhere = rng.uniform(0.0, 0.6), bool(rng.integers(2))

        def directed(x: Array, g: float) -> Array:
            v = np.gradient(x, H)
            row = np.where(v > 0.0, v, ratio * v) / top
            return np.asarray(g * level * np.where((x > 0.0) | everywhere, row, 0.0))

        return directed
    if name == "gravity_torque":
        angle = rng.uniform(0, 2 * np.pi)
        return lambda x, g: g * level * np.cos(x + angle)
    if name == "tool_inertia":
        return lambda x, g: g * level * np.gradient(np.gradient(x, H), H) / (top**2 / d)
    if name == "position_ripple":
        pitch, phase = rng.uniform(0.04, 0.3) * d, rng.uniform(0, 6.28)
        waves: tuple[Callable[[Array], Array], ...] = (
            np.sin,
            lambda w: np.sin(w) + 0.3 * np.sin(2 * w + 1.0),
            lambda w: np.arcsin(0.98 * np.sin(w)),
        )
        return lambda x, g: g * level * waves[form](2 * np.pi * x / pitch + phase)
    return None


def _channel(r: Rig, name: str) -> Operation | None:  # noqa: PLR0911 - one row per effect
    rng, t = r.rng, r.t
    form, sign = int(rng.integers(3)), rng.choice([-1.0, 1.0])
    level = r.k * r.depth**r.n
    if name == "channel_delay":
        return lambda f, g: np.interp(t - sign * 0.02 * g, t, f)
    if name == "force_bias":
        return lambda f, g: f + sign * g * level
    if name == "force_drift":
        u = t / t[-1]
        rows = (u, np.log1p(u / rng.uniform(0.1, 0.5)), 1.0 - np.exp(-u / rng.uniform(0.1, 0.6)))
        return lambda f, g: f + sign * g * level * rows[form]
    if name == "periodic_disturbance":
        tone = float(rng.choice([50.0, 60.0, 100.0, rng.uniform(15.0, 90.0)]))
        swell = 1.0 + (0.0, 0.0, 0.02)[form] * np.sin(2 * np.pi * 0.3 * t)
        row = np.sin(2 * np.pi * tone * t) + (0.0, 0.25, 0.0)[form] * np.sin(6 * np.pi * tone * t)
        return lambda f, g: f + g * level * swell * row
    if name == "force_lag":

        def slow(f: Array, g: float) -> Array:
            if form == 2:
                b, a = bessel(2, 1.0 / (2 * np.pi * 0.02 * g), fs=RATE_HZ, norm="mag")
                return np.asarray(lfilter(b, a, f - f[0]) + f[0])
            decay = np.exp(-H / (0.02 * g))
            return np.asarray(lfilter([1.0 - decay], [1.0, -decay], f - f[0]) + f[0])

        return slow
    if name == "force_saturation":

        def limited(f: Array, g: float) -> Array:
            most = np.max(np.abs(f)) / (1.0 + g)
            if form == 2:
                return np.asarray(most * np.tanh((np.abs(f) / most) ** 8) ** 0.125 * np.sign(f))
            return np.clip(f, -most, most)

        return limited
    if name == "outliers":
        return lambda f, g: f
    return None


SLOTS = {"moves": _surface, "material": _material, "tool": _tool, "channel": _channel}
NAMES = (
    "contact_offset", "moving_surface", "permanent_set", "series_compliance", "backlash",
    "channel_delay", "stress_relaxation", "fractional_relaxation", "nonlinear_stiffening",
    "second_layer", "hysteresis", "mullins_softening", "softening", "quadratic_damping",
    "adhesion", "coulomb_friction", "stribeck_friction", "viscous_friction",
    "direction_dependent_damping", "gravity_torque", "tool_inertia", "position_ripple",
    "force_bias", "force_drift", "periodic_disturbance", "force_lag", "force_saturation",
    "outliers",
)  # fmt: skip


def add(r: Rig, name: str, size: float) -> None:
    """Add an effect that changes the force by `size` of its standard deviation."""
    before = r.force()
    goal = size * float(np.std(before))
    if name == "series_compliance":
        r.soft = size / (r.k * r.n * r.depth ** (r.n - 1.0))
        for _ in range(3):
            r.soft *= goal / float(np.sqrt(np.mean((r.force() - before) ** 2)))
        return
    for slot, make in SLOTS.items():
        operation = make(r, name)
        if operation is None:
            continue
        place = getattr(r, slot)
        gain = 0.1
        for _ in range(5):
            place.append((operation, gain))
            change = float(np.sqrt(np.mean((r.force() - before) ** 2)))
            place.pop()
            gain *= float(np.clip(goal / max(change, 1e-12), 0.05, 20.0))
        place.append((operation, gain))
        return
    raise ValueError(name)
