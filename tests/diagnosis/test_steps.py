"""Steps of encoder and converter differ from effects: they repeat at every rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cases import cases
from numpy.typing import NDArray
from scipy.signal import butter, filtfilt, lsim, savgol_filter

from teleop_rt.diagnosis.answers.notes import STEPS_OF_MOTION, notes_of
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.samples.converter import without_steps
from teleop_rt.diagnosis.samples.motion import differentiate, position_noise, reading_noise
from teleop_rt.diagnosis.samples.smoothing import half_window, moves_in_steps
from teleop_rt.recordings.recording import Recording, from_arrays

Array = NDArray[np.float64]
BASE = base_of("kelvin-voigt")
ANSWER: dict[str, Any] = {
    "verdict": "no_missing_effect",
    "class": [],
    "probability": {},
    "base": {"parameters": {}},
    "error": {
        "on": "held-out blocks",
        "std_normalised": {"before": 0.1, "after": 0.1},
        "after_over_floor": 1.0,
    },
}
"""As much of an answer as its notes rest on."""


def trapezoids(speed: float, levels: Array, dt: float) -> Array:
    """Return a path at constant speed from level to level, with rests of 0.3 s."""
    rest = np.zeros(round(0.3 / dt))
    moves = [np.full(round(abs(d) / speed / dt), np.sign(d) * speed) for d in np.diff(levels)]
    pieces = [row for move in moves for row in (rest, move)]
    path = levels[0] + np.cumsum(np.concatenate([*pieces, rest])) * dt
    smooth: Array = filtfilt(*butter(2, 12.0, fs=1.0 / dt), path)
    return smooth


def test_steps_that_beat_with_the_samples_are_no_effect() -> None:
    """At about a step per sample the errors are slow, and nothing of a smoothed path shows that."""
    dt, step = 1e-3, 8e-6
    rng = np.random.default_rng(0)
    levels = [-3.0, 7.085, -1.5, 4.3, -1.5, 7.085, -1.5, 2.9, -1.5, 5.7, -1.5, 7.085, -1.5]
    path = trapezoids(8.3e-3, 1e-3 * np.array(levels), dt) + rng.uniform(0.0, step)
    force = np.where(path > 0.0, 1622.0 * path + 15.0 * np.gradient(path, dt), 0.0)
    force += 0.03 * rng.standard_normal(path.size)
    read = step * np.round(path / step)
    answer = diagnose(
        from_arrays("beat", dt * np.arange(path.size), read, force), surface=0.0
    ).answer
    assert answer["verdict"] == "no_missing_effect"


@pytest.mark.parametrize("steps", [2.0, 3.0])
def test_a_converter_as_coarse_as_the_noise_makes_no_force(steps: float) -> None:
    rng = np.random.default_rng(4)
    levels = np.repeat(rng.uniform(5.0, 20.0, 12), 1000)
    noise = 0.1
    step = steps * noise
    read = step * np.round((levels + noise * rng.standard_normal(levels.size)) / step)
    means, raw = (
        np.mean((row - levels).reshape(12, -1)[:, 100:-100], axis=1)
        for row in (without_steps(read, 20, step), read)
    )
    chance = np.hypot(noise, step / np.sqrt(12.0)) / np.sqrt(800.0)
    assert np.sqrt(np.mean(means**2)) < 1.5 * chance
    assert np.sqrt(np.mean(means**2)) < max(0.6 * np.sqrt(np.mean(raw**2)), 1.2 * chance)


def test_a_force_without_steps_or_with_fine_ones_is_left_as_it_is() -> None:
    rng = np.random.default_rng(5)
    force = 10.0 + rng.standard_normal(3000)
    for read, step in ((force, 0.0), (0.1 * np.round(force / 0.1), 0.1)):
        np.testing.assert_array_equal(without_steps(read, 20, step), read)


COARSE_N = 0.4  # a step of a converter, ten times the noise before it


def coarsely_pressed(seed: int, bias: float = 0.0, lost: int = 0) -> Recording:
    """Return 8 s of slow presses whose force is read in 25 steps; some samples may be lost."""
    dt = 2e-3
    rng = np.random.default_rng(seed)
    t = dt * np.arange(4000)
    path = 2e-3 * np.sin(2.0 * np.pi * 0.37 * t) + 1e-3 * np.sin(2.0 * np.pi * 1.1 * t + 1.0)
    speed = np.gradient(path, dt)
    force = np.where(path > 0.0, np.maximum(3000.0 * path + 20.0 * speed, 0.0), 0.0) + bias
    force += 0.1 * COARSE_N * rng.standard_normal(t.size)
    read = COARSE_N * np.round((force + rng.uniform(-0.5, 0.5) * COARSE_N) / COARSE_N)
    kept = np.delete(np.arange(t.size), rng.choice(t.size, lost, replace=False))
    return from_arrays("coarse", t[kept], path[kept], read[kept])


@pytest.mark.parametrize("lost", [0, 20])
@pytest.mark.parametrize("seed", cases(0, 2, 4))
def test_a_converter_far_coarser_than_the_noise_is_no_effect(seed: int, lost: int) -> None:
    """In free air it reads one value, which may be off by half a step: that is no bias."""
    found = diagnose(coarsely_pressed(seed, lost=lost), "kelvin-voigt")
    assert found.answer["verdict"] == "no_missing_effect"
    assert found.problem.force_step == pytest.approx(COARSE_N)


def test_a_bias_of_several_steps_is_a_bias() -> None:
    answer = diagnose(coarsely_pressed(4, bias=5.0 * COARSE_N), "kelvin-voigt").answer
    assert ["force_bias"] in answer["class"]


def test_rests_read_by_a_coarse_converter_are_no_ripple() -> None:
    dt, noise = 5e-4, 0.12
    rng = np.random.default_rng(3)
    levels = np.concatenate(([0.6], rng.uniform(0.7, 2.8, 24), [0.7]))
    path = trapezoids(6e-3, 1e-3 * levels, dt)
    force = 33_000.0 * path**1.2 * (1.0 + 2.0 * np.gradient(path, dt))
    force += noise * rng.standard_normal(path.size)
    read = 3.3 * noise * np.round(force / (3.3 * noise))
    recording = from_arrays("converter", dt * np.arange(path.size), path, read)
    answer = diagnose(recording, "hunt-crossley", surface=0.0).answer
    assert answer["verdict"] == "no_missing_effect"


def pressed(rate_hz: float, seconds: float, seed: int) -> tuple[Array, Array]:
    """Return time and a path of presses, slow and fast, in and out of a surface at 0 [m]."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    tones = rng.uniform(0.3, 4.0, 5)
    path = sum(
        np.sin(2 * np.pi * f * t + rng.uniform(0.0, 6.0)) / (1.0 + f) for f in tones.tolist()
    )
    return t, 1.5e-3 * np.asarray(path) + 0.4e-3


def test_noise_that_an_encoder_reads_in_steps_is_no_effect() -> None:
    """A mass, or a delay with a lag, would make less of it; nothing else speaks for them."""
    seed = 3
    t, path = pressed(200.0, 12.0, seed)
    rng = np.random.default_rng(seed)
    step, stiffness, sensor = 8e-6, 9000.0, 5e-3
    force = np.where(path > 0.0, stiffness * path + 60.0 * np.gradient(path, t), 0.0)
    force += sensor * rng.standard_normal(t.size)
    read = step * np.round((path + 0.75 * step * rng.standard_normal(t.size)) / step)
    answer = diagnose(from_arrays("noisy", t, read, force), surface=0.0).answer
    assert answer["verdict"] == "no_missing_effect"


def test_an_encoder_s_noise_is_distinguished_from_its_steps() -> None:
    _, path = pressed(500.0, 10.0, seed=4)
    rng = np.random.default_rng(4)
    step = 4e-6
    assert reading_noise(step * np.round(path / step), 2e-3) == 0.0
    noisy = path + 0.8 * step * rng.standard_normal(path.size)
    assert reading_noise(step * np.round(noisy / step), 2e-3) == pytest.approx(0.8 * step, rel=0.1)


def test_samples_taken_a_little_early_or_late_are_no_delay() -> None:
    """Their stamps are true; where a damper's force jumps, the values between are a guess."""
    seed = 1
    rng = np.random.default_rng(seed)
    even, _ = pressed(1000.0, 10.0, seed)
    t = even + 1.3e-4 * rng.standard_normal(even.size).clip(-2.0, 2.0)
    fine, path = pressed(20000.0, 10.1, seed)
    x, v = (np.interp(t, fine, row) for row in (path, np.gradient(path, fine)))
    force = np.where(x > 0.0, 15000.0 * x + 30.0 * v, 0.0) + 0.01 * rng.standard_normal(t.size)
    read = 2e-7 * np.round(x / 2e-7)
    answer = diagnose(from_arrays("late", t - t[0], read, force), surface=0.0).answer
    assert answer["verdict"] == "no_missing_effect"


def test_quantisation_constant_in_free_air_is_no_difference_to_contact() -> None:
    t, path = pressed(1000.0, 12.0, seed=6)
    depth = np.maximum(path, 0.0)
    force = 3000.0 * depth + 2e7 * depth**3 + np.where(path > 0.0, 6.0 * np.gradient(path, t), 0.0)
    force += 5e-3 * np.random.default_rng(6).standard_normal(t.size)
    read = 0.05 * np.round(force / 0.05)
    answer = diagnose(from_arrays("coarse", t, 1e-6 * np.round(path / 1e-6), read), surface=0.0)
    assert answer.answer["class"] == [["nonlinear_stiffening"]]


def test_an_encoder_that_reads_the_same_at_rest_adds_no_noise() -> None:
    t, path = pressed(500.0, 10.0, seed=4)
    rng = np.random.default_rng(4)
    step = 4e-6
    shaking = path + 0.8 * step * rng.standard_normal(path.size)
    shaking[t > 9.0] = shaking[t > 9.0][0]
    assert reading_noise(step * np.round(shaking / step), 2e-3) == 0.0


def test_a_tool_that_follows_a_jittering_link_is_not_smoothed_away_nor_taken_for_noise() -> None:
    """Steps of velocity, through a drive of 100 Hz, read in steps of 5 um at 1 kHz."""
    t = np.arange(0.0, 6.0, 1e-3)
    late = t - 0.005 * np.random.default_rng(3).uniform(0.0, 1.0, t.size)
    stamped = 0.008 * np.sin(2 * np.pi * 3.0 * np.maximum.accumulate(late))
    damping, stiffness = 2 * 0.7 * 2 * np.pi * 100.0, (2 * np.pi * 100.0) ** 2
    x = lsim(([damping, stiffness], [1.0, damping, stiffness]), stamped, t)[1]
    read = 5e-6 * np.round(x / 5e-6)
    assert position_noise(read, 1e-3) < 2e-5
    assert moves_in_steps(read, 1000.0 * read, 1e-3)
    slow = 5e-6 * np.round(0.008 * np.sin(18.8 * t) / 5e-6)
    assert not moves_in_steps(slow, 1000.0 * slow, 1e-3)
    without_noise = 0.008 * np.sin(50.0 * t) + 0.003 * np.sin(186.0 * t)
    assert not moves_in_steps(without_noise, 1000.0 * without_noise, 1e-3)
    smooth = 0.008 * np.sin(18.8 * t) + 1e-6 * np.random.default_rng(1).standard_normal(t.size)
    for path, noted in ((read, True), (smooth, False)):
        recording = from_arrays("a", t, path, np.maximum(1000.0 * path, 0.0))
        assert (
            STEPS_OF_MOTION in notes_of(ANSWER, BASE, BASE.name, recording, 0.0, "usual")
        ) is noted
    _, v, _ = differentiate(read, 1e-3, half_window(read, 1e-3))
    v_true = np.gradient(x, t)
    assert np.std((v - v_true)[100:-100]) < 0.5 * np.std(v_true - savgol_filter(v_true, 41, 3))


@pytest.mark.parametrize("rate_hz", [1000.0, 2000.0])
@pytest.mark.parametrize("highest_hz", [100.0, 150.0, 250.0])
def test_a_quick_motion_that_the_samples_show_is_not_in_steps(
    rate_hz: float, highest_hz: float
) -> None:
    """Its force above 50 Hz was thrown away, and a lag beside a friction passed for noise."""
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 6.0, 1.0 / rate_hz)
    rates = 2.0 * np.pi * np.geomspace(0.5, highest_hz, 14)
    turns = np.outer(rates, t) + rng.uniform(0.0, 6.0, 14)[:, None]
    x = (0.02 / rates) @ np.sin(turns)
    read = 1e-6 * np.round(x / 1e-6 + rng.standard_normal(t.size))
    assert not moves_in_steps(read, 1000.0 * x, 1.0 / rate_hz)


def followed_in_steps(
    friction: float, stiffening: float, rate_hz: float = 1000.0, jitter_s: float = 0.005
) -> Recording:
    """Return 8 s of a drive of 100 Hz behind a jittering link, pressed on 3600 N/m and 20 N s/m.

    It runs in straight lines from set-point to set-point; force and motion are those of a grid 20
    times finer, and contact does not pull. `friction` [N] and `stiffening` [N/m2] are undeclared.
    """
    rng, finer, dt = np.random.default_rng(1), 20, 1.0 / rate_hz
    t = np.arange(0.0, 8.0, dt)
    late = np.maximum.accumulate(t - jitter_s * rng.uniform(0.0, 1.0, t.size))
    between = np.arange(t.size * finer) * dt / finer
    reference = np.interp(between - dt, t, 0.008 * np.sin(2 * np.pi * 3.0 * late))
    w = 2 * np.pi * 100.0
    x = 0.012 + lsim(([2 * w, w**2], [1.0, 2 * w, w**2]), reference, between)[1]
    v, pressed = np.gradient(x, between), np.maximum(x - 0.0137, 0.0)
    contact = 3600.0 * pressed + 20.0 * v + stiffening * pressed**2
    force = np.where(pressed > 0.0, np.maximum(contact, 0.0), 0.0) + friction * np.tanh(v / 0.002)
    noise = 0.05 * rng.standard_normal(t.size)
    return from_arrays("steps", t, 5e-6 * np.round(x[::finer] / 5e-6), force[::finer] + noise)


def test_at_a_low_rate_steps_look_like_noise_that_the_force_follows() -> None:
    recording = followed_in_steps(0.0, 0.0, rate_hz=250.0, jitter_s=0.002)
    read, force, dt = recording.position, recording.force, recording.dt
    assert half_window(read, dt) > 10, "taken for noise of the encoder"
    assert moves_in_steps(read, force, dt)
    answer = diagnose(recording).answer
    assert answer["verdict"] == "no_missing_effect"
    assert STEPS_OF_MOTION in answer["notes"]
    for name, true in (("k", 3600.0), ("b", 20.0)):
        found = answer["base"]["parameters"][name]
        assert abs(found["value"] - true) < 3.0 * found["std"]
        assert found["std"] < 0.05 * true


@pytest.mark.parametrize("noise", [2e-5, 1e-3])
@pytest.mark.parametrize("rate_hz", [50.0, 250.0, 500.0])
def test_noise_of_the_encoder_is_not_taken_for_steps(rate_hz: float, noise: float) -> None:
    rng, t = np.random.default_rng(5), np.arange(0.0, 20.0, 1.0 / rate_hz)
    x = 0.008 * np.sin(2 * np.pi * 1.3 * t)
    force = np.maximum(3600.0 * x + 20.0 * np.gradient(x, t), 0.0)
    read = x + noise * rng.standard_normal(t.size)
    felt = force + 0.05 * rng.standard_normal(t.size)
    assert not moves_in_steps(5e-6 * np.round(read / 5e-6), felt, 1.0 / rate_hz)


@pytest.mark.parametrize(
    ("friction", "stiffening", "named"),
    [(0.0, 0.0, []), (1.0, 0.0, ["coulomb_friction"]), (0.0, 1e5, ["nonlinear_stiffening"])],
)
def test_behind_a_jittering_link_only_what_is_missing_is_named(
    friction: float, stiffening: float, named: list[str]
) -> None:
    recording = followed_in_steps(friction, stiffening)
    assert moves_in_steps(recording.position, recording.force, recording.dt)
    answer = diagnose(recording).answer
    assert [effect["name"] for effect in answer["effects"]] == named
    assert answer["verdict"] == ("named" if named else "no_missing_effect")
    assert STEPS_OF_MOTION in answer["notes"]
    if not named:
        for name, true in (("k", 3600.0), ("b", 20.0)):
            found = answer["base"]["parameters"][name]
            assert abs(found["value"] - true) < 3.0 * found["std"]
            assert found["std"] < 0.003 * true
