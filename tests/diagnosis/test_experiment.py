"""The motion that is proposed keeps to the rig's limits, and asks nothing sudden of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from teleop_rt.diagnosis.answers.experiment import profiles
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.motions import RATE_HZ as FINE_HZ
from teleop_rt_dev.diagnosis.plants import make

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


def test_a_surface_that_swings_is_not_taken_for_one_that_lies_elsewhere_after_the_tapping() -> None:
    """Taps at one rate meet a surface that swings at that rate at the same place each time."""
    truth = make(940106780, ("contact_offset",), "stiff", "sinusoid", 0.149, 0.00183)
    recording = from_arrays("tone", truth.t, truth.position, truth.force)
    first = diagnose(recording, truth.base, surface=0.0)
    assert ["moving_surface"] in first.answer["class"]
    motion = first.experiment
    path = CubicSpline(motion.t, motion.x)(np.arange(round(motion.t[-1] * FINE_HZ)) / FINE_HZ)
    moved = make(940106780, ("contact_offset",), "stiff", "sinusoid", 0.149, 0.00183, path=path)
    again = from_arrays("again", moved.t, moved.position, moved.force)
    assert diagnose(again, truth.base, surface=0.0).answer["class"] == [["contact_offset"]]
