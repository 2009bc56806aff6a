"""A pair whose second member does nothing is a better descent of the first."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.inference.needed import needed_pairs
from teleop_rt.diagnosis.inference.ranking import Ranking
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.noise.encoder import input_errors
from teleop_rt.diagnosis.noise.structure import lack_of_fit, tangent_space
from teleop_rt.diagnosis.recordings.recording import from_arrays
from teleop_rt.diagnosis.samples.preparation import problem_of
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
    pairs, (best, *_) = needed_pairs(rank, left, [stuck], (offset, bias))
    assert pairs == []
    assert abs(best.fit.zeta[0] - SHIFT_M) < 1e-5
    assert best.fit.chi2 < 0.5 * stuck.fit.chi2


def test_the_likelihood_decides_between_a_needed_pair_and_its_special_case() -> None:
    """A friction that absorbs more of a bias gains less by it, and is no less likely."""
    row = campaign.run(campaign.plan("pair", 0, 9301))
    assert row["class"] == [["coulomb_friction", "force_bias"]]
