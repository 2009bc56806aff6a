"""A pair whose second member does nothing is a better descent of the first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import TransferFunction, lsim

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.needed import needed_sets
from teleop_rt.diagnosis.inference.ranking import Ranking
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.inference.second import all_needed
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.noise.encoder import input_errors
from teleop_rt.diagnosis.noise.structure import lack_of_fit, tangent_space
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.campaign import diagnosis as campaign
from teleop_rt_dev.diagnosis.motions import jumping

SHIFT_M = 4e-4
STEP_M = 1e-7


def test_a_single_fit_in_a_local_minimum_is_improved_by_a_pair() -> None:
    t, x, force = jumping(SHIFT_M, noise=1e-2)
    recording = from_arrays("jump", t, np.round(x / STEP_M) * STEP_M, force)
    problem = problem_of(recording, base_of("kelvin-voigt"), 0.0)
    offset, bias = find("contact_offset"), find("force_bias")
    alone = fit_base(problem, base_of("kelvin-voigt"))
    rank = Ranking(problem, alone, input_errors(problem.motion, recording), STEP_M)
    stuck = rank(
        problem.solve(CandidateModel(base_of("kelvin-voigt"), (offset,)), np.array([SHIFT_M / 2]))
    )
    left = lack_of_fit(problem, alone, tangent_space(problem, alone))
    pairs, (best, *_) = needed_sets(rank, left, [stuck], (offset, bias))
    assert pairs == []
    assert abs(best.fit.zeta[0] - SHIFT_M) < 1e-5
    assert best.fit.chi2 < 0.5 * stuck.fit.chi2


def test_a_fit_whose_parameters_are_all_zero_is_ranked_where_the_noise_is_uneven() -> None:
    """The signs of a base and of an effect may hold all their parameters at 0."""
    t, x, force = jumping(0.0, noise=1e-2)
    base = base_of("kelvin-voigt")
    recording = from_arrays("uneven", t, x, force)
    problem = problem_of(recording, base, 0.0)
    uneven = replace(problem.whitener, level=np.linspace(0.5, 1.5, t.size))
    problem = replace(problem, whitener=uneven)
    alone = fit_base(problem, base)
    rank = Ranking(problem, alone, input_errors(problem.motion, recording), STEP_M)
    dry = problem.solve(CandidateModel(base, (find("viscous_friction"),)), np.zeros(0))
    nothing = replace(dry, theta=np.zeros(dry.theta.size), residual=problem.target)
    ranked = rank(nothing)
    assert ranked.gain < 0.0
    assert ranked.noise_per_direction == ranked.left.noise_per_direction


def test_a_pair_is_compared_with_effects_whose_amplitudes_are_zero() -> None:
    """The sign of an amplitude may hold it at 0: such an effect has no force, and no form errors.

    A weight that looked like a held body left single fits of this kind.
    """
    t, x, force = jumping(0.0, noise=1e-2)
    base = base_of("kelvin-voigt")
    recording = from_arrays("rubs", t, x, force + 0.3 + 8.0 * np.gradient(x, t))
    problem = problem_of(recording, base, 0.0)
    alone = fit_base(problem, base)
    rank = Ranking(problem, alone, input_errors(problem.motion, recording), STEP_M)
    *effects, rival = map(find, ("force_bias", "viscous_friction", "quadratic_damping"))

    def solved(*effects: Effect) -> Fit:
        return problem.solve(CandidateModel(base, effects), np.zeros(0))

    pair = rank(solved(*effects))
    singles = {frozenset({rival.name}): rank(solved(rival))}
    for effect in effects:
        fit = solved(effect)
        without_force = replace(fit, theta=np.append(alone.theta, 0.0), residual=alone.residual)
        singles[frozenset({effect.name})] = rank(without_force)
    assert all_needed(problem, pair, singles, pair.gain, 0.0)


def test_the_likelihood_decides_between_a_needed_pair_and_its_special_case() -> None:
    """A friction that absorbs more of a bias gains less by it, and is no less likely."""
    row = campaign.run(campaign.plan("pair", 0, 9301))
    assert row["class"] == [["coulomb_friction", "force_bias"]]


def stiff_body() -> tuple[Vector, Vector, Vector, Vector]:
    """Return time [s], position [m], velocity [m/s] and force [N] of a cubic body, with noise."""
    t = np.arange(8000, dtype=np.float64) * 2e-3
    x, v = np.zeros(t.size), np.zeros(t.size)
    for size, hertz, phase in ((4e-3, 0.35, 0.0), (1.5e-3, 1.3, 1.0), (0.7e-3, 2.9, 2.0)):
        rate = 2.0 * np.pi * hertz
        x += size * np.sin(rate * t + phase)
        v += rate * size * np.cos(rate * t + phase)
    noise = 0.01 * np.random.default_rng(5).standard_normal(t.size)
    return t, x, v, 700.0 * x + 2.0 * v + 9e7 * x**3 + noise


@pytest.mark.parametrize(("friction", "peak"), [(0.4, 0.6), (0.2, 1.0)])
def test_a_small_friction_with_a_peak_is_named_beside_a_large_stiffening(
    friction: float, peak: float
) -> None:
    """It is 30 times the noise, but less than one percent of the energy that the base leaves.

    Of the first, Coulomb friction was named; the second was not searched.
    """
    t, x, v, body = stiff_body()
    rubs = friction * np.tanh(v / 5e-4) * (1.0 + peak * np.exp(-((v / 8e-3) ** 2)))
    answer = diagnose(from_arrays("rubs", t, x, body + rubs), "spring,viscous,bias").answer
    assert answer["verdict"] == "named"
    assert set(answer["class"][0]) == {"nonlinear_stiffening", "stribeck_friction"}
    assert answer["error"]["after_over_floor"] < 1.1


def test_a_ripple_is_named_beside_a_lag_of_a_thousand_times_its_energy() -> None:
    """It passes the lag as well; the lag alone left 4.5 times the noise.

    The recording begins while the channel follows a motion: at rest at its start, the simulated
    lag left 16 times the noise in the first second.
    """
    t = np.arange(2700, dtype=np.float64) * 1e-2
    x = sum(size * np.sin(2.0 * np.pi * hertz * t + phase) for size, hertz, phase in (
        (6e-4, 0.21, 0.0), (3e-4, 0.63, 1.0), (1.5e-4, 1.7, 2.0), (8e-5, 3.1, 0.5)))  # fmt: skip
    before = 3224.0 * x + 32.6 * np.gradient(x, t) + 0.05 * np.sin(2.0 * np.pi * x / 3.1e-4)
    corner = 2.0 * np.pi * 2.67
    late = lsim(TransferFunction([corner**2], [1.0, 1.4 * corner, corner**2]), before, t)[1]
    force = late + 3.3e-3 * np.random.default_rng(2).standard_normal(t.size)
    settled = slice(200, None)
    position = 5e-7 * np.round(x / 5e-7)
    made = from_arrays("lag", t[settled], position[settled], force[settled])
    answer = diagnose(made, "spring,viscous,bias").answer
    assert answer["class"] == [["force_lag", "position_ripple"]]
    assert answer["error"]["after_over_floor"] < 1.03


def test_a_name_that_leaves_thirty_times_the_noise_is_partly_named() -> None:
    """Bias, drift, friction and a tone beside a stiff cubic body: one more than are searched."""
    t, x, v, body = stiff_body()
    tone = 0.3 * np.sin(2.0 * np.pi * 5.3 * t) * np.sin(0.4 * t) ** 2
    force = body + 0.3 + 0.2 * t / 16.0 + 0.4 * np.tanh(v / 5e-4) + tone
    answer = diagnose(from_arrays("drifts", t, x, force), "spring,viscous").answer
    assert answer["error"]["after_over_floor"] > 2.0
    assert answer["verdict"] in {"partial", "class", "unexplained"}
    assert all(chance <= 0.5 for chance in answer["probability"].values())


def test_a_layer_that_is_never_reached_is_no_third_effect() -> None:
    """A bias and a drift beside a stiff cubic body: a layer far outside the travel is a bias."""
    t, x, _, body = stiff_body()
    force = body + 0.3 + 0.2 * t / 16.0
    answer = diagnose(from_arrays("drifts", t, x, force), "spring,viscous").answer
    names = {effect["name"] for effect in answer["effects"]}
    assert names == {"nonlinear_stiffening", "force_bias", "force_drift"}
    assert answer["error"]["after_over_floor"] < 1.05


def test_the_law_of_a_partner_is_searched_again_within_its_family() -> None:
    """The power law stood beside another stiffening alone, and one arm was as likely."""
    rng, dt = np.random.default_rng(3), 6e-3
    t, order = dt * np.arange(2000), 0.2
    rates = rng.uniform(0.05, 2.0, 7)
    x = sum(rng.uniform(0.3, 1.0) * np.sin(2.0 * np.pi * f * t + rng.uniform(0, 6)) for f in rates)
    x = (2e-3 * x / np.max(np.abs(x)) + 5e-4) * np.clip(t / 0.5, 0.0, 1.0)
    depth = np.maximum(x, 0.0)
    steps = np.arange(1, t.size)
    weights = np.cumprod(np.concatenate([[1.0], (steps - 1 - order) / steps]))  # Gruenwald
    creeping = np.convolve(depth, weights)[: t.size] * dt**-order
    body = 800.0 * depth + 3e8 * depth**3 + 500.0 * creeping
    force = np.where(x > 0.0, np.maximum(body, 0.0), 0.0) + 4e-3 * rng.standard_normal(t.size)
    answer = diagnose(from_arrays("creeping", t, x, force)).answer
    assert [sorted(names) for names in answer["class"]] == [
        ["fractional_relaxation", "nonlinear_stiffening"]
    ]
    assert answer["error"]["after_over_floor"] < 1.1
