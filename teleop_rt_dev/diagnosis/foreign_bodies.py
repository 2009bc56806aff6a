"""The second generator's effects on a rig's surface and material.

Each function draws an effect's parameters from the rig's generator; where the effect has several
forms, `form` chooses among them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import fftconvolve, lfilter

from teleop_rt_dev.diagnosis.foreign_laws import jenkin, play
from teleop_rt_dev.diagnosis.foreign_motions import Array
from teleop_rt_dev.diagnosis.foreign_rigs import Drawn, H, Operation, Rig


def _contact_offset(r: Rig, sign: float) -> Operation:
    return lambda x, g: x + sign * g * r.depth


def _moving_surface(r: Rig, sign: float) -> Operation:
    rng, u = r.rng, r.t / r.t[-1]
    tone = rng.uniform(0.08, 1.5)
    form = rng.integers(2)
    rows = (u, np.sin(2 * np.pi * tone * r.t + rng.uniform(0, 6.0)))
    return lambda x, g: x - sign * g * r.depth * rows[form]


def _permanent_set(r: Rig, _: float) -> Operation:
    free = r.rng.uniform(0.0, 0.15) * r.depth

    def left(x: Array, g: float) -> Array:
        return x - g * np.maximum(np.maximum.accumulate(x) - free, 0.0)

    return left


def _backlash(r: Rig, _: float) -> Operation:
    start = r.rng.uniform(-1.0, 1.0)
    return lambda x, g: np.asarray(play(x, g * r.depth, start))


SURFACE: dict[str, Callable[[Rig, float], Operation]] = {
    "contact_offset": _contact_offset,
    "moving_surface": _moving_surface,
    "permanent_set": _permanent_set,
    "backlash": _backlash,
}


def surface_effect(r: Rig, name: str) -> Operation | None:
    """Return the motion against the surface after the effect; None for another's."""
    sign = r.rng.choice([-1.0, 1.0])
    return SURFACE[name](r, sign) if name in SURFACE else None


def _stress_relaxation(r: Rig, form: int) -> Operation:
    arms = 1 + form
    taus = np.sort(np.exp(r.rng.uniform(np.log(0.02), np.log(3.0), arms)))
    shares = r.rng.uniform(0.3, 1.0, arms)

    def relax(x: Array, g: float) -> Array:
        rate = np.gradient(np.maximum(x, 0.0), H)
        rows = [
            s * lfilter([H], [1.0, -np.exp(-H / tau)], rate)
            for s, tau in zip(shares, taus, strict=True)
        ]
        return np.asarray(g * r.k * np.sum(rows, axis=0))

    return relax


def _fractional_relaxation(r: Rig, _: int) -> Operation:
    order = r.rng.uniform(0.12, 0.6)
    j = np.arange(1, r.t.size)
    weights = np.concatenate(([1.0], np.cumprod((j - 1.0 - order) / j)))

    def power_law(x: Array, g: float) -> Array:
        depth = np.maximum(x, 0.0) - max(x[0], 0.0)
        return np.asarray(g * r.k * fftconvolve(depth, weights)[: r.t.size] / (H**order))

    return power_law


def _nonlinear_stiffening(r: Rig, form: int) -> Operation:
    d = r.depth
    laws: tuple[Callable[[Array], Array], ...] = (
        lambda s: s**3,
        lambda s: np.expm1(3.0 * s) - 3.0 * s,
        lambda s: s / (1.0 - 0.6 * s) - s,
        lambda s: s**2.2,
    )
    return lambda x, g: g * r.k * d * laws[form](np.maximum(x, 0.0) / d)


def _second_layer(r: Rig, _: int) -> Operation:
    rng, d = r.rng, r.depth
    where, blur = rng.uniform(0.25, 0.75) * d, rng.choice([0.002, 0.02]) * d
    return lambda x, g: g * r.k * blur * np.logaddexp(0.0, (x - where) / blur)


def _hysteresis(r: Rig, form: int) -> Operation:
    d = r.depth
    yields = np.exp(r.rng.uniform(np.log(0.01), np.log(0.3), 1 + 6 * form)) * d
    grows = form % 2

    def yielding(x: Array, g: float) -> Array:
        row = np.asarray(jenkin(np.maximum(x, 0.0), yields))
        return g * r.k * row * (np.maximum(x, 0.0) / d if grows else 1.0)

    return yielding


def _mullins_softening(r: Rig, _: int) -> Operation:
    reach = r.rng.uniform(0.1, 0.6) * r.depth

    def worn(x: Array, g: float) -> Array:
        depth = np.maximum(x, 0.0)
        below = np.maximum.accumulate(depth) - depth
        return -g * r.k * depth * (1.0 - np.exp(-below / reach))

    return worn


def _softening(r: Rig, form: int) -> Operation:
    t = r.t
    tau = r.rng.uniform(0.1, 0.6) * t[-1]
    loss = (t / t[-1], np.log1p(t / tau), 1.0 - 1.0 / (1.0 + t / tau), np.tanh(t / tau))[form]
    sign = r.rng.choice([-1.0, 1.0])
    return lambda x, g: sign * g * r.k * np.maximum(x, 0.0) * loss


def _quadratic_damping(r: Rig, _: int) -> Operation:
    d = r.depth

    def turbulent(x: Array, g: float) -> Array:
        v = np.gradient(x, H)
        return np.asarray(g * r.k * d * v * np.abs(v) / np.quantile(np.abs(v), 0.95) ** 2)

    return turbulent


MATERIAL: dict[str, Drawn] = {
    "stress_relaxation": _stress_relaxation,
    "fractional_relaxation": _fractional_relaxation,
    "nonlinear_stiffening": _nonlinear_stiffening,
    "second_layer": _second_layer,
    "hysteresis": _hysteresis,
    "mullins_softening": _mullins_softening,
    "softening": _softening,
    "quadratic_damping": _quadratic_damping,
}


def material_effect(r: Rig, name: str) -> Operation | None:
    """Return the force that the effect adds inside the material; None for another's."""
    form = int(r.rng.integers(4))
    return MATERIAL[name](r, form) if name in MATERIAL else None
