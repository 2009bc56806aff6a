"""Derivatives, low-passes, running ranks and spline against scipy's, loaded for this alone."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from scipy import fft, interpolate, ndimage, signal

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.models.least_squares import solution, within_bounds
from teleop_rt.diagnosis.models.simulate import first_order
from teleop_rt.recordings.filters import (
    butterworth,
    fast_length,
    fast_length_within,
    gaussian,
    local_polynomial,
    running_rank,
)
from teleop_rt.recordings.recording import from_arrays
from teleop_rt.recordings.resampling import SampleTimes, bends, on_spline, resampled

ROWS = np.cumsum(np.random.default_rng(1).standard_normal((2, 3000)), axis=1)


@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize(("half", "order"), [(3, 5), (40, 5), (20, 3)])
def test_the_local_polynomial_is_that_of_savitzky_and_golay(
    half: int, order: int, derivative: int
) -> None:
    found = local_polynomial(ROWS, half, order, derivative, 0.002)
    wanted = signal.savgol_filter(ROWS, 2 * half + 1, order, deriv=derivative, delta=0.002)
    np.testing.assert_allclose(found, wanted, atol=1e-8 * np.max(np.abs(wanted)))


def test_a_window_of_a_thousand_samples_keeps_a_polynomial() -> None:
    t = 0.0005 * np.arange(3000.0)
    found = local_polynomial(t**3, 600, 5, 2, 0.0005)
    np.testing.assert_allclose(found, 6.0 * t, atol=1e-5)


def test_the_low_pass_is_a_butterworth_forward_and_backward() -> None:
    sections = signal.butter(4, 20.0, fs=500.0, output="sos")
    wanted = signal.sosfiltfilt(sections, ROWS[0])[100:-100]
    np.testing.assert_allclose(
        butterworth(ROWS[0], 20.0, 0.002)[100:-100], wanted, atol=1e-4 * np.std(wanted)
    )


def test_the_spline_of_uneven_samples_is_a_cubic_one() -> None:
    t = np.arange(3000.0) + np.random.default_rng(2).uniform(-0.3, 0.3, 3000)
    places = np.linspace(5.0, 2990.0, 7000)
    wanted = interpolate.CubicSpline(t, ROWS[0], bc_type="natural")(places)
    np.testing.assert_allclose(
        on_spline(places, t, ROWS[0], bends(t, ROWS[0])), wanted, atol=1e-9 * np.ptp(wanted)
    )


def test_the_memory_of_first_order_is_a_recursive_filter() -> None:
    wanted = signal.lfilter([0.1], [1.0, -0.9], ROWS[0], zi=[0.9 * 4.0])[0]
    np.testing.assert_allclose(first_order(ROWS[0], 0.9, 0.1, 4.0), wanted, atol=1e-9)


def test_a_step_within_bounds_is_the_least_squares_one() -> None:
    gram, right = np.array([[2.0, 1.9], [1.9, 2.0]]), np.array([1.0, 3.0])
    box = np.array([0.5, 0.5])
    free = within_bounds(gram, right, -40.0 * box, 40.0 * box)
    np.testing.assert_allclose(gram @ free, right)
    # With the second at its bound of 0.5 the first is (1 - 1.9 * 0.5) / 2.
    np.testing.assert_allclose(within_bounds(gram, right, -box, box), [0.025, 0.5])


@pytest.mark.parametrize("width", [1, 5, 101])
@pytest.mark.parametrize(
    ("share", "filtered"),
    [
        (0.0, ndimage.minimum_filter1d),
        (0.5, ndimage.median_filter),
        (0.8, lambda row, width: ndimage.percentile_filter(row, 80, width)),
        (1.0, ndimage.maximum_filter1d),
    ],
)
def test_a_running_rank_is_scipys_also_among_equal_values(
    width: int, share: float, filtered: Callable[..., Vector]
) -> None:
    row = np.round(ROWS[0, :700])
    np.testing.assert_array_equal(running_rank(row, width, share), filtered(row, width))


def test_a_gaussian_is_scipys() -> None:
    wanted = ndimage.gaussian_filter1d(ROWS[0], 4.3, mode="nearest", radius=18)
    np.testing.assert_allclose(gaussian(ROWS[0], 4.3, 18), wanted, atol=1e-9)


def test_lengths_of_fast_transforms_are_scipys() -> None:
    for size in range(1, 40_000, 37):
        assert fast_length(size) == fft.next_fast_len(size, real=True)
        assert fast_length_within(size) == fft.prev_fast_len(size, real=True)


@pytest.mark.parametrize("right", [np.array([1.0, 2.0, 3.0]), np.eye(3)])
def test_normal_equations_are_solved_also_if_a_row_is_a_sum_of_others(right: Vector) -> None:
    rows = np.random.default_rng(2).standard_normal((3, 50)) / 50.0**0.5
    gram = rows @ rows.T
    np.testing.assert_allclose(gram @ solution(gram, right), right, atol=1e-12)
    rows[2] = rows[0] + rows[1]
    gram = rows @ rows.T
    wanted = np.linalg.lstsq(gram, gram @ right, rcond=1e-11)[0]
    np.testing.assert_allclose(solution(gram, gram @ right), wanted, atol=1e-9)


def test_a_diagnosis_loads_no_scipy() -> None:
    code = (
        "import sys; import numpy as np\n"
        "from teleop_rt.diagnosis.diagnose import diagnose\n"
        "from teleop_rt.recordings.recording import from_arrays\n"
        "t = 0.004 * np.arange(2000) + 1e-5 * np.sin(np.arange(2000.0))\n"
        "x = 1e-3 * np.sin(2.0 * t) + 2e-4 * np.sin(9.0 * t)\n"
        "noise = 1e-3 * np.random.default_rng(1).standard_normal(t.size)\n"
        "force = 900.0 * x + 2.0 * np.gradient(x, t) + noise\n"
        "diagnose(from_arrays('made', t, x, force), 'spring,viscous')\n"
        "print([name for name in sys.modules if name.startswith('scipy')])\n"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_a_long_row_is_resampled_by_the_same_spline_where_its_pieces_meet() -> None:
    t = np.cumsum(0.8 + 0.4 * np.random.default_rng(7).random(250_000))
    row = np.sin(0.2 * t)
    grid = SampleTimes(float(t[0]), 1.0, int(t[-1] - t[0]))
    expected = interpolate.CubicSpline(t, row, bc_type="natural")(grid.part(slice(0, grid.size)))
    assert resampled(grid, t, row) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", [4, 5])
def test_noise_of_samples_that_nearly_coincide_is_not_taken_for_a_slope(seed: int) -> None:
    """A spline through two samples a tenth of a period apart swings to ten times their noise."""
    rng = np.random.default_rng(seed)
    grid = SampleTimes(0.0, 4e-3, 4000)
    t = grid.part(slice(0, grid.size)) + 1.8e-3 * rng.uniform(-1.0, 1.0, grid.size)
    t[0], t[-1] = 0.0, grid.period * (grid.size - 1)
    noise = resampled(grid, t, rng.standard_normal(grid.size))
    assert float(np.max(np.abs(noise))) < 5.0
    curve = resampled(grid, t, np.sin(2.0 * np.pi * 6.0 * t))
    exact = np.sin(2.0 * np.pi * 6.0 * grid.part(slice(0, grid.size)))
    assert float(np.max(np.abs(curve - exact))) < 0.02


def test_stamps_that_jitter_by_a_third_of_a_period_make_no_outliers() -> None:
    rng = np.random.default_rng(6)
    jitter = 1.5e-3 * rng.standard_normal(4500).clip(-1.25, 1.25)
    t = np.maximum.accumulate(4e-3 * np.arange(4500) + jitter)
    x = 4e-3 * np.sin(2.6 * t) + 2e-3 * np.sin(7.1 * t + 1.0)
    force = np.where(x > 0.0, 500.0 * x, 0.0) + 0.03 * rng.standard_normal(t.size)
    recording = from_arrays("stamped", t, 5e-6 * np.round(x / 5e-6), force)
    assert diagnose(recording).answer["effects"] == []
