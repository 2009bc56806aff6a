"""A tool that first rests just inside the surface: too little motion for a power law, then more."""

import numpy as np
import pytest

from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.report import identified, report_row
from teleop_rt.estimation.rows import rows_for
from teleop_rt_dev.estimation.plant import Press, kelvin_voigt

from .cube_rig import SETTINGS

SURFACE = Press().surface
REST = SURFACE + 0.26e-3
IN_AIR = SURFACE - 2e-3
DT = SETTINGS.period_s
FALLING = (0, 3)
"""Of the seeds 0 to 5, those whose noise makes the force seem to fall with the depth at rest."""


@pytest.fixture(scope="module")
def pipeline():
    return Pipeline(rows_for(["hunt-crossley"], ["direct"], ["rls"]), SETTINGS)


def feed(pipeline, position, seed):
    """Run a motion, pressing on the cube, through a new pipeline."""
    rng = np.random.default_rng(seed)
    force = kelvin_voigt(position - SURFACE, np.gradient(position, DT))
    force += SETTINGS.force_noise * rng.standard_normal(force.size)
    resolution = SETTINGS.position_resolution
    measured = np.round(position / resolution) * resolution
    pipeline.reset()
    pipeline.run(measured, force, np.ones(force.size, dtype=bool))


def rested():
    """Return the positions of an approach, a rest of 0.12 s just inside, and a withdrawal."""
    way_in, way_out = np.linspace(0.0, REST, 300), np.linspace(REST, IN_AIR, 100)
    return np.concatenate([np.zeros(300), way_in, np.full(120, REST), way_out])


def pressed():
    """Return the positions of three seconds of presses, 6 mm deep at 2 Hz, out of free air."""
    angle = 2 * np.pi * 2.0 * DT * np.arange(3000)
    return IN_AIR + 4e-3 * (1.0 - np.cos(angle))


@pytest.mark.parametrize("seed", FALLING)
def test_an_exponent_below_zero_is_not_identified(pipeline, seed):
    feed(pipeline, rested(), seed)
    row = report_row(pipeline, 0, "m", "N")
    assert row["parameters"]["n"]["value"] < 0.0
    assert row["parameters"]["n"]["identified"] is False
    assert not identified(row)


@pytest.mark.parametrize("seed", range(6))
def test_the_power_law_is_estimated_from_the_presses_after_a_rest(pipeline, seed):
    feed(pipeline, np.concatenate([rested(), pressed()]), seed)
    row = report_row(pipeline, 0, "m", "N")
    assert row["parameters"]["n"]["value"] == pytest.approx(1.0, abs=0.05)
    assert row["parameters"]["k"]["value"] == pytest.approx(3600.0, rel=0.1)
    assert identified(row)
