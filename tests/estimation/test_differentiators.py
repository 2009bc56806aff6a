"""Each differentiator has the lag and the noise gain that it states, and keeps y and phi alike."""

import dataclasses

import numpy as np
import pytest
import scipy

from teleop_rt.estimation.filters import (
    RATE,
    VALUE,
    adaptive_windowing,
    advance_channel,
    design,
    longest_line,
    push,
    start_channel,
    window_channel,
)
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for
from teleop_rt_dev.estimation.plant import Press, hunt_crossley, kelvin_voigt, record

from .test_pipeline import SETTINGS

T = 1e-3


def filtered(kind, signal, resolution=1e-9, cutoff=60.0):
    one = design(kind, cutoff, T)
    channel, ring = np.zeros(4), np.zeros(129)
    start_channel(channel, ring, 2 * one.window + 1, signal[0])
    out = []
    for u in signal:
        if one.window:
            push(ring, 2 * one.window + 1, u)
            n = longest_line(ring, one.window, resolution)
            window_channel(channel, ring, n, T)
        else:
            advance_channel(channel, u, one.transition, one.gain_before, one.gain_now)
        out.append(channel[:3].copy())
    return np.array(out)


@pytest.mark.parametrize("kind", ["svf", "kalman", "foaw"])
def test_a_ramp_comes_out_with_the_stated_lag_and_its_slope(kind):
    t = np.arange(1000) * T
    out = filtered(kind, 0.3 * t)
    lag = design(kind, 60.0, T).lag_s
    assert out[-1, VALUE] == pytest.approx(0.3 * (t[-1] - lag), abs=1e-9)
    assert out[-1, RATE] == pytest.approx(0.3, rel=1e-6)


@pytest.mark.parametrize("kind", ["svf", "kalman", "foaw"])
def test_white_noise_comes_out_with_the_stated_gain(kind):
    noise = np.random.default_rng(0).normal(size=60_000)
    one = design(kind, 60.0, T)
    # Within the noise as resolution FOAW keeps its longest window.
    out = filtered(kind, noise, resolution=1e3)
    assert np.std(out[1000:, RATE]) == pytest.approx(one.velocity_noise_gain, rel=0.03)
    assert np.std(out[1000:, 2]) == pytest.approx(one.acceleration_noise_gain, rel=0.03)


@pytest.mark.parametrize("kind", ["svf", "foaw"])
def test_value_and_rate_are_alike_so_that_a_linear_law_survives(kind):
    """F[k x + b v] equals k F[x] + b F[v], where v is the derivative that was never measured."""
    t = np.arange(3000) * T
    w = 2 * np.pi * 8
    x, v = np.sin(w * t), w * np.cos(w * t)
    wanted = filtered(kind, 3600 * x + 20 * v, resolution=1e9)
    made = filtered(kind, x, resolution=1e9)
    difference = wanted[500:, VALUE] - 3600 * made[500:, VALUE] - 20 * made[500:, RATE]
    assert np.max(np.abs(difference)) < 1e-3 * np.max(np.abs(wanted))


@pytest.mark.parametrize("cutoff_hz", [1.0, 40.0, 160.0, 333.0])
def test_the_state_variable_filter_is_discretised_exactly(cutoff_hz):
    w = 2 * np.pi * cutoff_hz
    held_s, per_s = 1e-3, w ** np.arange(3)
    system = np.zeros((5, 5))
    system[:3, :3] = [[0, 1, 0], [0, 0, 1], [-(w**3), -2 * w * w, -2 * w]]
    system[2, 3], system[3, 4] = w**3, 1 / held_s
    exact = scipy.linalg.expm(system * held_s)[:3]
    found = design("svf", cutoff_hz, held_s)
    scaled = found.transition / per_s[:, None] * per_s
    assert scaled == pytest.approx(exact[:, :3] / per_s[:, None] * per_s, abs=1e-12)
    assert found.gain_now / per_s == pytest.approx(exact[:, 4] / per_s, abs=1e-12)
    before = (exact[:, 3] - exact[:, 4]) / per_s
    assert found.gain_before / per_s == pytest.approx(before, abs=1e-12)


def test_foaw_shortens_its_window_where_the_motion_turns():
    ring = np.concatenate([np.arange(5.0), 4.0 - np.arange(1.0, 20.0)])
    assert longest_line(ring, 16, 0.1) <= 6
    assert longest_line(np.arange(40.0), 16, 0.1) == 16
    assert adaptive_windowing(60.0, T).window >= 2


@pytest.mark.parametrize("kind", ["svf", "kalman", "foaw"])
def test_silicone_is_found_with_each(kind):
    settings = dataclasses.replace(SETTINGS, differentiator=kind)
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), settings)
    pipeline.run(*record(Press(), kelvin_voigt))
    _, (k, b), _ = pipeline.estimate(0)
    assert k == pytest.approx(3600, rel=0.005)
    assert b == pytest.approx(20, rel=0.05)


def test_filtering_the_regressors_does_not_bias_hunt_crossley_damping():
    """With x and f filtered instead at 10 Hz, b = 500 would come out 70 % too large."""
    settings = dataclasses.replace(SETTINGS, cutoff_hz=10.0, surface=Press().surface)
    pipeline = Pipeline(rows_for(["hunt-crossley"], ["direct"], ["rls"]), settings)
    pipeline.run(*record(Press(duration=8.0, lift_every=100.0), hunt_crossley))
    _, (_, b, n), _ = pipeline.estimate(0)
    assert b == pytest.approx(500, rel=0.03)
    assert n == pytest.approx(1.5, abs=0.005)


@pytest.mark.parametrize("cutoff", [0.0, 400.0])
def test_impossible_cutoffs_are_refused(cutoff):
    with pytest.raises(ValueError, match="cutoff"):
        design("svf", cutoff, T)
