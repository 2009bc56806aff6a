"""A row that a newer surface made less certain is reported with the deviations it has then."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.estimation.contact_edges import soften_rows
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.report import identified, report_row
from teleop_rt.estimation.rows import rows_for
from teleop_rt.trial.table import estimator_lines

PERIOD_S, NOISE_N = 1e-3, 0.05
STIFFNESS, DAMPING = 3600.0, 20.0
TRUE_SURFACE, TAKEN_SURFACE = 0.0, 1.5e-4


def pressed(seed, *, seconds=4.0, taken=TAKEN_SURFACE):
    """Return a pipeline after a contact whose surface is taken for another than it is."""
    settings = PipelineSettings(
        period_s=PERIOD_S, position_resolution=5e-6, force_noise=NOISE_N, onset_force=0.4,
        release_force=0.2, surface=taken,
    )  # fmt: skip
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), settings)
    feed(pipeline, seed, 0.0, seconds)
    return pipeline


def feed(pipeline, seed, begin_s, seconds):
    t = begin_s + np.arange(0.0, seconds, PERIOD_S)
    depth, speed = 4e-3 + 3e-3 * np.sin(20.0 * t), 6e-2 * np.cos(20.0 * t)
    force = STIFFNESS * depth + DAMPING * speed
    force += NOISE_N * np.random.default_rng(seed).standard_normal(t.size)
    for x, f in zip(TRUE_SURFACE + depth, force, strict=True):
        pipeline.update(x, f, True)  # noqa: FBT003 - the axis's flag


@pytest.mark.parametrize("seed", range(5))
def test_a_row_whose_surface_was_found_elsewhere_has_its_value_with_a_wider_deviation(seed):
    pipeline = pressed(seed)
    before = report_row(pipeline, 0, "m", "N")
    assert before["status"] == "estimated"
    narrow = before["parameters"]["k"]["std"]
    assert abs(before["parameters"]["k"]["value"] - STIFFNESS) > 3.0 * narrow, "a wrong surface"
    soften_rows(pipeline.stored[0], TAKEN_SURFACE - TRUE_SURFACE)
    feed(pipeline, seed + 100, 4.0, 4 * PERIOD_S)
    row = report_row(pipeline, 0, "m", "N")
    assert (pipeline.status[0], row["status"]) == ("warming up", "uncertain")
    for name, true in (("k", STIFFNESS), ("b", DAMPING)):
        found = row["parameters"][name]
        assert abs(found["value"] - true) < 2.0 * found["std"]
    assert row["parameters"]["k"]["std"] > 3.0 * narrow
    assert not identified(row)
    whole = {**row, "convergence_s": None}
    first, *parameters = estimator_lines({"selected": None, "estimators": [whole]})
    assert "uncertain since the surface was found elsewhere" in first
    assert len(parameters) == 2


def test_a_row_that_was_never_ready_has_no_value():
    row = report_row(pressed(0, seconds=0.05), 0, "m", "N")
    assert row["status"] == "warming up"
    assert all(one["value"] is None for one in row["parameters"].values())
