"""Isolated samples: a channel's own faults know nothing of the motion."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from teleop_rt.diagnosis.answers.outliers import chance_of_one_source, effect_of, of_motion
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.diagnosis.samples.outliers import outliers
from teleop_rt.diagnosis.samples.preparation import lone_samples, pose
from teleop_rt.recordings.recording import from_arrays
from teleop_rt.recordings.rows import force_noise, lone


def moved() -> RecordedMotion:
    t = np.arange(8000) * 1e-3
    w = 2.0 * np.pi * 1.3
    return RecordedMotion(t, np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t), 1e-3)


def test_samples_at_every_reversal_come_with_the_motion_and_scattered_ones_do_not() -> None:
    motion = moved()
    blows = np.zeros(motion.t.size)
    blows[np.flatnonzero(np.diff(np.sign(motion.v))) + 2] = 1.0
    assert of_motion(blows, motion)
    for seed in range(20):
        scattered = (np.random.default_rng(seed).random(motion.t.size) < 0.004).astype(float)
        assert not of_motion(scattered, motion)


def test_bursts_at_any_place_do_not_follow_the_motion() -> None:
    """Counted sample by sample, 63 of 400 such recordings had bursts that follow the motion."""
    t = 1e-3 * np.arange(9000)
    w = 2.0 * np.pi * 0.2
    motion = RecordedMotion(t, np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t), 1e-3)
    following = 0
    for seed in range(400):
        firsts = np.random.default_rng(seed).choice(t.size - 3, 27, replace=False)
        found = np.zeros(t.size)
        for later in range(3):
            found[firsts + later] = 1.0
        following += of_motion(found, motion)
    assert following <= 5  # by chance 1.6, and more than 5 once in 160


@pytest.mark.parametrize(("few", "apart"), [(3, 9.0), (5, 1.5), (20, 1.0), (300, 0.25)])
def test_the_chance_of_one_source_is_kolmogorovs(few: int, apart: float) -> None:
    rng = np.random.default_rng(few)
    some, others = rng.normal(apart, 1.0, few), rng.normal(0.0, 1.0, 9000)
    wanted = scipy.stats.ks_2samp(some, others, method="asymp").pvalue
    assert chance_of_one_source(some, others) == pytest.approx(wanted, rel=1e-3, abs=1e-12)


def pressed(dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return penetration [m] and force [N] of 8 s on a spring of 3 kN/m, with noise of 0.05 N."""
    t = dt * np.arange(round(8.0 / dt))
    depth = 0.005 + 0.004 * np.sin(2.0 * np.pi * 1.3 * t)
    return depth, 3000.0 * depth + 0.05 * np.random.default_rng(7).normal(size=t.size)


def test_bursts_of_wrong_samples_are_found_whole_and_a_pulse_of_20_ms_is_none() -> None:
    dt = 2e-3
    depth, force = pressed(dt)
    wrong = np.zeros(force.size)
    for number, first in enumerate(range(200, 3800, 300)):
        wrong[first : first + 1 + number % 4] = 1.0
    found = outliers(force + 2.0 * wrong, depth, 0.05, dt)
    assert np.array_equal(found, wrong)
    pulse = np.zeros(force.size)
    pulse[1000:1010] = 2.0
    assert not outliers(force + pulse, depth, 0.05, dt).any()


def test_at_100_hz_only_single_samples_are_wrong_because_two_are_a_motion() -> None:
    depth, force = pressed(1e-2)
    wrong = np.zeros(force.size)
    wrong[[100, 300, 301]] = 1.0
    found = outliers(force + 20.0 * wrong, depth, 0.05, 1e-2)
    assert np.flatnonzero(found).tolist() == [100]


@pytest.mark.parametrize("frequency_hz", [12.0, 33.0, 57.8, 71.4, 100.0, 110.0, 143.0, 200.0])
def test_the_peaks_of_a_tone_are_no_outliers(frequency_hz: float) -> None:
    depth, force = pressed(2e-3)
    force += 1.0 * np.sin(2.0 * np.pi * frequency_hz * 2e-3 * np.arange(force.size))
    assert not outliers(force, depth, 0.05, 2e-3).any()


def test_one_burst_is_an_event_and_three_are_an_effect_of_the_channel() -> None:
    found = np.zeros(8000)
    found[1000:1004] = 1.0
    assert effect_of(found) is None
    found[[3000, 6000]] = 1.0
    assert effect_of(found) is not None


def test_neither_filtered_nor_clipped_noise_holds_outliers() -> None:
    depth, _ = pressed(1e-3)
    white = np.random.default_rng(3).normal(size=depth.size)
    filtered = scipy.signal.lfilter(*scipy.signal.butter(2, 0.25), white)
    force = 3000.0 * depth
    assert not outliers(force + filtered, depth, force_noise(force + filtered), 1e-3).any()
    clipped = np.minimum(force + white, np.quantile(force, 0.4))
    assert not outliers(clipped, depth, force_noise(clipped), 1e-3).any()


def test_wrong_samples_beside_a_touch_and_beside_one_another_are_found() -> None:
    t = 1e-3 * np.arange(4000)
    depth = 0.004 * np.sin(2.0 * np.pi * 1.3 * t)
    force = np.maximum(3000.0 * depth, 0.0) + 0.05 * np.random.default_rng(7).normal(size=t.size)
    wrong = np.zeros(t.size)
    touch = int(np.flatnonzero((depth[1:] <= 0.0) & (depth[:-1] > 0.0))[0])
    wrong[touch + 3], wrong[1000], wrong[1002] = 20.0, 20.0, -20.0
    assert np.array_equal(outliers(force + wrong, depth, 0.05, 1e-3), (wrong != 0.0).astype(float))


def test_the_force_of_fast_reversals_of_the_tool_holds_no_outliers() -> None:
    t = 1e-3 * np.arange(8000)
    steps = np.sign(np.sin(2.0 * np.pi * 2.3 * t) + np.sin(2.0 * np.pi * 3.7 * t))
    moved = scipy.signal.lfilter(*scipy.signal.cheby1(2, 6.0, 0.15), 3e-3 * steps)  # it rings
    depth = 5e-3 + moved
    force = 3000.0 * depth + 20.0 * np.gradient(depth, 1e-3)
    force += 0.05 * np.random.default_rng(7).normal(size=t.size)
    assert not outliers(force, depth, force_noise(force), 1e-3).any()


def test_every_slip_in_a_long_recording_is_seen_wherever_it_lies() -> None:
    row = np.sin(2e-3 * np.arange(300_000))
    slips = [2, 50_000, 99_998, 100_001, 100_004, 199_999, 200_002, 200_005, 299_997]
    row[slips] += 5.0
    assert np.flatnonzero(lone(row)).tolist() == slips


def test_a_row_without_two_neighbours_on_either_side_has_no_slip() -> None:
    assert not lone(np.array([0.0, 0.0, 9.0, 0.0])).any()
    assert lone(np.array([0.0, 0.0, 9.0, 0.0, 0.0])).tolist() == [False, False, True, False, False]


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_outliers_in_a_quick_force_and_side_by_side_are_all_left_out(seed: int) -> None:
    dt, rng = 4e-3, np.random.default_rng(seed)
    t = dt * np.arange(3500)
    phase = 2.0 * np.pi * (0.2 * t + 0.5 * 3.0 / 14.0 * t**2)  # to 3 Hz
    x = 6e-4 * np.sin(phase) + 3e-4
    v = 6e-4 * np.cos(phase) * 2.0 * np.pi * (0.2 + 3.0 / 14.0 * t)
    force = np.where(x > 0.0, np.maximum(1.46e4 * x + 60.0 * v, 0.0), 0.0)
    force += 0.05 * rng.standard_normal(t.size)
    alone = rng.choice(np.arange(20, t.size - 20, 12), 30, replace=False)
    alone = np.concatenate((alone, alone[:4] + 5))  # four pairs close together
    force[alone] += rng.choice([-1.0, 1.0], alone.size) * rng.uniform(4.0, 8.0, alone.size)
    answer = diagnose(from_arrays("made", t, 1e-6 * np.round(x / 1e-6), force), surface=0.0).answer
    assert answer["class"] == [["outliers"]]


def test_several_wrong_samples_close_together_are_all_found() -> None:
    """The smaller ones of three within 30 ms stayed: the answer was "unexplained"."""
    depth, force = pressed(2e-3)
    rng = np.random.default_rng(3)
    for first in range(300, 3800, 350):
        force[first] += 8.0 * rng.choice([-1.0, 1.0])
        force[[first + 120, first + 128, first + 130]] -= [6.0, 3.3, 6.9]
    recording = from_arrays("loose", 2e-3 * np.arange(force.size), depth, force)
    answer = diagnose(recording, "spring,viscous,bias").answer
    assert answer["class"] == [["outliers"]]
    assert answer["effects"][0]["parameters"]["share"]["value"] == pytest.approx(0.01, rel=1e-6)
    assert answer["error"]["after_over_floor"] < 1.05


def test_wrong_samples_one_good_one_apart_are_found_though_either_hides_the_other() -> None:
    depth, force = pressed(2e-3)
    wrong = np.zeros(force.size)
    for first in range(300, 3800, 350):
        wrong[[first, first + 2]] = -14.0, -10.0
    assert np.array_equal(outliers(force + wrong, depth, 0.05, 2e-3) > 0.0, wrong != 0.0)


def test_runs_of_the_reading_of_a_dead_channel_are_left_out_and_named() -> None:
    """Such runs, of 2 to 24 ms and side by side, left 19 times the noise: "unexplained"."""
    depth, force = pressed(2e-3)
    dead = np.zeros(force.size)
    for number, first in enumerate(range(200, 3800, 120)):
        dead[first : first + 1 + number % 12] = 1.0
        dead[first + 14 : first + 14 + number % 3] = 1.0
    recording = from_arrays("dead", 2e-3 * np.arange(force.size), depth, force * (1.0 - dead))
    assert np.array_equal(outliers(recording.force, depth, 0.05, 2e-3), dead)
    answer = diagnose(recording, "spring,viscous,bias").answer
    assert answer["class"] == [["outliers"]]
    assert answer["error"]["after_over_floor"] < 1.05


def test_neither_a_limit_nor_a_bouncing_tool_gives_the_reading_of_a_dead_channel() -> None:
    """Both hold one reading many times: the force reaches it in steps, or at a touch."""
    depth, force = pressed(2e-3)
    assert not outliers(np.clip(force, 6.0, 20.0), depth, 0.05, 2e-3).any()
    bounces = np.zeros(force.size, dtype=bool)
    for first in range(200, 3800, 120):
        bounces[first : first + 9] = True
    left = np.where(bounces, -1e-5, depth)
    assert not outliers(np.where(bounces, 0.0, force), left, 0.05, 2e-3).any()


def test_what_a_struck_mass_leaves_in_a_residual_is_no_outlier() -> None:
    """Its force swings for some samples, with a pair of them far from the next ones."""
    depth, force = pressed(2e-3)
    wrong = np.zeros(force.size)
    wrong[[500, 1500, 2500, 3500]] = 9.0
    struck = [20.0, 19.6, 12.5, 16.3, 10.7, 17.0, 18.8, 20.0, 19.9, 20.1, 20.1, 19.7, 19.8, 19.7,
              4.6, -15.3, -2.2, -0.9, 18.1, 43.9]  # fmt: skip
    for touch in range(200, 3900, 350):
        force[touch : touch + len(struck)] += np.array(struck) - 20.0
    recording = from_arrays("struck", 2e-3 * np.arange(force.size), depth, force + wrong)
    problem, base = pose(recording, base_of("spring,viscous,bias"), None)
    found = lone_samples(recording, problem, fit_base(problem, base)) > 0.0
    assert np.array_equal(found, wrong != 0.0)
