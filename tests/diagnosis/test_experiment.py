"""The motion that is proposed keeps to what the rig may do, and asks nothing sudden of it."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.diagnosis.experiment import profiles

RATE_HZ = 500.0
DEPTH_M, HEIGHT_M = 0.01, 0.003


@pytest.mark.parametrize("name", list(profiles(DEPTH_M, HEIGHT_M)))
def test_a_profile_keeps_to_its_stroke_without_a_corner(name: str) -> None:
    x = profiles(DEPTH_M, HEIGHT_M)[name]
    assert np.min(x) > -1.01 * HEIGHT_M
    assert np.max(x) < 1.15 * DEPTH_M
    tapered = (x - np.mean(x)) * np.hanning(x.size)
    power = np.abs(np.fft.rfft(tapered)) ** 2
    fast = np.fft.rfftfreq(x.size, 1.0 / RATE_HZ) > 40.0
    assert np.sum(power[fast]) < 1e-7 * np.sum(power)
