"""Runs measured on real machines replay without a fault."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.report import report
from teleop_rt.estimation.rows import REGRESSIONS, SOLVERS, rows_for

from .test_hostile import MODELS, assert_sound

DATA = os.environ.get("TELEOP_RT_DATA")
pytestmark = pytest.mark.skipif(
    DATA is None, reason="measured data not found: set TELEOP_RT_DATA to the folder that holds them"
)
RUNS = (
    "run_a_foam", "run_a_free_motion", "run_a_rigid", "run_a_spring", "run_c_foam2",
    "run_c_spring", "run_e_free_motion",
)  # fmt: skip
SETTINGS = PipelineSettings(
    period_s=5e-4,
    position_resolution=2.09e-5,
    force_noise=2e-3,
    onset_force=0.05,
    release_force=0.02,
)


def load(name):
    with (Path(DATA) / "tue_teleop" / f"{name}.csv").open() as file:
        rows = list(csv.reader(file))
    values = np.array(rows[1:], dtype=float)
    column = rows[0].index
    position, force = values[:, column("xs_rad")], values[:, column("Fe_Nm")]
    return position, force, np.ones(len(force), dtype=bool)


@pytest.mark.parametrize("name", RUNS)
def test_a_measured_run_replays_without_a_fault(name):
    pipeline = Pipeline(rows_for(MODELS, REGRESSIONS, SOLVERS), SETTINGS)
    pipeline.run(*load(name))
    assert_sound(pipeline)


def test_the_measured_spring_never_leaves_contact_and_has_its_stiffness():
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), SETTINGS)
    pipeline.run(*load("run_a_spring"))
    assert not pipeline.contact.surface_known
    assert "never leaves contact" in pipeline.surface_reason
    parameters = report(pipeline, "rad", "Nm")[0]["parameters"]
    assert 2 <= parameters["k"]["value"] <= 5
    assert parameters["k"]["unit"] == "Nm/rad"
    assert parameters["b"]["std"] > 0
    significant = parameters["b"]["value"] > 2 * parameters["b"]["std"]
    assert parameters["b"]["identified"] is significant
    assert parameters["offset"]["unit"] == "Nm"
