"""A slow tone on the force, in free air as in contact: a sensor that warms and cools."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.applicable import applicable
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.recordings.recording import from_arrays


@pytest.mark.parametrize(("tone_Hz", "seconds"), cases((0.1, 24.0), (0.05, 40.0), (0.5, 16.0)))
def test_a_slow_tone_on_the_force_is_no_swing_of_the_surface(
    tone_Hz: float, seconds: float
) -> None:
    """The swing of a surface that fits it acts in contact only."""
    dt_s, rng = 4e-3, np.random.default_rng(70)
    t = dt_s * np.arange(round(seconds / dt_s))
    x = 1.5e-3 * np.sin(4.3 * t) + 1.1e-3 * np.sin(9.1 * t + 1.0) + 6e-4 * np.sin(17.0 * t + 2.0)
    v = np.gradient(x, dt_s)
    force = np.where(x > 0.0, np.maximum(2000.0 * x + 8.0 * v, 0.0), 0.0)
    force += 0.4 * np.sin(2.0 * np.pi * tone_Hz * t + 0.3) + 0.03 * rng.standard_normal(t.size)
    answer = diagnose(from_arrays("tide", t, x + 0.02, force)).answer
    assert answer["class"] == [["periodic_disturbance"]]
    found = answer["effects"][0]["parameters"]
    assert found["disturbance"]["value"] == pytest.approx(0.4, rel=0.05)
    assert found["frequency"]["value"] == pytest.approx(tone_Hz, rel=0.05)


@pytest.mark.parametrize(
    ("base", "pressed", "slowest_Hz"),
    [
        ("kelvin-voigt", False, 0.03),
        ("kelvin-voigt", True, 1.0),
        ("spring,viscous,bias", False, 1.0),
        ("mass", False, 1.0),
    ],
)
def test_only_free_air_shows_a_tone_as_slow_as_the_motion(
    base: str, pressed: bool, slowest_Hz: float
) -> None:
    """Without it the tone took the place of the friction of a rack that swings slowly."""
    t = 4e-3 * np.arange(500)
    swing = from_arrays("swing", t, 0.01 * np.sin(2.0 * t), np.sign(np.cos(2.0 * t)))
    possible = applicable(LIBRARY, swing, base_of(base), pressed=pressed)
    tones = [effect for effect in possible if effect.name == "periodic_disturbance"]
    assert {tone.shapes[0].lower for tone in tones} == {slowest_Hz}
    assert len(tones) == (2 if base == "kelvin-voigt" else 1)  # the other one has harmonics
