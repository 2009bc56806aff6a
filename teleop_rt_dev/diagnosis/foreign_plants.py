"""A second, independent generator of recordings: other physics, other rigs, other habits.

It shares nothing with the effect library or with `plants`: other functional forms of
every effect, sampling rates of 500 Hz to 2 kHz, foam to stiff walls, three base models, encoders
coarse and fine, sensors with coloured noise and converter steps.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from teleop_rt_dev.diagnosis.foreign_effects import add
from teleop_rt_dev.diagnosis.foreign_motions import MOTIONS, RATE_HZ, Array
from teleop_rt_dev.diagnosis.foreign_rigs import MARGIN_S, Rig, as_lever, rig


@dataclass
class Foreign:
    """A recording, and its maker's knowledge: truth, noise, the force without it."""

    t: Array
    position: Array
    force: Array
    base: str
    truth: tuple[str, ...]
    noise: float
    units: tuple[str, str] = ("m", "N")
    notes: dict[str, Any] = field(default_factory=dict)
    clean: Array = field(default_factory=lambda: np.zeros(0))
    plain: Array = field(default_factory=lambda: np.zeros(0))
    rig: Rig | None = None


def noise_of(rng: np.random.Generator, kind: str, n: int) -> Array:
    """Return noise of deviation 1: white, first-order (0.7 to 0.97), or 1/f."""
    if kind == "white":
        return rng.standard_normal(n)
    if kind == "ar1":
        pole = rng.uniform(0.7, 0.97)
        row = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(n + 500))[500:]
        return np.asarray(row)
    frequency = np.fft.rfftfreq(4 * n)
    frequency[0] = frequency[1]
    phase = np.exp(2j * np.pi * rng.random(frequency.size))
    row = np.fft.irfft(phase / np.sqrt(frequency))[:n]
    return np.asarray((row - row.mean()) / np.std(row))


def foreign(
    seed: int,
    effects: tuple[str, ...] = (),
    *,
    size: float | None = None,
    noise: float | None = None,
    kind: str | None = None,
    base: str | None = None,
    motion: str | None = None,
    rate_hz: int | None = None,
    seconds: float | None = None,
    air: float | None = None,
) -> Foreign:
    """Return a recording; the seed draws everything that is not given."""
    rng = np.random.default_rng([seed, 77])
    drawn = _drawn(rng)
    given = {"size": size, "noise": noise, "kind": kind, "base": base, "motion": motion,
            "rate_hz": rate_hz, "seconds": seconds, "air": air}  # fmt: skip
    drawn.update({key: value for key, value in given.items() if value is not None})
    # Half a second before and after is not recorded: no recording starts with the world.
    r = rig(rng, drawn["base"], drawn["motion"], drawn["seconds"] + 2.0 * MARGIN_S, drawn["air"])
    if "gravity_torque" in effects:
        as_lever(r)
    plain = r.force()
    for name in effects:
        add(r, name, drawn["size"])
    every = RATE_HZ // drawn["rate_hz"]
    clean = recorded(r.force(), every)
    sigma = drawn["noise"] * float(np.std(plain))
    noise_row = _noise_row(rng, drawn["kind"], sigma, clean.size, outliers="outliers" in effects)
    bit = 0.0
    if rng.random() < 0.3:
        bit = 2.0 * float(np.max(np.abs(clean))) / 2 ** int(rng.choice([12, 14, 16]))
    encoder = r.depth / float(np.exp(rng.uniform(np.log(1500.0), np.log(20_000.0))))
    notes = {"seed": seed, **drawn, "k": r.k, "b": r.b, "m": r.m, "n": r.n, "depth": r.depth,
             "encoder": encoder, "bit": bit}  # fmt: skip
    return Foreign(
        t=recorded(r.t, every) - MARGIN_S,
        position=on_grid(recorded(r.x, every), encoder),
        force=on_grid(clean + noise_row, bit),
        base=drawn["base"],
        truth=effects,
        noise=sigma,
        units=("rad", "Nm") if "gravity_torque" in effects else ("m", "N"),
        notes=notes,
        clean=clean,
        plain=recorded(plain, every),
        rig=r,
    )


def _drawn(rng: np.random.Generator) -> dict[str, Any]:
    """Return the parts of a recording's recipe that are not given."""
    return {
        "size": float(np.exp(rng.uniform(np.log(0.03), np.log(0.3)))),
        "noise": float(np.exp(rng.uniform(np.log(0.001), np.log(0.05)))),
        "kind": str(rng.choice(["white", "white", "white", "white", "ar1", "pink"])),
        "base": str(rng.choice(["kelvin-voigt", "kelvin-voigt", "hunt-crossley",
                                "mass-spring-damper"])),
        "motion": str(rng.choice(list(MOTIONS))),
        "rate_hz": int(rng.choice([500, 1000, 1000, 2000])),
        "seconds": float(rng.uniform(8.0, 14.0)),
        "air": float(rng.uniform(0.15, 0.4)),
    }  # fmt: skip


def _noise_row(
    rng: np.random.Generator, kind: str, sigma: float, n: int, *, outliers: bool
) -> Array:
    """Return the sensor's noise (n,) of this deviation, with outliers where they are asked for."""
    row = sigma * noise_of(rng, kind, n)
    if outliers:
        hit = rng.random(n) < rng.uniform(1e-3, 8e-3)
        row = row + hit * rng.standard_t(2, n) * 40.0 * sigma
    return row


def recorded(row: Array, every: int) -> Array:
    """Return the recorded samples of 10 kHz: not the half seconds before and after."""
    margin = round(MARGIN_S * RATE_HZ)
    return row[margin:-margin:every]


def on_grid(row: Array, step: float) -> Array:
    """Return the row as a converter of this step gives it; as it is for a step of 0."""
    return step * np.round(row / step) if step > 0.0 else row


def moved_again(record: Foreign, t: Array, x: Array) -> Foreign:
    """Return another recording of the same rig, material and sensors, fresh, along x(t).

    It lasts as long as the first one did; at rest before and after.
    """
    r, notes = record.rig, record.notes
    if r is None:
        raise ValueError("the record has kept no rig")
    path = CubicSpline(t, x)(np.clip(r.t - MARGIN_S, t[0], t[-1]))
    r = replace(r, x=path)
    rng = np.random.default_rng([notes["seed"], 78])
    every = RATE_HZ // notes["rate_hz"]
    clean = recorded(r.force(), every)
    noise_row = record.noise * noise_of(rng, notes["kind"], clean.size)
    return replace(
        record,
        position=on_grid(recorded(r.x, every), notes["encoder"]),
        force=on_grid(clean + noise_row, notes["bit"]),
        clean=clean,
        rig=r,
    )
