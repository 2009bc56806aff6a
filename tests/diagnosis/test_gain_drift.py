"""A force channel whose gain drifts, as of an amplifier that warms."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

DT_S, SECONDS, STIFFNESS, NOISE_N = 2e-3, 16.0, 1500.0, 0.04


def classes(
    gain: float, *, damping: float = 10.0, stiffness_lost: float = 0.0, friction_N: float = 0.0
) -> tuple[list[list[str]], dict[str, float]]:
    """Return the class, and the sizes of its first set; the gain changes from 1 within 16 s."""
    t = DT_S * np.arange(round(SECONDS / DT_S))
    x = 1e-3 + 3e-3 * np.sin(3.3 * t) + 1.6e-3 * np.sin(7.9 * t + 1.0) + 6e-4 * np.sin(19.0 * t)
    v = np.gradient(x, DT_S)
    stiffness = STIFFNESS * (1.0 - stiffness_lost * t / SECONDS)
    force = np.where(x > 0.0, np.maximum(stiffness * x + damping * v, 0.0), 0.0)
    force = (force + friction_N * np.tanh(v / 1e-3)) * (1.0 + gain * t / SECONDS)
    force += NOISE_N * np.random.default_rng(21).standard_normal(t.size)
    answer = diagnose(from_arrays("warm", t, 1e-6 * np.round(x / 1e-6) + 0.01, force)).answer
    sizes = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    return [sorted(names) for names in answer["class"]], sizes


@pytest.mark.parametrize("gain", cases(-0.12, 0.12))
def test_a_gain_that_drifts_may_be_a_body_that_softens_as_a_whole(gain: float) -> None:
    """One force has two causes; a weight on the sensor before and after would distinguish them."""
    assert sorted(classes(gain)[0]) == [["gain_drift"], ["softening"]]


def test_friction_in_free_air_shows_that_the_gain_drifts() -> None:
    named, sizes = classes(-0.3, friction_N=0.8)
    assert named == [["coulomb_friction", "gain_drift"]]
    drifted = sizes["gain_change"] * (1.0 - np.exp(-SECONDS / sizes["time_constant"]))
    assert drifted == pytest.approx(-0.3, abs=0.02)


def test_a_body_whose_stiffness_alone_falls_is_no_gain_that_drifts() -> None:
    assert classes(0.0, damping=40.0, stiffness_lost=0.15)[0] == [["softening"]]
