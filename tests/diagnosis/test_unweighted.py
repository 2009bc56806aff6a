"""A set that takes little off the plain residual is no explanation, whatever its likelihood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.confirmed import confirmed_unweighted
from teleop_rt.diagnosis.inference.ranked import Ranked
from teleop_rt.diagnosis.inference.verdict import Judgement
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Problem
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.noise.structure import LackOfFit
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.recordings.recording import from_arrays

NOISE_N, BASE = 0.02, base_of("kelvin-voigt")


def biased() -> Problem:
    """Return presses on a spring and a damper, read with a bias of ten deviations of the noise."""
    t = np.arange(0.0, 8.0, 2e-3)
    x = 0.004 * np.sin(2 * np.pi * 0.7 * t) + 0.001 * np.sin(2 * np.pi * 3.1 * t)
    force = np.where(x > 0.0, 800.0 * x + 6.0 * np.gradient(x, t), 0.0) + 10.0 * NOISE_N
    force += NOISE_N * np.random.default_rng(2).standard_normal(t.size)
    return problem_of(from_arrays("biased", t, x, force), BASE, 0.0)


def ranked(problem: Problem, name: str) -> Ranked:
    effect = find(name)
    zeta = np.full(len(CandidateModel(BASE, (effect,)).coordinates), 1e-3)
    fit = problem.refine(CandidateModel(BASE, (effect,)), zeta)
    return Ranked(fit, 100.0, 100.0, LackOfFit(0.0, 10))


def judged(problem: Problem, *names: str) -> Judgement:
    sets = tuple(ranked(problem, name) for name in names)
    judgement = Judgement("named" if len(sets) == 1 else "class", sets, None, 100.0)
    base = problem.refine(CandidateModel(BASE), np.zeros(0))
    return confirmed_unweighted(judgement, problem, base, NOISE_N, NOISE_N)


def test_a_name_that_leaves_the_force_as_far_off_is_a_part_at_most() -> None:
    assert judged(biased(), "quadratic_damping").verdict == "partial"


def test_of_a_class_those_stay_that_take_most_of_it_off() -> None:
    found = judged(biased(), "quadratic_damping", "force_bias")
    assert found.verdict == "named"
    assert found.sets[0].fit.names == ("force_bias",)


def test_a_name_that_takes_it_off_stays() -> None:
    assert judged(biased(), "force_bias").verdict == "named"


def test_a_stiffness_that_wanders_is_not_taken_for_slow_noise_which_free_air_would_show() -> None:
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 8.0, 2e-3)
    x = 0.004 * np.sin(2 * np.pi * 0.7 * t) + 0.001 * np.sin(2 * np.pi * 3.1 * t)
    wander = 1.0 + 3e-3 * np.cumsum(rng.standard_normal(t.size))
    force = np.where(x > 0.0, 800.0 * wander * x + 6.0 * np.gradient(x, t), 0.0)
    force += NOISE_N * rng.standard_normal(t.size)
    answer = diagnose(from_arrays("wanders", t, x, force), surface=0.0).answer
    assert answer["verdict"] in {"partial", "unexplained"}


def test_a_name_taken_back_is_judged_beside_something_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def taken_back(judgement: Judgement, *_: object) -> Judgement:
        return replace(judgement, verdict="partial", sets=judgement.sets[:1])

    problem = biased()
    recording = from_arrays("biased", problem.motion.t, problem.motion.x, problem.force)
    found = diagnose(recording, surface=0.0)
    assert found.answer["class"]
    assert found.predictor is None  # no set was sought beside something unknown
    monkeypatch.setattr("teleop_rt.diagnosis.inference.confirmed.confirmed_unweighted", taken_back)
    found = diagnose(recording, surface=0.0)
    assert found.predictor is not None or found.answer["verdict"] == "unexplained"
