"""Bodies that lack several things at once, of which no law is exact, and some none is declared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.criteria import HIGHEST_BESIDE_UNKNOWN
from teleop_rt.diagnosis.diagnose import diagnose, predicted_on
from teleop_rt.diagnosis.inference.inner_blocks import blind_energy
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.inference.unsupported import lacks_named_property
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.samples.preparation import pose_again, problem_of
from teleop_rt.offline.closing_files import Files, close_over
from teleop_rt.offline.table import Table
from teleop_rt.recordings.recording import Recording, from_arrays

_RATE_HZ = 100.0
_FRICTION = {"coulomb_friction", "stribeck_friction", "hysteresis"}


def _stroke(seconds: float, seed: int) -> tuple[Vector, Vector]:
    """Return time and a stroke of several amplitudes, with turns at different places."""
    t = np.arange(round(seconds * _RATE_HZ)) / _RATE_HZ
    rng = np.random.default_rng(seed)
    x = 0.02 * np.sin(2 * np.pi * 0.21 * t) + 0.008 * np.sin(
        2 * np.pi * 0.47 * t + rng.uniform(0.0, 6.0)
    )
    return t, x


def _seal(x: Vector, force_N: float, travel_m: float) -> Vector:
    """Return dry friction that grips by a share of its slip, and rubs harder at one end.

    Bristles of two stiffnesses, so no single presliding law is exact.
    """
    found = np.zeros(x.size)
    stretched = np.zeros(2)
    limits = np.array([0.6, 0.4])
    travels = travel_m * np.array([0.5, 2.5])
    for i in range(1, x.size):
        stretched = np.clip(stretched + (x[i] - x[i - 1]) / travels, -1.0, 1.0)
        found[i] = limits @ stretched
    return force_N * found * (1.0 + 6.0 * x)


def _cylinder(seed: int) -> Recording:
    """Return a cylinder on a spring: seal, a drag that nobody declared, and a noisy encoder."""
    t, x = _stroke(30.0, seed)
    v = np.gradient(x, t)
    force = 150.0 * x + 4.0 + _seal(x, 6.0, 5e-4)
    force += 2.0 * np.cos(110.0 * x) * np.tanh(40.0 * v) + 1.8 * np.sin(80.0 * x + 9.0 * v)
    rng = np.random.default_rng(100 + seed)
    force += 0.02 * rng.standard_normal(t.size)
    return from_arrays("cylinder", t, x + 1e-5 * rng.standard_normal(t.size), force)


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """Return the answer where the remainder is taken to be more than slow noise."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "teleop_rt.diagnosis.inference.confirmed.needs_unknown_remainder", lambda *_: True
        )
        return diagnose(_cylinder(1), "spring,viscous,bias")


def test_friction_is_partly_named_beside_an_unknown_remainder(found: Diagnosis) -> None:
    answer = found.answer
    assert answer["verdict"] == "partial"
    assert {name for names in answer["class"] for name in names} <= _FRICTION
    assert max(answer["probability"].values()) == HIGHEST_BESIDE_UNKNOWN
    assert 0.3 < answer["effects"][0]["explains"] < 0.95


def test_the_predictor_holds_what_is_not_named_and_errs_less(found: Diagnosis) -> None:
    answer = found.answer
    error = answer["error"]["std_normalised"]
    assert _FRICTION & set(answer["predictor"])
    assert error["after"] < 0.5 * error["before"]


def test_it_predicts_another_recording_of_the_body(found: Diagnosis) -> None:
    error = predicted_on(found, _cylinder(2)).errors["std_normalised"]
    assert error["after"] < 0.6 * error["before"]


def test_a_hold_that_does_not_determine_a_damping_is_predicted() -> None:
    t = np.arange(6000) / 50.0
    x = 1e-3 + 0.02 * np.minimum(t / 3.0, 1.0)
    force = 300.0 * x * (0.3 + 0.3 * np.exp(-t / 2.0) + 0.4 * np.exp(-t / 30.0))
    rng = np.random.default_rng(4)
    recording = from_arrays(
        "hold",
        t,
        x + 1e-7 * rng.standard_normal(t.size),
        force + 0.005 * rng.standard_normal(t.size),
    )
    error = diagnose(recording, surface=0.0).answer["error"]["std_normalised"]
    assert error["before"] is not None
    assert error["before"] < 3.0
    assert error["after"] is not None
    assert error["after"] < error["before"]


def test_a_layer_that_one_press_alone_reaches_lowers_the_error_on_hidden_blocks() -> None:
    t = np.arange(4000) / 500.0
    x = 2e-3 * np.sin(2 * np.pi * 1.1 * t) + 2e-3 * np.exp(-(((t - 3.1) / 0.3) ** 2))
    force = 900.0 * np.maximum(x, 0.0) + 2500.0 * np.maximum(x - 2.2e-3, 0.0)
    force += 0.01 * np.random.default_rng(1).standard_normal(t.size)
    base = base_of("kelvin-voigt")
    problem = problem_of(from_arrays("pressed", t, x, force), base, 0.0)
    layer = problem.refine(CandidateModel(base, (find("second_layer"),)), np.array([2.2e-3]))
    alone = blind_energy(problem, problem.refine(CandidateModel(base), np.zeros(0)))
    assert blind_energy(problem, layer) < 0.05 * alone


@pytest.mark.parametrize(
    ("level_n", "noise_n", "bare"), [(1.0, 0.0, True), (1.6, 0.0, False), (1.6, 0.08, False)]
)
def test_a_force_that_is_measured_beyond_a_level_is_not_saturated_at_it(
    level_n: float, noise_n: float, bare: bool
) -> None:
    t = np.arange(2000) / 500.0
    x = 2e-3 * np.sin(2 * np.pi * 1.1 * t)
    base = base_of("spring,viscous")
    force = np.clip(1000.0 * x, -1.6, 1.6)
    force += noise_n * np.random.default_rng(1).standard_normal(t.size)
    problem = problem_of(from_arrays("clipped", t, x, force), base, 0.0)
    model = CandidateModel(base, (find("force_saturation"),))
    alone = problem.refine(CandidateModel(base), np.zeros(0))
    found = lacks_named_property(problem, alone, problem.solve(model, np.array([level_n])))
    assert found == ({"force_saturation"} if bare else set())


def test_a_drive_in_oil_is_damped_by_the_square_of_its_speed() -> None:
    """The law held in contact alone, and a drag that explains all of it had no name."""
    t = np.arange(2000) / 250.0
    x = 0.02 * np.sin(2 * np.pi * 0.7 * t) + 0.01 * np.sin(2 * np.pi * 1.9 * t + 1.0)
    v = np.gradient(x, t)
    force = 0.8 * np.gradient(v, t) + 4.0 * v + 30.0 * v * np.abs(v)
    force += 0.01 * np.random.default_rng(4).standard_normal(t.size)
    answer = diagnose(from_arrays("oil", t, x, force), "mass-damper").answer
    assert answer["class"] == [["quadratic_damping"]]
    assert answer["error"]["after_over_floor"] < 1.2


def test_a_loop_is_closed_with_the_named_effects_and_no_others(
    found: Diagnosis, tmp_path: Path
) -> None:
    """The error on the test file was that of a set that also predicts, and is not rendered."""
    other = _cylinder(2)
    files = Files(tmp_path / "A.csv", tmp_path / "B.csv", Table({}, {}, None))
    answer, shown = close_over(found, _cylinder(1), other, files, tmp_path)
    error = answer["fresh"]["slave"]["free_run"]
    assert error == predicted_on(found, other, named=True).errors
    assert error["after"] != predicted_on(found, other).errors["after"]
    fresh = pose_again(other, found.base.model.base, None, found.problem)
    left = fresh.residual(found.best)
    rms = np.sqrt(np.mean(left[fresh.whitener.mask > 0.0] ** 2))
    assert error["after"] * np.ptp(fresh.force[fresh.whitener.mask > 0.0]) == pytest.approx(rms)
    assert shown.after is not None
    assert np.sqrt(np.mean(shown.after**2)) == pytest.approx(rms), "the page draws the other file"


def test_a_drift_larger_than_that_of_any_sensor_is_no_slow_noise() -> None:
    """A red spectrum fits whatever a drive's base leaves, and nothing was said to be missing."""
    t = np.arange(3000) / 250.0
    x = 0.02 * np.sin(2 * np.pi * 0.7 * t) + 0.01 * np.sin(2 * np.pi * 1.9 * t + 1.0)
    v = np.gradient(x, t)
    force = 1.2 * np.gradient(v, t) + 4.0 * v + 150.0 * x
    rng = np.random.default_rng(4)
    walk = np.cumsum(rng.standard_normal(t.size))
    force += np.std(force) * (0.3 * (walk - walk.mean()) / walk.std())
    force += 0.004 * np.std(force) * rng.standard_normal(t.size)
    wanders = from_arrays("wanders", t, np.round(x / 1e-6) * 1e-6, force)
    answer = diagnose(wanders, "mass,spring,viscous,bias").answer
    assert (answer["verdict"], answer["effects"]) == ("unexplained", [])


def test_what_a_law_leaves_in_pink_noise_is_no_unknown_remainder() -> None:
    """The fastest noise is a third of the whole: against it a fifth of the base's error is left."""
    t = 0.002 * np.arange(5000)
    x = 3e-3 + 1.2e-3 * np.sin(np.pi * t) + 0.6e-3 * np.sin(2.6 * np.pi * t + 1.0)
    v = np.gradient(x, t)
    relaxing_N = np.zeros(t.size)
    for i in range(1, t.size):
        relaxing_N[i] = relaxing_N[i - 1] * (1.0 - 0.002 / 0.4) + 300.0 * (x[i] - x[i - 1])
    spectrum = np.fft.rfft(np.random.default_rng(1).standard_normal(t.size))
    spectrum *= np.append(0.0, 1.0 / np.sqrt(np.arange(1, spectrum.size)))
    noise = np.fft.irfft(spectrum, t.size)
    force = 1500.0 * x + 20.0 * v + relaxing_N + 0.12 / np.std(noise) * noise
    answer = diagnose(from_arrays("pink", t, x, force), surface=0.0).answer
    assert answer["verdict"] in {"named", "class"}
    assert ["stress_relaxation"] in answer["class"]
