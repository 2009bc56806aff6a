"""A tone beside another effect: the line's energy is no evidence on the other effect."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.tones import adds_tone
from teleop_rt.recordings.recording import from_arrays

DT, TONE_N, NOISE_N = 2e-3, 1.0, 0.06


def test_a_second_effect_is_named_beside_a_tone_of_much_more_energy() -> None:
    t = np.arange(0.0, 8.0, DT)
    x = sum(
        size * np.sin(2 * np.pi * hz * t + phase)
        for size, hz, phase in ((0.02, 0.41, 0.3), (0.006, 1.13, 1.1), (0.002, 3.1, 2.0))
    )
    v, a = np.gradient(x, DT), np.gradient(np.gradient(x, DT), DT)
    force = 0.95 * a + 26.0 * v + 2.0 * np.maximum(v, 0.0)
    force += TONE_N * np.sin(2 * np.pi * 57.8 * t)
    force += NOISE_N * np.random.default_rng(8).standard_normal(t.size)
    answer = diagnose(from_arrays("tone", t, x, force), "mass-damper").answer
    assert {*answer["class"][0]} == {"periodic_disturbance", "direction_dependent_damping"}
    assert answer["error"]["after_over_floor"] < 1.2


def test_a_tone_is_a_line_in_time_and_a_ripple_along_the_stroke_is_none() -> None:
    """A ripple has harmonics and other forms, so its energy counts for a second effect."""
    assert {effect.name for effect in LIBRARY if adds_tone(effect)} == {"periodic_disturbance"}


@pytest.mark.parametrize("seed", [2, 3])
def test_a_resonance_of_the_rig_in_the_noise_is_no_tone(seed: int) -> None:
    """Noise that rings at 47 Hz, four times as loud there: its largest bins were named."""
    dt, rng = 1e-3, np.random.default_rng(seed)
    t = dt * np.arange(12_000)
    x = 3e-3 * np.sin(1.2 * np.pi * t) + 1.5e-3 * np.sin(3.4 * np.pi * t + 1.0) + 1e-3
    force = np.where(x > 0.0, np.maximum(1500.0 * x + 10.0 * np.gradient(x, t), 0.0), 0.0)
    decay, turn = np.exp(-np.pi * 47.0 / 12.0 * dt), 2.0 * np.pi * 47.0 * dt
    ring = [1.0, -2.0 * decay * np.cos(turn), decay**2]
    rings = scipy.signal.lfilter([1.0], ring, rng.standard_normal(t.size + 2000))[2000:]
    force += 0.03 * rng.standard_normal(t.size) + 0.05 * rings / np.std(rings)
    answer = diagnose(from_arrays("rings", t, x, force), surface=0.0).answer
    assert answer["verdict"] == "no_missing_effect"


def test_a_resonance_that_leaks_through_the_gaps_of_touches_is_no_tone() -> None:
    """Quick touches leave gaps, through which noise of a peak leaks as a tone of its frequency."""
    dt, rng = 5e-3, np.random.default_rng(10)
    t = dt * np.arange(7200)
    phase = 2.0 * np.pi * (0.1 * t + 0.7 / 36.0 * t**2)
    x = 1e-3 * np.sin(phase) + 3e-4
    v = 1e-3 * np.cos(phase) * 2.0 * np.pi * (0.1 + 1.4 / 36.0 * t)
    force = np.where(x > 0.0, np.maximum(3e4 * x + 120.0 * v, 0.0), 0.0)
    ring = [1.0, -1.9 * np.cos(2.0 * np.pi * rng.uniform(0.1, 0.25)), 0.9025]
    rings = scipy.signal.lfilter([1.0], ring, rng.standard_normal(t.size + 500))[500:]
    force += 0.19 * rings / np.std(rings)
    answer = diagnose(from_arrays("rings", t, 2e-7 * np.round(x / 2e-7), force), surface=0.0).answer
    assert answer["verdict"] == "no_missing_effect"
