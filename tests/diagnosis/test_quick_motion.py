"""Moments in which the tool moves faster than the window of the derivatives can follow."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.samples.smoothing import half_window, too_quick
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, STEP_M, SECONDS = 0.001, 5e-6, 12.0
_T = DT_S * np.arange(int(SECONDS / DT_S))
K_N_PER_M, B_N_S_PER_M, NOISE_N = 1500.0, 60.0, 0.03


def _jerked(places_s: tuple[float, ...], size_m: float = 3e-4) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity of presses; at each place the tool springs back and rings."""
    x = 6e-3 * np.sin(2.0 * np.pi * 0.5 * _T) - 1e-3
    x += 1e-3 * np.sin(2.0 * np.pi * 1.7 * _T)
    v = 6e-3 * np.pi * np.cos(np.pi * _T) + 3.4e-3 * np.pi * np.cos(3.4 * np.pi * _T)
    pulse, rate = 2.0 * np.pi * 120.0, 150.0  # 1/s
    for place in places_s:
        late = np.maximum(_T - place, 0.0)
        decay = size_m * np.exp(-rate * late)
        x -= decay * np.sin(pulse * late)
        v -= decay * (pulse * np.cos(pulse * late) - rate * np.sin(pulse * late)) * (place <= _T)
    return x, v


def _recorded(places_s: tuple[float, ...], seed: int) -> Recording:
    x, v = _jerked(places_s)
    force = np.where(x > 0.0, K_N_PER_M * x + B_N_S_PER_M * v, 0.0)
    force += NOISE_N * np.random.default_rng(seed).standard_normal(_T.size)
    return from_arrays("made", _T, STEP_M * np.round(x / STEP_M), force)


@pytest.mark.parametrize("seed", cases(1, 2, 3))
def test_a_tool_that_springs_back_twice_leaves_nothing_missing(seed: int) -> None:
    answer = diagnose(_recorded((2.45, 6.55), seed), surface=0.0).answer
    assert answer["verdict"] == "no_missing_effect"
    assert answer["base"]["parameters"]["b"]["value"] == pytest.approx(B_N_S_PER_M, rel=0.01)
    assert any("left out (2 moments, the first at 2.4" in note for note in answer["notes"])


def test_only_the_moments_that_the_window_cannot_follow_are_left_out() -> None:
    position = _recorded((2.45, 6.55), 1).position
    half = half_window(position, DT_S)
    found = too_quick(position, DT_S, half)
    for place in (2.45, 6.55):
        assert found[round(place / DT_S)] == 1.0
    near = np.min(np.abs(_T[found > 0.0, None] - np.array([2.45, 6.55])), axis=1)
    assert 0.0 < np.max(near) < 0.05
    assert not np.any(too_quick(_recorded((), 1).position, DT_S, half))


def test_a_motion_that_is_quick_all_along_is_used_as_it_is() -> None:
    position = _recorded(tuple(np.arange(0.1, SECONDS, 0.2).tolist()), 1).position
    assert not np.any(too_quick(position, DT_S, 10))
