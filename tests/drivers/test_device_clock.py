from __future__ import annotations

import numpy as np
import pytest

from teleop_rt_drivers.device_clock import DeviceClock

MS = 1_000_000


def run(clock: DeviceClock, *, ppm: float, jitter_ns: float, outliers=0, samples=6000):
    """Count microseconds on a clock that is `ppm` fast; return the errors of the mapped times."""
    random = np.random.default_rng(1)
    late = set(random.choice(np.arange(100, samples), outliers, replace=False).tolist())
    errors = []
    for k in range(samples):
        true_ns = 10**12 + k * MS
        count = (int(k * 1000 * (1 + ppm * 1e-6)) + 2**32 - 2_000_000) % 2**32
        arrival = true_ns + abs(random.normal(0, jitter_ns)) + (5 * MS if k in late else 0)
        errors.append(clock.update(count, int(arrival)) - true_ns)
    return np.array(errors[1000:])


@pytest.mark.parametrize("ppm", [-200.0, 0.0, 80.0])
def test_drift_is_followed_through_the_counters_overflow(ppm):
    clock = DeviceClock(1e-6, 32)
    errors = run(clock, ppm=ppm, jitter_ns=50_000)
    assert clock.drift_ppm == pytest.approx(-ppm, abs=5.0)
    assert clock.outliers < 40
    # The mean delay (half-normal, 40 us) stays; its variation (30 us) is averaged.
    assert np.mean(errors) == pytest.approx(40_000, abs=8_000)
    assert np.std(errors) < 8_000


def test_outliers_are_counted_and_do_not_move_the_line():
    clock = DeviceClock(1e-6, 32)
    errors = run(clock, ppm=30.0, jitter_ns=20_000, outliers=200)
    assert clock.outliers >= 200
    assert np.max(np.abs(errors - np.mean(errors))) < 30_000


def test_a_clock_that_was_set_is_learned_anew():
    clock = DeviceClock(1e-6, 32)
    for k in range(500):
        clock.update(k * 1000, 10**12 + k * MS)
    mapped = [clock.update(10**9 + k * 1000, 10**12 + (500 + k) * MS) for k in range(200)]
    assert mapped[-1] == pytest.approx(10**12 + 699 * MS, abs=100_000)


def test_numbers_stay_finite_for_ever():
    clock = DeviceClock(1e-3, 8)
    for k in range(200_000):
        clock.update(k % 256, 10**12 + k * MS)
    assert clock.drift_ppm == pytest.approx(0.0, abs=0.1)
    assert clock.deviation_ns < 1.0


def test_a_clock_of_64_bits_is_followed_through_its_sign_and_its_overflow():
    for start in (2**63 - 300_000, 2**64 - 300_000):  # half of the samples come before the edge
        clock = DeviceClock(1e-6, 64)
        mapped = [clock.update((start + k * 1000) % 2**64, 10**12 + k * MS) for k in range(600)]
        assert mapped == pytest.approx([10**12 + k * MS for k in range(600)], abs=1_000)
        assert clock.samples == 600
        assert clock.outliers == 0
        assert clock.drift_ppm == pytest.approx(0.0, abs=0.1)


def test_what_a_field_holds_beside_a_clock_of_64_bits_is_left_out():
    clock = DeviceClock(1e-6, 64)
    assert clock.word(2**64 + 5) == 5
    assert clock.word(2**63) == -(2**63)
    assert clock.word(2**64 - 1) == -1
