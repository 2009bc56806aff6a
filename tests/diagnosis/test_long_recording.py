"""A long recording is resampled piece by piece: no seam shows."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.diagnosis.recordings.recording import from_arrays


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
