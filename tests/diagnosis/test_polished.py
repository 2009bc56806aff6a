"""A damper's force jumps at a contact: chi-square is rough in where the surface lies."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.inference.polishing import polished
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.motions import jumping

SHIFT_M = 4e-4


def test_a_surface_error_of_micrometres_is_corrected() -> None:
    t, x, force = jumping(SHIFT_M, noise=1e-3)
    problem = problem_of(from_arrays("jump", t, x, force), base_of("kelvin-voigt"), 0.0)
    model = CandidateModel(base_of("kelvin-voigt"), (find("contact_offset"),))
    stuck = problem.solve(model, np.array([SHIFT_M - 2e-5]))
    found = polished(problem, stuck)
    assert stuck.chi2 > 100.0 * problem.whitener.effective
    assert found.chi2 < 2.0 * problem.whitener.effective
    assert abs(found.zeta[0] - SHIFT_M) < 3e-5
