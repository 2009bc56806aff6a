"""Synthetic recordings with one physical effect, or more, integrated by their own physics.

Everything runs at 10 kHz, explicit in time; no code and, where physics offers another form, no
formula of the effect library is used: friction is LuGre, relaxation has three arms or the
full history of its power law, Mullins is Ogden and Roxburgh's, the play has a state.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from teleop_rt_dev.diagnosis.laws import (
    behind_spring,
    first_order,
)
from teleop_rt_dev.diagnosis.motions import MOTIONS, Array
from teleop_rt_dev.diagnosis.plant_effects import ADDING, DECIMATE, H

MATERIALS = {
    "silicone": ("kelvin-voigt", 3600.0, 20.0, 1.0, 0.02),
    "foam": ("kelvin-voigt", 400.0, 6.0, 1.0, 0.03),
    "stiff": ("kelvin-voigt", 20000.0, 60.0, 1.0, 0.005),
    "soft": ("hunt-crossley", 16000.0, 1500.0, 1.5, 0.02),
}


@dataclass
class Record:
    """A recording at 1 kHz and the generator's own truth."""

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
    """Return noise of deviation 1 at 1 kHz: white, AR1 (0.9), pink (1/f), blue or resonant.

    Blue noise is the difference of white noise. Resonant noise is that of a mount of 30 Hz damped
    by a twentieth, on white noise a tenth as strong.
    """
    white = rng.standard_normal(n)
    if kind in {"white", "growing"}:
        return white
    if kind == "ar1":
        return np.asarray(lfilter([np.sqrt(1 - 0.81)], [1.0, -0.9], rng.standard_normal(n + 200)))[
            200:
        ]
    if kind == "blue":
        return np.asarray(np.diff(rng.standard_normal(n + 1)) / np.sqrt(2.0))
    if kind == "resonant":
        pole = np.exp(2e-3 * np.pi * 30.0 * complex(-0.05, np.sqrt(1.0 - 0.05**2)))
        row = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.standard_normal(2 * n))
        return np.asarray(np.sqrt(0.9) * row[n:] / np.std(row[n:]) + np.sqrt(0.1) * white)
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
        self.body = np.zeros_like(self.x)  # the force of effects that give way with the material
        self.extra = np.zeros_like(self.x)
        self.channel: list[tuple[str, float]] = []
        self.sensor = np.zeros_like(self.x)

    def apply(self, effect: str, size: float) -> None:
        """Add an effect whose force is about `size` times the force's standard deviation."""
        for part in ADDING:
            if part(self, effect, size):
                return
        raise ValueError(effect)

    def true_force(self) -> Array:
        """Return the reading of the force channel without noise, at 10 kHz."""
        moved = np.gradient(self.tip, H)
        force = _material(self.material, self.tip, moved) + self.body + self.extra
        for kind, value in self.channel:
            if kind == "series":
                linear = self.base == "kelvin-voigt"
                tip = self.tip - self.body / value  # the spring gives way under this force, too
                force = behind_spring(tip, self.k, self.b, self.n, linear, value)
                force = force + self.body + self.extra
            elif kind == "delay":
                force = np.interp(self.t - value, self.t, force)
            elif kind == "lag":
                force = first_order(force, value)
            elif kind == "clip":
                force = np.clip(force, -value, value)
        return np.asarray(force + self.sensor)

    def record(self, truth: tuple[str, ...], noise: float, kind: str = "white") -> Record:
        """Measure at 1 kHz with a 5 um encoder and noise of `noise` times the force's deviation.

        Of the kind `growing` it is a tenth of that in free air, and grows with the force.
        """
        clean = self.true_force()[::DECIMATE]
        x = 5e-6 * np.round(self.x[::DECIMATE] / 5e-6)
        sigma = noise * self.level
        growth = 0.1 + np.abs(clean) / self.level if kind == "growing" else 1.0
        force = clean + sigma * growth * coloured_noise(self.rng, kind, clean.size)
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


OUTSIDE_LIBRARY = (
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
