"""Noise as instruments have it: a sensor's resonance, and noise that grows with the force."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from scipy.signal import lfilter

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.plants import make


def answer(seed: int, effects: tuple[str, ...], kind: str) -> tuple[str, list[list[str]]]:
    """Return verdict and class of a recording with noise of an eighth of its force.

    The noise hides where the surface is; without it a bias may also be an adhesion.
    """
    record = make(seed, effects, size=0.25, noise=0.12, kind=kind)
    recording = from_arrays("noisy", record.t, record.position, record.force)
    found = diagnose(recording, record.base, surface=0.0).answer
    return found["verdict"], found["class"]


@pytest.mark.parametrize(("seed", "kind"), [(3, "resonant"), (4, "growing")])
def test_noise_of_an_instrument_is_no_missing_effect(seed: int, kind: str) -> None:
    assert answer(seed, (), kind) == ("no_missing_effect", [])


@pytest.mark.parametrize(("seed", "kind"), [(4, "resonant"), (3, "growing")])
def test_a_bias_is_named_in_the_noise_of_an_instrument(seed: int, kind: str) -> None:
    assert answer(seed, ("force_bias",), kind) == ("named", [["force_bias"]])


@pytest.mark.parametrize("seed", cases(0, 1))
def test_noise_that_grows_with_the_speed_is_no_missing_effect(seed: int) -> None:
    record = make(seed, (), noise=0.002)
    speed = np.abs(np.gradient(record.position))
    grown = 0.05 * np.std(record.force) * speed / np.std(speed)
    noise = grown * np.random.default_rng(seed).standard_normal(speed.size)
    recording = from_arrays("speed", record.t, record.position, record.force + noise)
    found = diagnose(recording, record.base).answer
    assert found["verdict"] == "no_missing_effect"
    assert not any("swings" in note for note in found["notes"])


def test_noise_that_grows_with_the_force_is_no_saturation() -> None:
    """It is largest at the largest forces, where a saturation acts."""
    rng = np.random.default_rng(7)
    dt = 0.01
    t = dt * np.arange(1500)
    tones = [np.sin(2.0 * np.pi * rng.uniform(0.2, 1.5) * t + rng.uniform(0, 6)) for _ in range(4)]
    x = sum(0.004 / (i + 1) * tone for i, tone in enumerate(tones))
    force = 800.0 * x + 4.0 * np.gradient(x, dt)
    force += 0.03 * np.abs(force) * rng.standard_normal(t.size)
    force += 0.002 * np.std(force) * rng.standard_normal(t.size)
    recording = from_arrays("growing", t, 2e-6 * np.round(x / 2e-6), force)
    assert diagnose(recording, "spring,viscous,bias").answer["verdict"] == "no_missing_effect"


@pytest.mark.parametrize(("seed", "noise"), [(0, 0.2), (1, 0.4)])
def test_an_amplifiers_noise_in_a_small_motion_is_no_missing_effect(
    seed: int, noise: float
) -> None:
    """Pressed all along, no free air shows it; its fastest part is a fifth of it."""
    rng, dt = np.random.default_rng(seed), 5e-4
    t = dt * np.arange(18000)
    swing = 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * 0.7 * t + rng.uniform(0.0, 6.0)))
    x = 0.004 + 0.0006 * swing + 0.0001 * np.sin(2.0 * np.pi * 0.23 * t)
    kept = float(np.exp(-2.0 * np.pi * 60.0 * dt))
    low_passed = lfilter([1.0], [1.0, -kept], rng.standard_normal(t.size))
    force = 900.0 * x + 4.0 * np.gradient(x, dt)
    force += noise * np.std(force) * low_passed / np.std(low_passed)
    answer = diagnose(from_arrays("amplifier", t, x, force), "kelvin-voigt").answer
    assert answer["verdict"] == "no_missing_effect"
