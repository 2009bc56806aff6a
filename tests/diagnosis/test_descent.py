"""The fit's own descent ends where a library's does, also at bounds and from afar."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
import scipy

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.contact.effects import LIBRARY, find
from teleop_rt.diagnosis.inference.screening import screen
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.axes import grid
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import CandidateModel, bounds, nonlinear_amplitude
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.plants import make

# In each the shape is between the bounds; in the last pair the other law drives it to one.
FITS = [
    ("stress_relaxation", "stress_relaxation"),
    ("nonlinear_stiffening", "nonlinear_stiffening"),
    ("second_layer", "second_layer"),
    ("force_lag", "force_lag"),
    ("channel_delay", "channel_delay"),
    ("coulomb_friction", "stribeck_friction"),
    ("force_bias", "force_drift"),
    ("contact_offset", "mullins_softening"),
]


def laws(name: str) -> list[Effect]:
    """Return the laws of an effect with something to search, for a base that touches."""
    searched = (e for e in LIBRARY if e.shapes or nonlinear_amplitude(e))
    return [effect for effect in searched if effect.name == name and not effect.without_contact]


def by_library(problem: Problem, model: CandidateModel, start: Vector) -> float:
    """Least chi-square by scipy's trust region, derivatives by differences of the whole fit."""
    edges = [bounds(c.shape, problem.motion.scales) for c in model.coordinates]
    lower, upper = np.array(edges).T

    def residual(place: Vector) -> Vector:
        return problem.solve(model, lower + place * (upper - lower)).residual

    place = np.clip((start - lower) / (upper - lower), 1e-3, 1.0 - 1e-3)
    found = scipy.optimize.least_squares(
        residual, place, bounds=(0.0, 1.0), diff_step=1e-4, max_nfev=60
    )
    return 2.0 * float(found.cost)


def begun(problem: Problem, model: CandidateModel) -> Vector | None:
    """Return the first place of the grid where no sign holds the effect at 0, as a search does."""
    axes = [grid(coordinate.shape, problem.motion.scales) for coordinate in model.coordinates]
    places = (np.array(place) for place in product(*axes))
    own = [linear.owner >= 0 for linear in model.linear]
    acting = (p for p in places if np.all(problem.solve(model, p).theta[own] != 0.0))
    return next(acting, None)


def posed(truth: str, fitted: str) -> tuple[Problem, list[tuple[CandidateModel, Vector]]]:
    """Return a recording with the true effect, and the starts of all laws of the fitted one."""
    record = make(5, (truth,), "silicone", size=0.15, noise=0.01, seconds=5.0)
    base = base_of(record.base)
    recording = from_arrays("record", record.t, record.position, record.force)
    problem = problem_of(recording, base, 0.0)
    models = [CandidateModel(base, (law,)) for law in laws(fitted)]
    starts = [(model, begun(problem, model)) for model in models]
    assert starts[0][1] is not None
    # A tangent that falls has no start where the force rises.
    return problem, [(model, start) for model, start in starts if start is not None]


@pytest.mark.parametrize(("truth", "fitted"), FITS)
def test_the_descent_reaches_what_a_library_reaches(truth: str, fitted: str) -> None:
    problem, starts = posed(truth, fitted)
    for model, start in starts:
        own = problem.refine(model, start, evaluations=40).chi2
        other = by_library(problem, model, start)
        assert own < other + 0.02 * (problem.solve(model, start).chi2 - other) + 1.0


@pytest.mark.parametrize("truth", [truth for truth, fitted in FITS if truth == fitted])
def test_a_descent_that_ends_at_the_fit_to_beat_is_not_abandoned(truth: str) -> None:
    problem, starts = posed(truth, truth)
    for model, start in starts:
        whole = problem.refine(model, start)
        assert problem.refine(model, start, beat=whole.chi2).chi2 == whole.chi2


def test_a_descent_far_above_the_fit_to_beat_ends_early(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, ((model, start), *_) = posed("nonlinear_stiffening", "force_lag")
    right = problem.refine(*posed("nonlinear_stiffening", "nonlinear_stiffening")[1][0])
    solved, solve = [], Problem.solve

    def noted(problem: Problem, *arguments: Any) -> Fit:
        solved.append(solve(problem, *arguments))
        return solved[-1]

    monkeypatch.setattr(Problem, "solve", noted)
    whole = problem.refine(model, start)
    in_all = len(solved)
    abandoned = problem.refine(model, start, beat=right.chi2)
    assert whole.chi2 > 2.0 * right.chi2
    assert len(solved) - in_all < in_all
    assert abandoned.chi2 < solved[in_all].chi2


def test_a_negative_damping_takes_no_energy_from_a_delay() -> None:
    """The base's damping is held at 0 where a late force asks for less."""
    rng = np.random.default_rng(3)
    t = np.arange(8000) * 1e-3
    x = 4e-3 + 2e-3 * np.sin(2 * np.pi * 1.3 * t) + 1e-3 * np.sin(2 * np.pi * 4.1 * t)
    late = np.interp(t - 2e-3, t, x)
    force = 25_000.0 * late + 0.1 * rng.standard_normal(t.size)
    base = replace(base_of("kelvin-voigt"), finds_surface=True)
    problem = problem_of(from_arrays("late", t, x, force), base, 0.0, within=5e-4)
    alone = fit_base(problem, base)
    assert alone.theta[1] == 0.0
    excess = alone.chi2 - alone.effective
    found = screen(problem, alone, (find("channel_delay"),))
    assert found[0].gain > 0.8 * excess
