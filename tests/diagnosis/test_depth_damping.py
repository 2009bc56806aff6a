"""Damping by depth and drag, and a spring that pulls the axis, beside a body in contact."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, SAMPLES = 1e-3, 8000
STIFFNESS_N_PER_M, DAMPING_N_S_PER_M, NOISE_N = 3000.0, 6.0, 0.01


def pressed(seed: int, law: str) -> Recording:
    """Return 8 s of presses from free air on a body with damping by depth, or beside a spring."""
    rng = np.random.default_rng(seed)
    t = DT_S * np.arange(SAMPLES)
    x, v = np.full(SAMPLES, 2e-3), np.zeros(SAMPLES)
    for frequency_hz, size_m in ((0.43, 3e-3), (1.7, 1.5e-3), (4.1, 0.5e-3)):
        w, phase = 2.0 * np.pi * frequency_hz, rng.uniform(0.0, 2.0 * np.pi)
        x += size_m * np.sin(w * t + phase)
        v += size_m * w * np.cos(w * t + phase)
    touching, depth = x > 0.0, np.maximum(x, 0.0)
    force = STIFFNESS_N_PER_M * depth + DAMPING_N_S_PER_M * v * touching
    if law == "depth":
        force += 40.0 * (depth / 7e-3) ** 1.4 * v
    elif law == "spring":
        force += 300.0 * (x + 0.012)
    elif law == "drag":
        force += 60.0 * v * np.abs(v)
    return from_arrays(law, t, x + 0.03, force + NOISE_N * rng.normal(size=SAMPLES))


@pytest.mark.parametrize("seed", cases(4, 5))
def test_damping_that_grows_with_the_depth_is_named_after_hunt_and_crossley(seed: int) -> None:
    answer = diagnose(pressed(seed, "depth")).answer
    assert answer["class"] == [["hunt_crossley"]]
    assert answer["effects"][0]["parameters"]["power"]["value"] == pytest.approx(1.4, abs=0.2)


def test_a_spring_of_the_axis_shows_in_free_air_beside_the_body() -> None:
    answer = diagnose(pressed(4, "spring")).answer
    assert answer["class"][0] == ["return_spring"]
    (effect,) = answer["effects"]
    assert effect["parameters"]["spring_stiffness"]["value"] == pytest.approx(300.0, rel=0.03)


def test_a_damping_that_does_not_grow_is_the_base_and_nothing_is_missing() -> None:
    assert diagnose(pressed(4, "even")).answer["verdict"] == "no_missing_effect"


@pytest.mark.parametrize("seed", [4, 5])
def test_a_drag_that_free_air_shows_as_well_is_named_with_its_size(seed: int) -> None:
    answer = diagnose(pressed(seed, "drag")).answer
    assert answer["class"] == [["quadratic_damping"]]
    (effect,) = answer["effects"]
    assert effect["law"] == "in air and contact"
    assert effect["parameters"]["quadratic_damping"]["value"] == pytest.approx(60.0, rel=0.05)
