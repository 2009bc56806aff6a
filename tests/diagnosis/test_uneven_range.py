"""A force channel whose range has its ends unevenly about zero, on a device that pulls as well."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.contact.effects import find
from teleop_rt.contact.effects.sensor import range_of
from teleop_rt.contact.fitted import FittedEffect
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.samples.held import is_left
from teleop_rt.diagnosis.samples.range_end import reads_an_end
from teleop_rt.estimation.corrections import Corrections
from teleop_rt.recordings.recording import Recording, from_arrays

RATE_HZ, SECONDS = 1000.0, 10.0
LAW = "on both sides, at its two ends"


def clipped(lowest: float, highest: float, late_s: float = 0.0) -> Recording:
    """Return a damped spring fixed to the tool, read late by a converter of this range [N]."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    tones = zip((3e-3, 1.5e-3, 0.8e-3), (0.37, 1.13, 2.9), rng.uniform(0.0, 6.0, 3), strict=True)
    x = np.sum([a * np.sin(2 * np.pi * f * t + p) for a, f, p in tones], axis=0)
    force = 1200.0 * x + 6.0 * np.gradient(x, t) + 0.4
    force = np.interp(t - late_s, t, force) + 0.01 * rng.standard_normal(t.size)
    return from_arrays("clipped", t, 1e-6 * np.round(x / 1e-6), np.clip(force, lowest, highest))


@pytest.mark.parametrize(("lowest", "highest"), [(-4.0, 4.9), (-9.0, 3.9)])
def test_each_end_of_the_range_is_found(lowest: float, highest: float) -> None:
    recording = clipped(lowest, highest)
    answer = diagnose(recording, "spring,viscous,bias").answer
    assert answer["class"] == [["force_saturation"]]
    found = {name: one["value"] for name, one in answer["effects"][0]["parameters"].items()}
    assert answer["effects"][0]["law"] == LAW
    assert found["highest"] == pytest.approx(highest, abs=0.01)
    if lowest > np.min(recording.force) - 0.01:
        assert found["lowest"] == pytest.approx(lowest, abs=0.01)
    else:  # it limits nothing
        assert found["lowest"] < np.min(recording.force) + 0.05


def test_a_range_and_a_late_channel_are_separate_effects() -> None:
    answer = diagnose(clipped(-4.465, 5.097, 9e-3), "spring,viscous,bias").answer
    assert answer["class"] == [["force_saturation", "channel_delay"]]
    assert answer["error"]["after_over_floor"] < 1.01


def test_the_lower_end_of_a_range_is_no_free_air() -> None:
    assert not is_left(clipped(-3.0, 9.0))
    t = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    x = 4e-3 * np.sin(2 * np.pi * 0.7 * t)
    noise = 0.01 * np.random.default_rng(3).standard_normal(t.size)
    assert is_left(from_arrays("left", t, x, 1200.0 * np.maximum(x, 0.0) + noise))
    assert is_left(from_arrays("left, in steps", t, x, 0.1 * np.round(1e4 * np.maximum(x, 0.0))))


@pytest.mark.parametrize(("offset", "is_end"), [(0.0, False), (-0.05, True)])
def test_a_body_that_goes_slack_reads_no_end_of_the_range(offset: float, is_end: bool) -> None:
    """A tape without load reads hardly any force; a channel ends elsewhere."""
    t = 2e-3 * np.arange(3000)
    x = 0.01 * np.sin(2.0 * t)
    force = np.maximum(x, 0.0) / 0.01 + offset
    force += 1e-3 * np.random.default_rng(3).standard_normal(t.size)
    assert reads_an_end(from_arrays("tape", t, x, force)) == is_end


def test_forces_at_either_end_are_left_out_on_line() -> None:
    law = find("force_saturation", LAW)
    eta = np.array([5.0, -3.0])
    assert range_of(law, eta) == (1.0, 4.0)
    corrections = Corrections([FittedEffect(law, 1.0, eta)], 1e-3, 0.01)
    counted = [force for force in (-3.0, -2.8, 0.0, 4.8, 5.0) if corrections.counts(force)]
    assert counted == [-2.8, 0.0, 4.8]
    assert corrections.masked == 2
