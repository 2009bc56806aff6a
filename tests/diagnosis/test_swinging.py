"""A second mass that hangs on the tool by a spring, integrated in small steps."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import Recording, from_arrays

EVERY, STEP_S = 20, 1e-4


def dragged(mass_kg: float, frequency_Hz: float, damping_ratio: float) -> Recording:
    """Return presses of a damped spring whose tool drags such a mass along."""
    rng = np.random.default_rng(11)
    t = np.arange(0.0, 12.0, STEP_S)
    tones = ((4e-3, 0.37, 0.2), (2e-3, 0.9, 1.7), (1e-3, 2.3, 4.0), (0.3e-3, 7.3, 2.0))
    x = 3e-3 + sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in tones)
    v = np.gradient(x, t)
    natural = 2 * np.pi * frequency_Hz
    place, speed, pull = float(x[0]), float(v[0]), np.empty(t.size)
    for i, (here, rate) in enumerate(zip(x.tolist(), v.tolist(), strict=True)):
        pull[i] = natural**2 * (here - place) + 2 * damping_ratio * natural * (rate - speed)
        speed += STEP_S * float(pull[i])
        place += STEP_S * speed
    force = np.where(x > 0.0, 2600.0 * x + 45.0 * v, 0.0) + mass_kg * pull
    t, x, force = t[::EVERY], x[::EVERY], force[::EVERY]
    force = force + 0.03 * rng.standard_normal(t.size)
    return from_arrays("dragged", t, 1e-6 * np.round(x / 1e-6), force)


@pytest.mark.parametrize(("frequency", "damping"), [(4.7, 0.04), (11.0, 0.1)])
def test_a_mass_on_a_spring_is_the_tools_inertia_and_no_tone(
    frequency: float, damping: float
) -> None:
    answer = diagnose(dragged(1.2, frequency, damping), "kelvin-voigt").answer
    assert answer["class"] == [["tool_inertia"]]
    found = {name: one["value"] for name, one in answer["effects"][0]["parameters"].items()}
    assert found["swinging_mass"] == pytest.approx(1.2, rel=0.02)
    assert found["frequency"] == pytest.approx(frequency, rel=0.02)
    assert found["damping_ratio"] == pytest.approx(damping, rel=0.2)
    assert answer["error"]["after_over_floor"] < 1.1
