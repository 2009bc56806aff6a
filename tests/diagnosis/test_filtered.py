"""Channels that were low-passed alike after they were read lack no effect."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.noise import whiten
from teleop_rt.diagnosis.samples import touches
from teleop_rt.diagnosis.samples.motion import position_noise, resolution_step, settling
from teleop_rt.diagnosis.samples.preparation import problem_of, without_edges
from teleop_rt.recordings.recording import Recording, from_arrays

STEP_M = 5e-6


def low_passed(row: np.ndarray, cutoff: float, rate: float) -> np.ndarray:
    """Return the row through a causal Butterworth filter of second order."""
    b, a = scipy.signal.butter(2, cutoff, fs=rate)
    start = scipy.signal.lfilter_zi(b, a) * row[0]
    return np.asarray(scipy.signal.lfilter(b, a, row, zi=start)[0])


def tapped(rate: float, cutoff: float, mass: float = 0.0, seed: int = 3) -> Recording:
    """Return taps on 3000 N/m and 30 N s/m, by a tool that lets go, both channels filtered."""
    t = np.arange(int(4 * rate)) / rate
    x = 1.5e-3 - 2.5e-3 * np.cos(2 * np.pi * 0.7 * t) + 5e-4 * np.sin(2 * np.pi * 4.1 * t)
    v, a = np.gradient(x, t), np.gradient(np.gradient(x, t), t)
    force = np.where(x > 0.0, np.maximum(3000.0 * x + 30.0 * v + mass * a, 0.0), 0.0)
    force += 0.03 * np.random.default_rng(seed).standard_normal(t.size)
    rounded = STEP_M * np.round(x / STEP_M)
    return from_arrays("r", t, *(low_passed(row, cutoff, rate) for row in (rounded, force)))


@pytest.mark.parametrize(("rate", "cutoff"), [(1000.0, 85.0), (200.0, 70.0)])
def test_contact_through_two_like_filters_is_no_lag(rate: float, cutoff: float) -> None:
    recording = tapped(rate, cutoff)
    assert diagnose(recording, surface=0.0).answer["verdict"] == "no_missing_effect"


def through_amplifiers(sticks_n: float, seed: int = 5) -> dict[str, object]:
    """Diagnose taps through one slow filter in each channel, whose position has no noise.

    The body of 2400 N/m and 12 N s/m holds the tool with `sticks_n` until 0.5 mm off.
    """
    t = np.arange(8000) / 1000.0
    x = 1.2e-3 - 3e-3 * np.cos(2 * np.pi * 0.6 * t) + 1.1e-3 * np.sin(2 * np.pi * 2.9 * t)
    force = np.where(x > 0.0, 2400.0 * x + 12.0 * np.gradient(x, t), 0.0)
    held = (x <= 0.0) & (x > -5e-4) & (np.gradient(x) < 0.0)
    force -= sticks_n * held * (1.0 + x / 5e-4)
    slow = [scipy.signal.lfilter([0.2], [1.0, -0.8], row - row[0]) + row[0] for row in (x, force)]
    slow[1] += 0.003 * np.random.default_rng(seed).standard_normal(t.size)
    recording = from_arrays("slow", t, np.round(slow[0], 8), slow[1])
    return diagnose(recording, surface=0.0).answer


def test_touches_through_slow_filters_are_left_out_and_the_answer_says_so() -> None:
    answer = through_amplifiers(0.0)
    assert answer["verdict"] == "no_missing_effect"
    assert any("20 ms around each touch" in note for note in answer["notes"])


def test_a_tool_that_is_held_at_the_surface_is_not_left_out_with_the_touches() -> None:
    assert through_amplifiers(0.4)["verdict"] != "no_missing_effect"


@pytest.mark.parametrize(("pole", "sticks_n", "known"), [(0.8, 0.0, True), (0.0, 0.4, False)])
def test_filters_are_known_about_a_touch_and_a_pull_is_not(
    pole: float, sticks_n: float, *, known: bool
) -> None:
    t = np.arange(8000) / 1000.0
    x = 1.2e-3 - 3e-3 * np.cos(2 * np.pi * 0.6 * t) + 1.1e-3 * np.sin(2 * np.pi * 2.9 * t)
    force = np.where(x > 0.0, 2400.0 * x + 12.0 * np.gradient(x, t), 0.0)
    force = force - sticks_n * ((x <= 0.0) & (x > -2e-4) & (np.gradient(x) < 0.0))
    x, force = (
        scipy.signal.lfilter([1.0 - pole], [1.0, -pole], row - row[0]) + row[0]
        for row in (x, force)
    )
    force = force + 0.003 * np.random.default_rng(5).standard_normal(t.size)
    base = base_of("kelvin-voigt")
    whole = problem_of(from_arrays("late", t, x, force), base, 0.0)
    away = without_edges(touches.spared(whole), [0.0])
    assert touches.explained_by_timing(whole, away, fit_base(away, base)) is known


@pytest.mark.parametrize(("pole", "cubic", "more"), [(0.8, 0.0, True), (0.0, 4e8, False)])
def test_a_fit_leaves_more_at_touches_through_filters_than_of_a_stiffening_body(
    pole: float, cubic: float, *, more: bool
) -> None:
    t = np.arange(8000) / 1000.0
    x = 1.2e-3 - 3e-3 * np.cos(2 * np.pi * 0.6 * t) + 1.1e-3 * np.sin(2 * np.pi * 2.9 * t)
    force = np.where(x > 0.0, 2400.0 * x + 12.0 * np.gradient(x, t) + cubic * x**3, 0.0)
    force = scipy.signal.lfilter([1.0 - pole], [1.0, -pole], force)
    force = force + 0.003 * np.random.default_rng(5).standard_normal(t.size)
    base = base_of("kelvin-voigt")
    problem = problem_of(from_arrays("late", t, x, force), base, 0.0)
    assert touches.leaves_more(problem, fit_base(problem, base)) is more


def test_a_filtered_encoder_still_shows_its_step() -> None:
    t = np.arange(6000) * 1e-3
    x = 4e-3 * np.sin(2 * np.pi * 0.9 * t) + 1e-3 * np.sin(2 * np.pi * 3.3 * t)
    read = STEP_M * np.round(x / STEP_M)
    assert resolution_step(read, 1e-3) == pytest.approx(STEP_M)
    filtered = low_passed(read, 100.0, 1000.0)
    assert STEP_M / 2 < resolution_step(filtered, 1e-3) < 2 * STEP_M
    assert settling(read, 1e-3) == 0
    assert 2 <= settling(filtered, 1e-3) <= 8


@pytest.mark.parametrize("tone_hz", [3.0, 15.0, 40.0])
def test_motion_is_not_taken_for_noise_of_the_position(tone_hz: float) -> None:
    t = np.arange(6000) * 1e-3
    noise = 1e-6 * np.random.default_rng(2).standard_normal(t.size)
    found = position_noise(1e-3 * np.sin(2 * np.pi * tone_hz * t) + noise, 1e-3)
    assert found == pytest.approx(1e-6, rel=0.3)


def test_a_delay_is_not_named_for_smoothing_the_encoder() -> None:
    """A heavy tool behind a coarse encoder: a model without mass passes less of its steps on."""
    recording = tapped(200.0, 70.0, mass=1.5)
    answer = diagnose(recording, "mass-spring-damper", surface=0.0).answer
    assert answer["verdict"] == "no_missing_effect"


@pytest.mark.parametrize("dt", [1e-3, 5e-4])
def test_four_milliseconds_left_out_let_no_slow_force_through_at_any_rate(dt: float) -> None:
    t = np.arange(0.0, 4.0, dt)
    mask = np.ones(t.size)
    for start in np.arange(0.3, 3.7, 0.4):
        first = round(start / dt)
        mask[first : first + round(4e-3 / dt)] = 0.0
    whitener = whiten.white(mask, 1.0, dt)
    slow = np.sin(2 * np.pi * t)[None, :]
    fast = round(50.0 * 4.0)
    leaked = np.abs(whitener.spectra(slow))[0, fast:]
    by_zeros = np.abs(np.fft.rfft(slow * mask))[0, fast : whitener.bins]
    assert np.mean(leaked**2) < 0.01 * np.mean(by_zeros**2)
