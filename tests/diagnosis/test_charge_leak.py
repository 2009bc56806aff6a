"""A piezoelectric force sensor, whose charge amplifier forgets a constant force."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from scipy.signal import cont2discrete, lfilter

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

DT_S, SECONDS, STIFFNESS, DAMPING, NOISE_N = 2e-3, 18.0, 900.0, 8.0, 0.015


def presses() -> tuple[np.ndarray, np.ndarray]:
    """Return the time and a depth that is held, released and swung."""
    t = DT_S * np.arange(round(SECONDS / DT_S))
    held = 2.5e-3 * np.interp(t, [0, 1, 1.4, 6, 6.3, 8, 9, 13, 13.5, 18],
                              [-1, -1, 1, 1, -1, -1, 0.8, 0.8, -0.6, -0.6])  # fmt: skip
    return t, held + 6e-4 * np.sin(2 * np.pi * 0.9 * t) + 3e-4 * np.sin(2 * np.pi * 2.3 * t)


def named(leak_s: float | None, *, relaxing: float = 0.0, base: str = "kelvin-voigt") -> dict:
    """Return the answer for a body that may relax within a second, and a sensor that may leak."""
    t, x = presses()
    force = STIFFNESS * x + DAMPING * np.gradient(x, DT_S)
    if base == "kelvin-voigt":
        force = np.where(x > 0.0, np.maximum(force, 0.0), 0.0)
    if relaxing:
        fading = cont2discrete(([1.0, 0.0], [1.0, 1.0]), DT_S, "foh")
        force += lfilter(fading[0].ravel(), fading[1], relaxing * np.maximum(x, 0.0))
        force = np.where(x > 0.0, np.maximum(force, 0.0), 0.0)
    if leak_s is not None:
        leaks = cont2discrete(([leak_s, 0.0], [leak_s, 1.0]), DT_S, "foh")
        force = lfilter(leaks[0].ravel(), leaks[1], force - force[0])
    force = force + NOISE_N * np.random.default_rng(14).standard_normal(t.size)
    made = from_arrays("leak", t, 1e-6 * np.round(x / 1e-6) + 0.02, force)
    return diagnose(made, base).answer


@pytest.mark.parametrize("leak_s", cases(3.0, 0.7, 40.0))
def test_a_force_that_is_forgotten_is_a_charge_that_leaks(leak_s: float) -> None:
    """It falls below zero after a release: it was partly a drift or a bias, with a late surface."""
    answer = named(leak_s)
    assert answer["class"] == [["charge_leak"]]
    found = answer["effects"][0]["parameters"]["time_constant"]["value"]
    assert found == pytest.approx(leak_s, rel=0.03)
    assert answer["error"]["after_over_floor"] < 1.03


def test_of_a_held_body_a_leak_is_a_relaxation_as_well() -> None:
    """A spring whose force is forgotten is a spring behind a damper."""
    answer = named(3.0, base="spring,viscous,bias")
    assert sorted(answer["class"]) == [["charge_leak"], ["stress_relaxation"]]


def test_a_body_that_relaxes_is_no_charge_that_leaks() -> None:
    """The force that it has forgotten does not pull after the release."""
    assert named(None, relaxing=400.0)["class"] == [["stress_relaxation"]]
