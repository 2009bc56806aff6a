"""A search at a lower rate sees the same as at the full one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from teleop_rt.contact.effects import LIBRARY, find
from teleop_rt.diagnosis.inference.coarse import at_lower_rates, coarsened
from teleop_rt.diagnosis.inference.one_more import coarse_one_more
from teleop_rt.diagnosis.inference.screening import screen
from teleop_rt.diagnosis.inference.search import fit_base, search_singles
from teleop_rt.diagnosis.inference.starts import Start
from teleop_rt.diagnosis.inference.swings import swings
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.recordings.recording import from_arrays

NOISE_N = 0.02
NAMES = ("nonlinear_stiffening", "force_bias", "hysteresis", "channel_delay", "backlash")
FEW = tuple(law for law in LIBRARY if law.name in NAMES)


def posed(rate_hz: float, samples: int) -> tuple[Problem, Fit]:
    """Return taps on a damped spring that stiffens, and the fit of the base, which does not."""
    t = np.arange(samples) / rate_hz
    x = 0.008 * np.sin(2 * np.pi * 0.7 * t) + 0.003 * np.sin(2 * np.pi * 1.9 * t) - 0.002
    v = np.gradient(x, t)
    force = np.where(x > 0.0, 900.0 * x + 2e4 * x**2 + 15.0 * v, 0.0)
    force += NOISE_N * np.random.default_rng(8).standard_normal(samples)
    base = base_of("kelvin-voigt")
    problem = problem_of(from_arrays("taps", t, x, force), base, 0.0)
    return problem, fit_base(problem, base)


def gains(starts: list[Start]) -> dict[tuple[str, str], float]:
    return {(start.effect.name, start.effect.law): start.gain for start in starts}


@pytest.mark.parametrize(("rate_hz", "samples"), [(1000.0, 9999), (1000.0, 10000), (2e3, 16000)])
def test_a_force_within_the_band_is_the_same_at_either_rate(rate_hz: float, samples: int) -> None:
    problem, _ = posed(rate_hz, samples)
    coarse, t = coarsened(problem), problem.motion.t
    force = np.sin(2 * np.pi * 3.0 * t) + 0.2 * np.cos(2 * np.pi * 71.0 * t)
    whole = coarse.finely(force[: coarse.finely.mask.size])
    slow = coarse.whitener(np.interp(coarse.motion.t, t, force))
    assert coarse.motion.dt == pytest.approx(4e-3)
    # The end of a hole falls between two slow samples: so many samples are counted otherwise.
    mask = problem.whitener.mask
    ends = np.count_nonzero(np.diff(mask)) * round(coarse.motion.dt * rate_hz) / 2
    assert np.linalg.norm(slow - whole) < np.sqrt(ends / samples) * np.linalg.norm(whole)
    bins = coarse.whitener.bins
    same = problem.whitener(force).reshape(2, -1)[:, :bins].ravel()
    assert np.linalg.norm(whole) == pytest.approx(np.linalg.norm(same), rel=0.01)


@pytest.mark.parametrize("rate_hz", [1000.0, 2000.0])
def test_without_holes_the_rates_differ_by_less_than_a_hundredth(rate_hz: float) -> None:
    problem, _ = posed(rate_hz, 8000)
    whole = np.ones_like(problem.whitener.mask)
    problem = problem.keeping(whole)
    coarse, t = coarsened(problem), problem.motion.t
    force = np.sin(2 * np.pi * 3.0 * t) + 0.2 * np.cos(2 * np.pi * 71.0 * t)
    fine, slow = coarse.finely(force), coarse.whitener(np.interp(coarse.motion.t, t, force))
    assert np.linalg.norm(slow - fine) < 0.01 * np.linalg.norm(fine)


def test_the_fit_has_the_residual_of_the_full_rate() -> None:
    problem, fit = posed(1000.0, 10000)
    near, there = coarsened(problem).around(problem, fit)
    assert there.theta == pytest.approx(fit.theta, rel=0.02)
    lowest = fit.residual.reshape(2, -1)[:, : near.whitener.bins].ravel()
    assert np.linalg.norm(there.residual - lowest) < 0.02 * np.linalg.norm(lowest)


def test_the_screened_gain_equals_that_of_the_full_rate() -> None:
    problem, fit = posed(1000.0, 9999)
    names = ("nonlinear_stiffening", "stress_relaxation", "series_compliance", "force_lag")
    laws = tuple(law for law in LIBRARY if law.name in names)
    near, there = coarsened(problem).around(problem, fit)
    fine, slow = (
        gains(starts) for starts in (screen(problem, fit, laws), screen(near, there, laws))
    )
    for law, gain in fine.items():
        assert slow.get(law, 0.0) == pytest.approx(gain, rel=0.1, abs=0.03 * max(fine.values()))


def test_the_gain_of_a_contact_shift_is_kept_while_its_jumps_are_resolved() -> None:
    problem, fit = posed(1000.0, 9999)
    names = ("channel_delay", "backlash", "moving_surface", "permanent_set")
    laws = tuple(law for law in LIBRARY if law.name in names and not swings(law))
    near, there = at_lower_rates(problem)[0].around(problem, fit)
    assert near.motion.dt == pytest.approx(2e-3)
    fine, slow = (
        gains(starts) for starts in (screen(problem, fit, laws), screen(near, there, laws))
    )
    for law, gain in fine.items():
        assert slow.get(law, 0.0) == pytest.approx(gain, rel=0.1, abs=0.03 * max(fine.values()))


def test_the_coarse_search_finds_a_pair_near_its_optimum() -> None:
    problem, _ = posed(1000.0, 9999)
    problem = replace(problem, force=problem.force + 0.5)
    fit = fit_base(problem, base_of("kelvin-voigt"))
    singles = search_singles(problem, fit, FEW)
    seen = coarse_one_more(problem, fit, singles, FEW)[0]
    assert set(seen.names) == {"nonlinear_stiffening", "force_bias"}
    there = problem.solve(seen.model, seen.zeta, seen.theta)
    assert there.chi2 < 1.01 * there.effective


def test_a_slow_recording_keeps_its_rate() -> None:
    problem, fit = posed(250.0, 2501)
    near, there = coarsened(problem).around(problem, fit)
    assert near.motion.x.size == problem.motion.x.size
    assert there.residual == pytest.approx(fit.residual, abs=1e-9)


def test_a_long_recording_of_a_slow_machine_is_decimated() -> None:
    problem, _ = posed(100.0, 24_000)
    jumps, least = at_lower_rates(problem)
    assert jumps.motion.x.size == 12_000
    assert least.motion.x.size == 6_000


def test_rows_on_a_grid_are_computed_once() -> None:
    problem, fit = posed(1000.0, 9999)
    coarse = coarsened(problem)
    model = CandidateModel(base_of("kelvin-voigt"))
    near, _ = coarse.around(problem, problem.solve(model, np.zeros(0)))
    law = find("stress_relaxation", "one arm")
    rows = near.rows_of(law, [np.array([0.1]), np.array([1.0])])
    again, _ = coarse.around(problem, fit)
    assert again.rows_of(law, []) is rows
