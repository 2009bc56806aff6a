"""Synthetic recordings with one physical effect, or more, integrated by their own physics.

Everything runs at 10 kHz, explicit in time; no code and, where physics offers another form, no
formula of the effect library is used: friction is LuGre, relaxation has three arms or the
full history of its power law, Mullins is Ogden and Roxburgh's, the play has a state.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter
from scipy.special import erf

from teleop_rt_dev.diagnosis.laws import (
    adhesion_bridge,
    arms,
    behind_spring,
    bouc_wen,
    first_order,
    lugre,
    play,
    power_law_memory,
    resonance,
)
from teleop_rt_dev.diagnosis.motions import MOTIONS, RATE_HZ, Array

H = 1.0 / RATE_HZ
DECIMATE = 10
MATERIALS = {
    "silicone": ("kelvin-voigt", 3600.0, 20.0, 1.0, 0.02),
    "foam": ("kelvin-voigt", 400.0, 6.0, 1.0, 0.03),
    "stiff": ("kelvin-voigt", 20000.0, 60.0, 1.0, 0.005),
    "soft": ("hunt-crossley", 16000.0, 1500.0, 1.5, 0.02),
}


@dataclass
class Record:
    """A recording at 1 kHz and what only the generator knows."""

    t: Array
    position: Array
    force: Array
    base: str
    truth: tuple[str, ...]
    noise: float
    notes: dict[str, float | str] = field(default_factory=dict)
    clean: Array = field(default_factory=lambda: np.zeros(0))
    path: Array = field(default_factory=lambda: np.zeros(0))


def coloured_noise(rng: np.random.Generator, kind: str, n: int) -> Array:
    """Return noise of deviation 1: white, AR1 (0.9) or pink (1/f)."""
    white = rng.standard_normal(n)
    if kind == "white":
        return white
    if kind == "ar1":
        return np.asarray(lfilter([np.sqrt(1 - 0.81)], [1.0, -0.9], rng.standard_normal(n + 200)))[
            200:
        ]
    spectrum = np.fft.rfft(rng.standard_normal(2 * n))
    frequency = np.arange(spectrum.size)
    frequency[0] = 1
    row = np.fft.irfft(spectrum / np.sqrt(frequency))[:n]
    return np.asarray(row / np.std(row))


def _material(name: str, x: Array, v: Array) -> Array:
    base, k, b, n, _ = MATERIALS[name]
    depth = np.maximum(x, 0.0)
    force = k * depth + b * v if base == "kelvin-voigt" else depth**n * (k + b * v)
    return np.where(x > 0.0, force, 0.0)


class SyntheticPlant:
    """One tool, one material, one movement; `apply` adds effects, `record` measures."""

    def __init__(
        self,
        rng: np.random.Generator,
        material: str,
        motion: str,
        seconds: float = 10.0,
        path: Array | None = None,
    ):
        self.rng = rng
        self.material = material
        self.base, self.k, self.b, self.n, self.depth = MATERIALS[material]
        drawn = MOTIONS[motion](rng, self.depth, seconds)
        # Drawn all the same, so that the effects' own draws stay those of the seed.
        self.x = drawn if path is None else path
        self.v = np.gradient(self.x, H)
        self.a = np.gradient(self.v, H)
        self.t = H * np.arange(self.x.size)
        self.plain = _material(material, self.x, self.v)
        self.level = float(np.std(self.plain))
        self.tip = self.x.copy()
        self.extra = np.zeros_like(self.x)
        self.channel: list[tuple[str, float]] = []
        self.sensor = np.zeros_like(self.x)

    def apply(self, effect: str, size: float) -> None:
        """Add an effect whose force is about `size` times the force's standard deviation."""
        for part in (_kinematics, _material_effects, _tool, _sensor, _strangers):
            if part(self, effect, size):
                return
        raise ValueError(effect)

    def true_force(self) -> Array:
        """Return what the force channel would give without noise, at 10 kHz."""
        moved = np.gradient(self.tip, H)
        force = _material(self.material, self.tip, moved) + self.extra
        for kind, value in self.channel:
            if kind == "series":
                linear = self.base == "kelvin-voigt"
                force = behind_spring(self.tip, self.k, self.b, self.n, linear, value) + self.extra
            elif kind == "delay":
                force = np.interp(self.t - value, self.t, force)
            elif kind == "lag":
                force = first_order(force, value)
            elif kind == "clip":
                force = np.clip(force, -value, value)
        return np.asarray(force + self.sensor)

    def record(self, truth: tuple[str, ...], noise: float, kind: str = "white") -> Record:
        """Measure at 1 kHz with a 5 um encoder and noise of `noise` times the force's deviation."""
        clean = self.true_force()[::DECIMATE]
        x = 5e-6 * np.round(self.x[::DECIMATE] / 5e-6)
        sigma = noise * self.level
        force = clean + sigma * coloured_noise(self.rng, kind, clean.size)
        if "outliers" in truth:
            hit = self.rng.random(clean.size) < 0.004
            force = force + hit * self.rng.choice([-1, 1], clean.size) * self.rng.uniform(
                10 * sigma, 60 * sigma, clean.size
            )
        return Record(
            np.asarray(self.t[::DECIMATE]),
            x,
            force,
            self.base,
            truth,
            sigma,
            clean=clean,
            path=self.x[::DECIMATE],
        )


def _kinematics(p: SyntheticPlant, effect: str, size: float) -> bool:
    travel = size * float(np.std(np.maximum(p.x, 0.0)))
    sign = p.rng.choice([-1.0, 1.0])
    if effect == "contact_offset":
        p.tip = p.tip + sign * travel
    elif effect == "moving_surface":
        if p.rng.random() < 0.5:
            p.tip = p.tip - sign * 2.0 * travel * p.t / p.t[-1]
        else:
            p.tip = p.tip - 1.4 * travel * np.sin(2 * np.pi * p.rng.uniform(0.15, 0.9) * p.t + 1.0)
    elif effect == "series_compliance":
        deepest = float(np.max(p.x))
        stiffness = p.k * p.n * deepest ** (p.n - 1.0)
        p.channel.append(("series", stiffness / size))
    elif effect == "backlash":
        p.tip = play(p.tip, 2.0 * travel)
    elif effect == "channel_delay":
        p.channel.append(
            ("delay", float(sign * size * np.std(p.plain) / np.std(np.gradient(p.plain, H))))
        )
    elif effect == "permanent_set":
        p.tip = p.tip - 0.8 * size * np.maximum.accumulate(np.maximum(p.tip, 0.0))
    else:
        return False
    return True


def _material_effects(p: SyntheticPlant, effect: str, size: float) -> bool:
    depth, goal = np.maximum(p.tip, 0.0), size * p.level
    contact = p.tip > 0.0
    if effect == "stress_relaxation":
        tau = p.rng.uniform(0.1, 1.0) * np.array([0.2, 1.0, 5.0])
        row = arms(depth, p.rng.uniform(0.2, 1.0, 3), tau)
    elif effect == "fractional_relaxation":
        slow = power_law_memory(depth[::DECIMATE].copy(), p.rng.uniform(0.15, 0.5), 1e-3)
        row = np.interp(p.t, p.t[::DECIMATE], slow)
    elif effect == "nonlinear_stiffening":
        row = depth ** p.rng.uniform(2.2, 4.0)
    elif effect == "second_layer":
        edge = p.rng.uniform(0.3, 0.7) * p.depth
        row = 1e-4 * np.logaddexp(0.0, (depth - edge) / 1e-4)
    elif effect == "hysteresis":
        row = bouc_wen(p.tip, p.rng.uniform(0.02, 0.15) * p.depth, 0.6, 0.4, p.rng.uniform(1, 2))
    elif effect == "mullins_softening":
        energy = 0.5 * depth**2
        most = np.maximum.accumulate(energy)
        row = -depth * erf((most - energy) / (0.1 * np.max(energy) + 0.3 * most))
    elif effect == "softening":
        worn = np.cumsum(contact) * H
        row = -depth * (1.0 - np.exp(-worn / p.rng.uniform(1.0, 6.0)))
    elif effect == "quadratic_damping":
        row = p.v * np.abs(p.v)
    elif effect == "adhesion":
        reach = p.rng.uniform(0.05, 0.15) * p.depth
        row = adhesion_bridge(p.x, reach)
        p.extra = p.extra + 3.0 * size * p.level * row
        return True
    else:
        return False
    row = np.where(contact, row, 0.0)
    p.extra = p.extra + goal * row / float(np.std(row))
    return True


def _tool(p: SyntheticPlant, effect: str, size: float) -> bool:
    goal = size * p.level
    peak = float(np.quantile(np.abs(p.v), 0.99))
    if effect == "coulomb_friction":
        row = lugre(p.v, 1.0, 1.0, 0.05 * peak, p.rng.uniform(1e-3, 5e-3) * p.depth)
    elif effect == "stribeck_friction":
        row = lugre(
            p.v,
            1.0,
            p.rng.uniform(1.5, 2.5),
            p.rng.uniform(0.05, 0.2) * peak,
            p.rng.uniform(1e-3, 3e-3) * p.depth,
        )
    elif effect == "viscous_friction":
        row = p.v
    elif effect == "direction_dependent_damping":
        row = np.where(p.v > 0.0, 1.3, 0.7) * p.v
    elif effect == "tool_inertia":
        row = p.a
    elif effect == "position_ripple":
        pitch = p.rng.uniform(0.05, 0.25) * p.depth
        angle = 2 * np.pi * p.x / pitch + p.rng.uniform(0, 6.28)
        row = np.sin(angle) + 0.1 * np.sin(2 * angle)
    else:
        return False
    p.extra = p.extra + goal * row / float(np.std(row))
    return True


def _sensor(p: SyntheticPlant, effect: str, size: float) -> bool:
    goal, sign = size * p.level, p.rng.choice([-1.0, 1.0])
    if effect == "force_bias":
        p.sensor = p.sensor + sign * goal
    elif effect == "force_drift":
        u = p.t / p.t[-1]
        p.sensor = p.sensor + sign * 3 * goal * (u if p.rng.random() < 0.5 else np.sqrt(u))
    elif effect == "periodic_disturbance":
        tone = p.rng.choice([50.0, 60.0, p.rng.uniform(20.0, 120.0)])
        angle = 2 * np.pi * tone * p.t
        p.sensor = p.sensor + 1.4 * goal * (np.sin(angle) + 0.1 * np.sin(2 * angle))
    elif effect == "force_lag":
        rate = np.std(np.gradient(p.plain, H)) / np.std(p.plain)
        p.channel.append(("lag", float(size / rate)))
    elif effect == "force_saturation":
        p.channel.append(("clip", float(np.max(p.plain) * (1.0 - 0.5 * min(size * 2.0, 0.8)))))
    elif effect == "outliers":
        pass
    else:
        return False
    return True


def _strangers(p: SyntheticPlant, effect: str, size: float) -> bool:
    """Effects that the vocabulary does not have."""
    depth, contact = np.maximum(p.tip, 0.0), p.tip > 0.0
    if effect == "pulsating_stiffness":
        row = depth * np.sin(2 * np.pi * p.rng.uniform(0.7, 3.0) * p.t)
    elif effect == "tool_resonance":
        row = resonance(p.a, p.rng.uniform(9.0, 20.0), 0.05)
    elif effect == "thinning_damper":
        row = np.where(contact, p.v / (1.0 + (3.0 * p.v / np.std(p.v)) ** 2), 0.0)
    elif effect == "wandering_gain":
        wander = np.cumsum(p.rng.standard_normal(p.t.size // 100 + 2))
        row = p.plain * np.interp(p.t, 0.01 * np.arange(wander.size), wander - wander.mean())
    elif effect == "depth_waves":
        row = np.where(contact, np.sin(2 * np.pi * (depth / p.depth) ** 2 * 4.0), 0.0)
    else:
        return False
    p.extra = p.extra + size * p.level * row / float(np.std(row))
    return True


STRANGERS = (
    "pulsating_stiffness",
    "tool_resonance",
    "thinning_damper",
    "wandering_gain",
    "depth_waves",
)


def make(
    seed: int,
    effects: tuple[str, ...],
    material: str = "silicone",
    motion: str = "rich",
    size: float = 0.1,
    noise: float = 0.01,
    kind: str = "white",
    seconds: float = 10.0,
    path: Array | None = None,
) -> Record:
    """Return the recording of one seed; along `path` (at 10 kHz) instead of its motion if given."""
    rng = np.random.default_rng(seed)
    plant = SyntheticPlant(rng, material, motion, seconds, path)
    for effect in effects:
        plant.apply(effect, size)
    record = plant.record(effects, noise, kind)
    record.notes = {
        "seed": seed,
        "material": material,
        "motion": motion,
        "size": size,
        "noise": noise,
        "kind": kind,
    }
    return record
