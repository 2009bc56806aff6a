"""Ripples along the stroke with a second harmonic, as encoders and motors have them."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

DT_S = 2e-3
PITCH_M, RATIO, ANGLE_RAD = 1.3e-3, 0.35, 0.7


def wave(place_m: np.ndarray) -> np.ndarray:
    """Return a wave of unit size along the stroke, with a second harmonic of a third of it."""
    turned = 2.0 * np.pi * place_m / PITCH_M
    return np.sin(turned + 0.4) + RATIO * np.sin(2.0 * turned + ANGLE_RAD)


def stroke() -> tuple[np.ndarray, np.ndarray]:
    """Return time [s] and read position [m] of 6 s in and out of a body."""
    t = DT_S * np.arange(3000)
    return t, 4e-3 + 4e-3 * np.sin(4.4 * t) + 2e-3 * np.sin(11.9 * t + 1.0)


def body(x: np.ndarray) -> np.ndarray:
    """Return the force [N] of a spring and a damper, with noise, at a true position [m]."""
    force = np.where(x > 0.0, np.maximum(2500.0 * x + 15.0 * np.gradient(x, DT_S), 0.0), 0.0)
    return force + 0.03 * np.random.default_rng(11).normal(size=x.size)


@pytest.mark.parametrize("where", ["encoder", "motor"])
def test_a_ripple_with_a_second_harmonic_is_named_with_its_pitch_and_ratio(where: str) -> None:
    t, read = stroke()
    of_encoder = where == "encoder"
    force = body(read + 4e-5 * wave(read) * of_encoder) + 0.3 * wave(read) * (not of_encoder)
    answer = diagnose(from_arrays(where, t, read, force), surface=0.0).answer
    assert answer["class"] == [["position_ripple"]]
    found = {name: row["value"] for name, row in answer["effects"][0]["parameters"].items()}
    assert found["pitch"] == pytest.approx(PITCH_M, rel=0.01)
    ratio = np.hypot(found["second_sine"], found["second_cosine"])
    assert ratio == pytest.approx(RATIO, abs=0.05)
    assert answer["error"]["after_over_floor"] < 1.05
