"""A recording may begin while the material still fades from an unrecorded past."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.search import fades, with_past
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.models.held_out import cross_predict
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt_dev.diagnosis.foreign_plants import foreign

DT, CUT_S, NOISE_N = 2e-3, 2.0, 0.01
TAU_S, ARM_N_PER_M = 0.8, 400.0


def relaxing(cut_s: float = CUT_S) -> Recording:
    """Return presses on a spring and one Maxwell arm, those before `cut_s` not recorded."""
    t = np.arange(0.0, 10.0, DT)
    x = 0.01 * np.sin(2 * np.pi * 0.55 * t - 1.0) + 0.002 * np.sin(2 * np.pi * 1.7 * t)
    depth, v = np.maximum(x, 0.0), np.gradient(x, DT)
    stretch = lfilter([DT], [1.0, -np.exp(-DT / TAU_S)], np.gradient(depth, DT))
    force = np.where(x > 0.0, 1000.0 * depth + 8.0 * v + ARM_N_PER_M * stretch, 0.0)
    force += NOISE_N * np.random.default_rng(3).standard_normal(t.size)
    kept = t >= cut_s
    return from_arrays("late", t[kept] - cut_s, x[kept], force[kept])


def fits(recording: Recording) -> tuple[Fit, Fit]:
    problem = problem_of(recording, base_of("kelvin-voigt"), 0.0)
    model = CandidateModel(base_of("kelvin-voigt"), (find("stress_relaxation", "one arm"),))
    ignorant = problem.refine(model, np.array([0.3]))
    return ignorant, with_past(problem, ignorant)


def test_the_past_is_estimated_with_the_effect() -> None:
    ignorant, informed = fits(relaxing())
    assert informed.chi2 < 1.3 * informed.effective < 0.5 * ignorant.chi2
    assert informed.zeta[0] == pytest.approx(TAU_S, rel=0.02)
    assert informed.theta[2] == pytest.approx(ARM_N_PER_M, rel=0.02)


def test_a_recording_that_begins_at_the_outermost_place_is_given_no_past() -> None:
    """On a strip pulled from rest a made-up past took the law's place; no other run bore it out."""
    model = CandidateModel(base_of("kelvin-voigt"), (find("stress_relaxation", "one arm"),))
    outermost = DT * int(np.argmin(relaxing(0.0).position[:4000]))
    for cut_s, past in ((CUT_S, True), (0.8, True), (outermost, False)):
        problem = problem_of(relaxing(cut_s), base_of("kelvin-voigt"), 0.0)
        assert fades(problem, problem.solve(model, np.array([0.3]))) is past


def test_a_past_belongs_to_one_recording_and_not_to_the_model() -> None:
    recording = relaxing()
    problem = problem_of(recording, base_of("kelvin-voigt"), 0.0)
    _, informed = fits(recording)
    assert informed.elsewhere.theta.size == informed.theta.size - 1
    assert informed.elsewhere.names == informed.names
    whole, later = (fit.force_on(problem.motion) for fit in (informed, informed.elsewhere))
    assert np.ptp(whole - later) > 20 * NOISE_N
    hidden = cross_predict(problem, informed)[problem.whitener.mask > 0.0]
    rest = recording.force[problem.whitener.mask > 0.0] - hidden
    assert np.std(rest) < 1.3 * NOISE_N


def test_another_recording_is_predicted_without_the_past_of_the_first() -> None:
    found = diagnose(relaxing(), "kelvin-voigt", surface=0.0, test=relaxing(0.0)).answer
    assert found["error"]["on"] == "held-out record"
    assert found["error"]["after_over_floor"] < 1.1


def test_relaxation_is_named_where_the_recording_begins_late() -> None:
    found = diagnose(relaxing(), "kelvin-voigt", surface=0.0).answer
    assert found["class"] == [["stress_relaxation"]]
    assert set(found["effects"][0]["parameters"]) == {"arm_stiffness", "time_constant"}
    assert found["error"]["after_over_floor"] < 1.1


def test_a_faded_memory_gets_no_past() -> None:
    """The chance content of the first samples that count would make it one of 1e32 N."""
    record = foreign(1422205179, ("force_lag",))
    recording = from_arrays("f", record.t, record.position, record.force)
    problem = problem_of(recording, base_of(record.base), 0.0)
    effects = (find("stress_relaxation", "three arms"), find("channel_delay"))
    model = CandidateModel(base_of(record.base), effects)
    informed = with_past(problem, problem.solve(model, np.array([0.004, 2.3, 0.1, 0.001])))
    made = informed.force_on(problem.motion) - informed.elsewhere.force_on(problem.motion)
    assert np.max(np.abs(made)) < 3.0 * problem.motion.scales["force"]


@pytest.mark.parametrize("before_s", [0.0, 3.0])
@pytest.mark.parametrize("pink", [False, True])
def test_a_held_body_relaxes_from_what_was_done_to_it_before(before_s: float, pink: bool) -> None:
    """All pasts of such a body were one row; arms of a relaxation stood in for its power law."""
    dt, order, rng = 8e-3, 0.4, np.random.default_rng(12)
    t = dt * np.arange(2500)
    rates = rng.uniform(0.05, 1.5, 7)
    x = sum(rng.uniform(0.3, 1.0) * np.sin(2.0 * np.pi * f * t + rng.uniform(0, 6)) for f in rates)
    x = 1.6e-3 * x / np.max(np.abs(x)) - 0.014
    stretch = np.concatenate([np.full(round(before_s / dt), 2e-3), x + 0.016])
    steps = np.arange(1, stretch.size)
    weights = np.cumprod(np.concatenate([[1.0], (steps - 1 - order) / steps]))  # Gruenwald
    creeping = np.convolve(stretch, weights)[: stretch.size][-t.size :] * dt**-order
    noise = rng.standard_normal(t.size)
    if pink:
        slow = np.maximum(np.arange(t.size // 2 + 1), 1.0)
        noise = np.fft.irfft(np.fft.rfft(noise) / np.sqrt(slow), t.size)
    force = 550.0 * (x + 0.015) + 10.0 * np.gradient(x, dt) + 20.0 * creeping
    force += 2.5e-3 * noise / np.std(noise)
    answer = diagnose(from_arrays("stretched", t, x, force), "spring,viscous,bias").answer
    rivals = [["stress_relaxation"]] if pink else []
    assert answer["class"] in ([["fractional_relaxation"]], [["fractional_relaxation"], *rivals])
    assert answer["effects"][0]["parameters"]["order"]["value"] == pytest.approx(order, abs=0.03)


def springpot(order: float = 0.45) -> Recording:
    """Return presses on a spring and a springpot, begun with the tool at rest in the body."""
    t = np.arange(0.0, 9.0, 2e-3)
    x = 1.2e-3 * np.cos(2 * np.pi * 0.28 * t) + 3e-4 * np.sin(2 * np.pi * 2.3 * t) ** 2 + 2e-4
    depth = np.maximum(x, 0.0)
    number = np.arange(1, t.size)
    weights = np.cumprod(np.append(1.0, (number - 1 - order) / number))  # Gruenwald, Letnikov
    pot = np.convolve(weights, depth - depth[0])[: t.size] / 2e-3**order
    force = np.where(x > 0.0, np.maximum(3.0e4 * depth + 2e3 * pot, 0.0), 0.0)
    force += 0.1 * np.random.default_rng(8).standard_normal(t.size)
    return from_arrays("rested", t, x, force)


def test_a_springpot_is_named_where_the_tool_had_rested_in_the_body() -> None:
    found = diagnose(springpot(), "kelvin-voigt", surface=0.0).answer
    assert found["class"][0] == ["fractional_relaxation"]
