"""The second generator's effects on a rig's tool and on the channel of its force.

Each function draws an effect's parameters from the rig's generator; where the effect has several
forms, `form` chooses among them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import bessel, lfilter

from teleop_rt_dev.diagnosis.foreign_laws import capillary, elasto_plastic
from teleop_rt_dev.diagnosis.foreign_motions import RATE_HZ, Array
from teleop_rt_dev.diagnosis.foreign_rigs import H, Operation, Rig


@dataclass(frozen=True)
class Tool:
    """A rig's tool: a fast speed of it, the bare material's force, the friction's asymmetry."""

    rig: Rig
    top: float
    level: float
    asymmetry: float

    @property
    def depth(self) -> float:
        """The deepest penetration."""
        return self.rig.depth


def _adhesion(tool: Tool, _: int) -> Operation:
    reach = tool.rig.rng.uniform(0.04, 0.25) * tool.depth
    return lambda x, g: g * tool.level * np.asarray(capillary(x, reach))


def _coulomb_friction(tool: Tool, form: int) -> Operation:
    stretch = tool.rig.rng.uniform(5e-4, 5e-3) * tool.depth

    def dry(x: Array, g: float) -> Array:
        v = np.gradient(x, H)
        rows = (
            lambda: np.sign(v),
            lambda: elasto_plastic(v, 1.0, 1.0 / stretch, 0.6),
            lambda: 2 / np.pi * np.arctan(v / (0.01 * tool.top)),
        )
        row = np.asarray(rows[form]())
        return np.asarray(g * tool.level * np.where(row > 0.0, row, tool.asymmetry * row))

    return dry


def _stribeck_friction(tool: Tool, form: int) -> Operation:
    slow = tool.rig.rng.uniform(0.05, 0.25) * tool.top
    high = tool.rig.rng.uniform(0.7, 2.0)

    def stribeck(x: Array, g: float) -> Array:
        v = np.gradient(x, H)
        u = np.abs(v) / slow
        fall = (np.exp(-u), 1.0 / (1.0 + u**2), np.exp(-(u**2)))[form]
        return np.asarray(g * tool.level * np.tanh(v / (0.005 * tool.top)) * (1.0 + high * fall))

    return stribeck


def _viscous_friction(tool: Tool, _: int) -> Operation:
    return lambda x, g: g * tool.level * np.gradient(x, H) / tool.top


def _direction_dependent_damping(tool: Tool, _: int) -> Operation:
    rng = tool.rig.rng
    ratio, everywhere = rng.uniform(0.0, 0.6), bool(rng.integers(2))

    def directed(x: Array, g: float) -> Array:
        v = np.gradient(x, H)
        row = np.where(v > 0.0, v, ratio * v) / tool.top
        return np.asarray(g * tool.level * np.where((x > 0.0) | everywhere, row, 0.0))

    return directed


def _gravity_torque(tool: Tool, _: int) -> Operation:
    angle = tool.rig.rng.uniform(0, 2 * np.pi)
    return lambda x, g: g * tool.level * np.cos(x + angle)


def _tool_inertia(tool: Tool, _: int) -> Operation:
    scale = tool.top**2 / tool.depth
    return lambda x, g: g * tool.level * np.gradient(np.gradient(x, H), H) / scale


def _position_ripple(tool: Tool, form: int) -> Operation:
    rng = tool.rig.rng
    pitch, phase = rng.uniform(0.04, 0.3) * tool.depth, rng.uniform(0, 6.28)
    waves: tuple[Callable[[Array], Array], ...] = (
        np.sin,
        lambda w: np.sin(w) + 0.3 * np.sin(2 * w + 1.0),
        lambda w: np.arcsin(0.98 * np.sin(w)),
    )
    return lambda x, g: g * tool.level * waves[form](2 * np.pi * x / pitch + phase)


TOOL: dict[str, Callable[[Tool, int], Operation]] = {
    "adhesion": _adhesion,
    "coulomb_friction": _coulomb_friction,
    "stribeck_friction": _stribeck_friction,
    "viscous_friction": _viscous_friction,
    "direction_dependent_damping": _direction_dependent_damping,
    "gravity_torque": _gravity_torque,
    "tool_inertia": _tool_inertia,
    "position_ripple": _position_ripple,
}


def tool_effect(r: Rig, name: str) -> Operation | None:
    """Return the force that the effect adds at the tool; None for another's."""
    form = int(r.rng.integers(3))
    top = float(np.quantile(np.abs(np.gradient(r.x, H)), 0.95))
    tool = Tool(r, top, r.k * r.depth**r.n, r.rng.uniform(0.8, 1.2))
    return TOOL[name](tool, form) if name in TOOL else None


@dataclass(frozen=True)
class Channel:
    """The way of a rig's force to its reader: the force of the bare material, and a drawn sign."""

    rig: Rig
    level: float
    sign: float


def _channel_delay(channel: Channel, _: int) -> Operation:
    t = channel.rig.t
    return lambda f, g: np.interp(t - channel.sign * 0.02 * g, t, f)


def _force_bias(channel: Channel, _: int) -> Operation:
    return lambda f, g: f + channel.sign * g * channel.level


def _force_drift(channel: Channel, form: int) -> Operation:
    rng, t = channel.rig.rng, channel.rig.t
    u = t / t[-1]
    rows = (u, np.log1p(u / rng.uniform(0.1, 0.5)), 1.0 - np.exp(-u / rng.uniform(0.1, 0.6)))
    return lambda f, g: f + channel.sign * g * channel.level * rows[form]


def _periodic_disturbance(channel: Channel, form: int) -> Operation:
    rng, t = channel.rig.rng, channel.rig.t
    tone = float(rng.choice([50.0, 60.0, 100.0, rng.uniform(15.0, 90.0)]))
    swell = 1.0 + (0.0, 0.0, 0.02)[form] * np.sin(2 * np.pi * 0.3 * t)
    row = np.sin(2 * np.pi * tone * t) + (0.0, 0.25, 0.0)[form] * np.sin(6 * np.pi * tone * t)
    return lambda f, g: f + g * channel.level * swell * row


def _force_lag(_: Channel, form: int) -> Operation:
    def slow(f: Array, g: float) -> Array:
        if form == 2:
            b, a = bessel(2, 1.0 / (2 * np.pi * 0.02 * g), fs=RATE_HZ, norm="mag")
            return np.asarray(lfilter(b, a, f - f[0]) + f[0])
        decay = np.exp(-H / (0.02 * g))
        return np.asarray(lfilter([1.0 - decay], [1.0, -decay], f - f[0]) + f[0])

    return slow


def _force_saturation(_: Channel, form: int) -> Operation:
    def limited(f: Array, g: float) -> Array:
        most = np.max(np.abs(f)) / (1.0 + g)
        if form == 2:
            return np.asarray(most * np.tanh((np.abs(f) / most) ** 8) ** 0.125 * np.sign(f))
        return np.clip(f, -most, most)

    return limited


def _outliers(_channel: Channel, _: int) -> Operation:
    """Change nothing here: they come with the noise."""
    return lambda f, g: f


CHANNEL: dict[str, Callable[[Channel, int], Operation]] = {
    "channel_delay": _channel_delay,
    "force_bias": _force_bias,
    "force_drift": _force_drift,
    "periodic_disturbance": _periodic_disturbance,
    "force_lag": _force_lag,
    "force_saturation": _force_saturation,
    "outliers": _outliers,
}


def channel_effect(r: Rig, name: str) -> Operation | None:
    """Return the force after the effect, on its way to the reader; None for another's."""
    form, sign = int(r.rng.integers(3)), r.rng.choice([-1.0, 1.0])
    if name not in CHANNEL:
        return None
    return CHANNEL[name](Channel(r, r.k * r.depth**r.n, sign), form)
