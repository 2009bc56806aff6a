"""Friction at the contact and a slow or late force channel: neither hides the other."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from numpy.typing import NDArray
from scipy.signal import lfilter

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

FINE_HZ, EVERY, SECONDS = 20_000, 20, 12.0
STIFFNESS, DAMPING, FRICTION_N, NOISE_N = 2000.0, 8.0, 1.2, 0.05
Row = NDArray[np.float64]


def _pressed() -> tuple[Row, Row, Row]:
    """Return time [s], position [m] and force [N] at the contact, which never pulls, finely."""
    t = np.arange(round(SECONDS * FINE_HZ)) / FINE_HZ
    x = 5e-3 + 3.6e-3 * np.sin(4.4 * t) + 2.4e-3 * np.sin(10.1 * t + 1.0)
    x += 1.5e-3 * np.sin(18.0 * t + 2.0)
    v = np.gradient(x, 1.0 / FINE_HZ)
    pushes = STIFFNESS * x + DAMPING * v + FRICTION_N * np.tanh(v / 1e-3)
    return t, x, np.where(x > 0.0, np.maximum(pushes, 0.0), 0.0)


def _diagnosed(t: Row, x: Row, read: Row) -> tuple[list[list[str]], dict[str, float]]:
    """Return the class and the sizes of its first set."""
    x, read = 1e-6 * np.round(x[::EVERY] / 1e-6), read[::EVERY]
    read = read + NOISE_N * np.random.default_rng(90).standard_normal(read.size)
    answer = diagnose(from_arrays("late", t[::EVERY], x, read)).answer
    sizes = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    return [sorted(names) for names in answer["class"]], sizes


@pytest.mark.parametrize("delay_s", cases(0.006, 0.010))
def test_friction_of_a_contact_is_found_beside_a_delay_of_the_force(delay_s: float) -> None:
    """Read late, the friction is best fitted alone by a law with presliding, without a delay."""
    t, x, force = _pressed()
    named, sizes = _diagnosed(t, x, np.interp(t - delay_s, t, force))
    assert named == [["channel_delay", "coulomb_friction"]]
    assert sizes["friction_force"] == pytest.approx(FRICTION_N, rel=0.03)
    assert sizes["lag"] == pytest.approx(delay_s, rel=0.02)


def test_friction_of_a_contact_is_found_beside_a_slow_force_channel() -> None:
    """The release, where friction ends before the depth does, is at zero force, and late."""
    t, x, force = _pressed()
    kept = np.exp(-1.0 / (FINE_HZ * 0.010))
    named, sizes = _diagnosed(t, x, lfilter([1.0 - kept], [1.0, -kept], force))
    assert named == [["coulomb_friction", "force_lag"]]
    assert sizes["friction_force"] == pytest.approx(FRICTION_N, rel=0.03)
    assert sizes["bandwidth"] == pytest.approx(1.0 / (2.0 * np.pi * 0.010), rel=0.02)
