"""A long recording is resampled piece by piece: no seam shows."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.recordings.recording import from_arrays


def test_a_gap_is_counted_and_bridged_in_a_long_recording_wherever_it_lies() -> None:
    lost = [40_000, 99_999, 100_000, 200_000]
    t = np.arange(250_000) * 1e-3
    x, f = np.sin(3.0 * t), np.cos(3.0 * t)
    there = np.ones(t.size, dtype=np.bool_)
    there[lost] = False
    found = from_arrays("long", t[there], x[there], f[there])
    assert np.flatnonzero(found.mask == 0.0).tolist() == lost
    assert found.position == pytest.approx(x, abs=1e-5)
    assert found.force == pytest.approx(f, abs=1e-5)


def test_a_recording_does_not_change_with_the_arrays_it_was_made_of() -> None:
    t = np.arange(1000) * 1e-3
    x, f = np.sin(3.0 * t), np.cos(3.0 * t)
    found = from_arrays("made", t, x, f)
    position, force = found.position.copy(), found.force.copy()
    x[:] = f[:] = 0.0
    assert np.array_equal(found.position, position)
    assert np.array_equal(found.force, force)


def test_ticks_of_a_long_jittering_clock_are_found_to_the_millionth() -> None:
    period, count = 1.000_03e-3, 250_000
    ticks = np.arange(count)
    jitter = 0.1e-3 * np.random.default_rng(8).standard_normal(count).clip(-3.0, 3.0)
    x, f = np.sin(3e-3 * ticks), np.cos(3e-3 * ticks)
    found = from_arrays("jitter", period * ticks + jitter, x, f)
    assert found.dt == pytest.approx(period, rel=1e-7)
    assert found.position == pytest.approx(x, abs=1e-4)
