"""Recordings that hold: rounding errors and noise of a position at rest are no motion."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.samples.motion import differentiate, motion_of
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, SAMPLES = 1e-3, 8000
REST_M = 0.003815  # no sum of powers of two, so sums over a window are rounded


def pressed_and_held() -> np.ndarray:
    """Return a position that moves for half a second, and then rests exactly."""
    t = DT_S * np.arange(SAMPLES)
    return REST_M * 0.5 * (1.0 - np.cos(np.pi * np.minimum(t / 0.5, 1.0)))


def test_velocity_and_acceleration_are_zero_where_the_position_rests() -> None:
    position = pressed_and_held()
    position[600:] = REST_M
    _, v, a = differentiate(position, DT_S, 20)
    assert np.max(v) > 1e-3
    assert not np.any(v[800:])
    assert not np.any(a[800:])


def test_a_force_that_relaxes_at_rest_is_a_relaxation_although_no_damping_is_seen() -> None:
    """Steps of the force as large as its noise must not hide that the fit leaves noise alone."""
    rng = np.random.default_rng(7)
    t = DT_S * np.arange(SAMPLES)
    position = pressed_and_held()
    position[500:] = REST_M
    force = 3000.0 * position + 0.9 * (position / REST_M) * np.exp(-np.maximum(t - 0.5, 0.0) / 3.0)
    force = 0.2 * np.round((force + 0.145 * rng.normal(size=SAMPLES)) / 0.2)
    answer = diagnose(from_arrays("held", t, position, force), "kelvin-voigt").answer
    assert answer["verdict"] in {"named", "class"}
    assert ["stress_relaxation"] in answer["class"]
    assert all(abs(one["value"]) < 1e9 for one in answer["base"]["parameters"].values())


def read(position: np.ndarray, seed: int = 3) -> np.ndarray:
    """Return the position as an encoder of 5 um with a little noise reads it."""
    noise = 1e-6 * np.random.default_rng(seed).standard_normal(position.size)
    return 5e-6 * np.round((position + noise) / 5e-6)


def test_a_reading_that_changes_by_noise_is_at_rest_and_slow_motion_is_not() -> None:
    t = DT_S * np.arange(SAMPLES)
    moves = 0.01 * np.clip(t - 1.0, 0.0, 1.0)  # at 10 mm/s for a second
    creeps = 5e-5 * np.maximum(t - 5.0, 0.0)  # at 0.05 mm/s
    position = read(0.0025 / 1000 + moves + creeps)
    assert np.count_nonzero(np.diff(position[2500:5000]))
    assert np.mean(moving(position)[2500:4900]) < 0.05
    assert np.mean(moving(position)[5500:7900]) > 0.95
    assert np.all(moving(read(0.004 * np.cos(np.pi * t))))


def moving(position: np.ndarray) -> np.ndarray:
    """Return 1 for each sample at which a memory advances, 0 at rest."""
    found = motion_of(position, np.ones(SAMPLES), DT_S, 0.0, 20).moves
    return np.ones(SAMPLES) if found is None else found


def held_presses(seed: int) -> Recording:
    """Return presses that rest at either end, and Dahl friction integrated 20 times a sample.

    500 Hz; 4 kN/m and 60 N s/m from 12 mm on; 2.2 N within 40 um of way.
    """
    rng = np.random.default_rng(seed)
    fine = 1e-4 * np.arange(140_000)
    goals = np.concatenate([[0.0], rng.uniform(0.015, 0.03, 9) * (np.arange(9) % 2 == 0), [0.0]])
    x = np.zeros(fine.size)
    for number, (begun, ended) in enumerate(pairwise(goals)):
        share = np.clip((fine - 1.3 * number - 0.5) / 0.6, 0.0, 1.0)
        x += (ended - begun) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    slid, friction = np.diff(x, prepend=0.0), np.zeros(fine.size)
    for i in range(1, fine.size):
        sign = np.sign(slid[i])
        friction[i] = sign + (friction[i - 1] - sign) * np.exp(-abs(slid[i]) / 4e-5)
    depth, v = x - 0.012, np.gradient(x, 1e-4)
    force = np.where(depth > 0.0, 4000.0 * depth + 60.0 * v, 0.0) + 2.2 * friction
    force = force[::20] + 0.1 * rng.standard_normal(fine[::20].size)
    return from_arrays("presses", fine[::20], read(x[::20], seed), force)


def test_friction_keeps_its_force_at_rest() -> None:
    """It crept by the noise of the encoder, and a Stribeck effect at its bounds took that back."""
    recording = held_presses(4)
    answer = diagnose(recording).answer
    assert answer["class"] == [["coulomb_friction"]]
    found = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    assert abs(found["friction_force"] - 2.2) < 0.05
    assert abs(found["presliding_travel"] - 4e-5) < 1e-5
    error = answer["error"]["std_normalised"]["after"] * np.std(recording.force)
    assert error < 0.2  # 0.1 N is noise; the window of the derivatives blurs reversals
