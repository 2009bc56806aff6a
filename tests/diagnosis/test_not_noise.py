"""Forces that pass for noise by their spectrum, but repeat, follow, wait for a speed, or kick."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest
from cases import OPTION, cases
from numpy.typing import NDArray

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, STEP_M, NOISE_N = 0.002, 2e-7, 0.005
_T = DT_S * np.arange(10_000)
HELD = "spring,viscous,bias"
FEW = ("force_bias", "coulomb_friction", "position_ripple", "periodic_disturbance")
Row = NDArray[np.float64]
Judge = Callable[[Recording], tuple[str, str]]


def _swung() -> tuple[Row, Row]:
    """Return position and velocity of a body that is fixed to the tool."""
    rates, sizes = (0.31, 0.83, 1.9), (1e-3, 6e-4, 2e-4)
    terms = [(s, 2.0 * np.pi * f) for s, f in zip(sizes, rates, strict=True)]
    x = sum(s * np.sin(w * _T + w) for s, w in terms)
    v = sum(s * w * np.cos(w * _T + w) for s, w in terms)
    return np.asarray(x), np.asarray(v)


def _stepped(seed: int) -> tuple[Row, Row]:
    """Return position and velocity of a tool that rests at one place after another."""
    rng, at = np.random.default_rng(seed), 0.3
    x, v = np.zeros(_T.size), np.zeros(_T.size)
    while at < _T[-1] - 1.0:
        way, time = rng.uniform(-6e-4, 6e-4), rng.uniform(0.1, 0.3)
        u = np.clip((_T - at) / time, 0.0, 1.0)
        x += way * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)
        v += way / time * (30.0 * u**2 - 60.0 * u**3 + 30.0 * u**4)
        at += rng.uniform(0.3, 0.8)
    return x, v


def _recorded(moved: tuple[Row, Row], extra: Row, seed: int, force_step: float = 0.0) -> Recording:
    x, v = moved
    force = 2000.0 * x + 4.0 * v + extra
    force += NOISE_N * np.random.default_rng(seed).standard_normal(_T.size)
    if force_step:
        force = force_step * np.round(force / force_step)
    return from_arrays("made", _T, STEP_M * np.round(x / STEP_M), force)


def _judged(recording: Recording, effects: tuple[Effect, ...] = LIBRARY) -> tuple[str, str]:
    answer = diagnose(recording, HELD, effects=effects).answer
    return answer["verdict"], " ".join(answer["notes"])


@pytest.fixture
def judged(request: pytest.FixtureRequest) -> Judge:
    """Return a function that gives verdict and notes of a force that no effect explains.

    All effects are searched only with the further cases: most of the time goes to them.
    """
    every = request.config.getoption(OPTION)
    few = tuple(effect for effect in LIBRARY if effect.name in FEW)
    return functools.partial(_judged, effects=LIBRARY if every else few)


@pytest.mark.parametrize("seed", cases(3, 1, 2))
def test_a_rough_track_that_each_pass_meets_again_is_no_noise(judged: Judge, seed: int) -> None:
    x, v = _stepped(seed)
    places = np.arange(np.min(x) - 1e-5, np.max(x) + 1e-5, 5e-6)
    rough = np.interp(x, places, 0.1 * np.random.default_rng(seed).standard_normal(places.size))
    verdict, notes = judged(_recorded((x, v), rough, seed))
    assert verdict == "unexplained"
    assert "repeats with the position" in notes


@pytest.mark.parametrize("seed", cases(3, 1, 2))
def test_a_friction_at_one_place_is_no_noise(judged: Judge, seed: int) -> None:
    x, v = _stepped(seed)
    sticky = 0.05 * np.exp(-(((x - np.median(x)) / 4e-5) ** 2)) * np.tanh(v / 1e-6)
    verdict, notes = judged(_recorded((x, v), sticky, seed))
    assert verdict == "unexplained"
    assert "repeats with the position" in notes


@pytest.mark.parametrize("seed", cases(11, 12, 13))
@pytest.mark.parametrize(("size_N", "width"), cases((0.05, 0.5), (0.1, 1.0)))
def test_a_chatter_of_slow_motion_is_no_noise(
    judged: Judge, seed: int, size_N: float, width: float
) -> None:
    x, v = _swung()
    noise = np.random.default_rng(100 + seed).standard_normal(_T.size)
    chatter = size_N * noise * np.exp(-((v / (width * np.std(v))) ** 2))
    verdict, notes = judged(_recorded((x, v), chatter, seed))
    assert verdict == "unexplained"
    assert "changes with the speed" in notes


def _chirp() -> tuple[Row, Row, Row]:
    """Return the stroke from 0 to 1 of a motion that gets faster, its velocity and acceleration."""
    slowest, rise = 2.0 * np.pi * 0.3, 2.0 * np.pi * 0.135
    phase, rate = slowest * _T + 0.5 * rise * _T**2, slowest + rise * _T
    stroke, turned = 0.5 * (1.0 - np.cos(phase)), 0.5 * np.sin(phase)
    return stroke, turned * rate, turned * rise + 0.5 * np.cos(phase) * rate**2


@pytest.mark.parametrize("seed", cases(3, 1, 2))
def test_a_stiffness_that_pulsates_is_no_noise(judged: Judge, seed: int) -> None:
    stroke, speed, _ = _chirp()
    x, v = 1e-3 * stroke, 1e-3 * speed
    frequency = np.fft.rfftfreq(_T.size, DT_S)
    noise = np.fft.rfft(np.random.default_rng(600 + seed).standard_normal(_T.size))
    pulses = np.fft.irfft(noise * np.exp(-((frequency - 4.0) ** 2)), _T.size)
    verdict, notes = judged(_recorded((x, v), 60.0 * pulses / np.std(pulses) * x, seed))
    assert verdict == "unexplained"
    assert "changes with the position" in notes


@pytest.mark.parametrize("seed", cases(3, 1, 2))
def test_a_gain_that_switches_is_no_noise(seed: int) -> None:
    stroke, speed, acceleration = _chirp()
    x, v, a = 0.1 * stroke, 0.1 * speed, 0.1 * acceleration
    rng = np.random.default_rng(300 + seed)
    gains = 1.0 + rng.uniform(-0.04, 0.04, 12)
    force = (0.8 * a + 3.0 * v) * gains[(_T / _T[-1] * 11.99).astype(int)]
    force += 0.01 * rng.standard_normal(_T.size)
    recording = from_arrays("made", _T, 5e-6 * np.round(x / 5e-6), force)
    answer = diagnose(recording, "mass,viscous,bias").answer
    assert answer["verdict"] == "unexplained"
    assert "follows the motion" in " ".join(answer["notes"])


@pytest.mark.parametrize("seed", cases(11, 12, 13))
def test_a_force_that_jumps_between_two_levels_is_no_noise(judged: Judge, seed: int) -> None:
    flips = np.random.default_rng(100 + seed).random(_T.size) < 0.1
    verdict, notes = judged(_recorded(_swung(), 0.1 * (-1.0) ** np.cumsum(flips), seed))
    assert verdict == "unexplained"
    assert "jumps between two levels" in notes


@pytest.mark.parametrize("seed", cases(11, 12, 13))
def test_a_motor_that_runs_up_is_no_noise(judged: Judge, seed: int) -> None:
    """Its unbalance is a tone from 3 to 17 Hz that grows: a spectrum sees noise of that band."""
    turned = 2.0 * np.pi * (3.0 * _T + 7.0 * _T**2 / _T[-1])
    shaking = 0.05 * (0.3 + _T / _T[-1]) * np.sin(turned)
    verdict, notes = judged(_recorded(_swung(), shaking, seed))
    assert verdict == "unexplained"
    assert "frequency changes" in notes


@pytest.mark.parametrize("seed", cases(11, 12, 13))
def test_a_tone_that_runs_up_under_the_white_noise_of_a_sensor_is_no_noise(
    judged: Judge, seed: int
) -> None:
    turned = 2.0 * np.pi * (3.0 * _T + 7.0 * _T**2 / _T[-1])
    verdict, notes = judged(_recorded(_swung(), 1.5 * NOISE_N * np.sin(turned), seed))
    assert verdict == "unexplained"
    assert "frequency changes" in notes


@pytest.mark.parametrize("seed", cases(11, 12, 13))
def test_a_level_that_jumps_now_and_then_under_white_noise_is_no_noise(
    judged: Judge, seed: int
) -> None:
    flips = np.random.default_rng(100 + seed).random(_T.size) < 0.004
    level = 1.5 * NOISE_N * (-1.0) ** np.cumsum(flips)
    verdict, notes = judged(_recorded(_swung(), level, seed))
    assert verdict == "unexplained"
    assert "jumps" in notes


@pytest.mark.parametrize("seed", cases(31, 32, 33))
def test_a_part_that_is_stretched_and_slips_is_no_noise(judged: Judge, seed: int) -> None:
    """Its force rises by itself to a limit, a new one each time, and falls at once."""
    rng, force, limit = np.random.default_rng(seed), np.zeros(_T.size), 0.02
    for i in range(1, _T.size):
        force[i] = force[i - 1] + 0.02 * DT_S / 0.4
        if force[i] > limit:
            force[i], limit = 0.0, rng.uniform(0.01, 0.03)
    verdict, notes = judged(_recorded(_swung(), force, seed))
    assert verdict == "unexplained"
    assert "sticks and slips" in notes


@pytest.mark.parametrize("seed", cases(21, 22, 23))
def test_a_frame_that_rings_at_moments_of_its_own_is_no_noise(judged: Judge, seed: int) -> None:
    """Its tones have phases of their own: their sum lies to no side and repeats nowhere."""
    rng, ringing = np.random.default_rng(700 + seed), np.zeros(_T.size)
    for at in rng.uniform(0.0, _T[-1], 14):
        since = np.maximum(_T - at, 0.0)
        tone = np.sin(2.0 * np.pi * 22.0 * since + rng.uniform(0.0, 2.0 * np.pi))
        ringing += 0.04 * (at < _T) * np.exp(-since / 0.06) * tone
    verdict, notes = judged(_recorded(_swung(), ringing, seed))
    assert verdict == "unexplained"
    assert "comes in bursts" in notes


@pytest.mark.parametrize("seed", cases(14, 11, 12, 13))
def test_pulses_at_moments_of_their_own_are_no_noise(judged: Judge, seed: int) -> None:
    rng, pulses = np.random.default_rng(200 + seed), np.zeros(_T.size)
    for at in rng.uniform(0.0, _T[-1], 18):
        since = np.maximum(0.0, _T - at) / rng.uniform(0.03, 0.1)
        pulses += rng.uniform(0.03, 0.08) * since * np.exp(1.0 - since)
    verdict, notes = judged(_recorded(_swung(), pulses, seed))
    assert verdict == "unexplained"
    assert "lies to one side" in notes


@pytest.mark.parametrize("seed", cases(1, 2, 3))
def test_a_few_kicks_of_a_limiter_are_no_row_of_pulses(seed: int) -> None:
    kicks = np.zeros(_T.size)
    for at in np.random.default_rng(seed).uniform(1.0, 18.0, 4):
        kicks += 0.05 * np.exp(-(((_T - at) / 0.004) ** 2))
    assert _judged(_recorded(_swung(), kicks, seed))[0] == "no_missing_effect"


@pytest.mark.parametrize("hidden", [True, False])
@pytest.mark.parametrize("seed", cases(3, 1, 4))
def test_what_no_effect_explains_is_missing_unless_noise_hides_it(
    judged: Judge, seed: int, hidden: bool
) -> None:
    x, v = _stepped(seed)
    pitch_m = 3.6e-4 if seed == 4 else 6e-4
    two_screws = np.sin(2.0 * np.pi * x / pitch_m) + np.sin(2.0 * np.pi * x / (0.385 * pitch_m) + 1)
    size = 0.1 if hidden else 0.5
    verdict, notes = judged(_recorded((x, v), size * NOISE_N * two_screws, seed))
    assert (verdict == "no_missing_effect") is hidden
    assert ("hides in the noise" in notes) is hidden


@pytest.mark.parametrize("seed", cases(2, 3, 4))
@pytest.mark.parametrize(("share", "verdict"), [(0.08, "no_missing_effect"), (0.2, "named")])
def test_a_hum_is_missing_if_it_lowers_the_error_by_half_a_percent(
    share: float, verdict: str, seed: int
) -> None:
    """A hum of a tenth of the noise's deviation does. The recording shows both sizes for sure."""
    hum = 2.0**0.5 * share * NOISE_N * np.sin(2.0 * np.pi * 7.3 * _T)
    found, notes = _judged(_recorded(_swung(), hum, seed))
    assert found == verdict
    assert ("a trace of periodic_disturbance hides in the noise" in notes) is (share == 0.08)


def _red(seed: int) -> Row:
    noise = np.random.default_rng(seed).standard_normal(_T.size)
    for i in range(1, noise.size):
        noise[i] += 0.98 * noise[i - 1]
    return 0.01 * noise


@pytest.mark.parametrize("seed", cases(21, 22, 23))
@pytest.mark.parametrize(
    ("extra", "force_step"), [("white", 0.0), ("red", 0.0), ("coarse converter", 0.02)]
)
def test_noise_of_any_colour_is_noise(extra: str, force_step: float, seed: int) -> None:
    added = _red(seed) if extra == "red" else np.zeros(_T.size)
    moved = _swung() if seed % 2 else _stepped(seed)
    assert _judged(_recorded(moved, added, seed, force_step))[0] == "no_missing_effect"


@pytest.mark.parametrize("seed", cases(22, 21, 23))
def test_a_force_that_shakes_for_a_while_after_each_turn_is_no_noise(
    judged: Judge, seed: int
) -> None:
    x, v = _swung()
    rng, shaken = np.random.default_rng(seed), np.zeros(_T.size)
    for turn in np.flatnonzero(np.diff(np.sign(v))).tolist():
        after = _T[turn:] - _T[turn]
        shaken[turn:] += 0.035 * rng.standard_normal(after.size) * np.exp(-after / 0.15)
    verdict, notes = judged(_recorded((x, v), shaken, seed))
    assert verdict == "unexplained"
    assert "time since the last turn" in notes


def test_even_noise_is_noise_where_errors_of_the_encoder_would_be_spikes() -> None:
    """Each turn makes a spike of them, through the friction: noise was "an even amplitude"."""
    rng = np.random.default_rng(3)
    x = 4e-3 + 6e-3 * np.sin(2.0 * np.pi * 0.7 * _T) + 3e-3 * np.sin(2.0 * np.pi * 1.9 * _T)
    v = np.gradient(x, DT_S)
    force = np.where(x > 0.0, 2500.0 * x + 12.0 * v, 0.0) + 1.2 * np.tanh(v / 1e-3)
    force += rng.normal(0.0, 0.03, _T.size)
    measured = x + rng.normal(0.0, 1e-6, _T.size)
    answer = diagnose(from_arrays("spring", _T, measured, force)).answer
    assert answer["class"] == [["coulomb_friction"]]
    assert answer["probability"]["coulomb_friction"] > 0.9
    assert not any("amplitude" in note for note in answer["notes"])
