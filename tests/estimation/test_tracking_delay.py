"""How far estimators run behind a body whose stiffness changes, computed from the data alone."""

import numpy as np
import pytest

from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.report import report_with_delays
from teleop_rt.estimation.rows import rows_for
from teleop_rt.estimation.tracking import reference_stiffness, varies

RATE_HZ = 1000
SETTINGS = PipelineSettings(
    period_s=1 / RATE_HZ,
    position_resolution=5e-6,
    force_noise=0.05,
    onset_force=0.4,
    release_force=0.2,
    forgetting_factor=0.99,
    surface=0.0,
)


def pressed(stiffness_after, seconds=16.0):
    """k = 1500 N/m until half time, b = 30 N s/m, 3 Hz within contact."""
    rng = np.random.default_rng(5)
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    x = 0.012 + 0.008 * np.sin(2 * np.pi * 3 * t)
    v = 0.008 * 2 * np.pi * 3 * np.cos(2 * np.pi * 3 * t)
    k = np.where(t < seconds / 2, 1500.0, stiffness_after)
    force = k * x + 30 * v + rng.normal(0, 0.05, t.size)
    return t, x, v, k, force


def delays_of(stiffness_after, solvers):
    _, x, _, _, force = pressed(stiffness_after)
    pipeline = Pipeline(rows_for(["kelvin-voigt", "hunt-crossley"], ["direct"], solvers), SETTINGS)
    trace = pipeline.run(x, force, np.ones(x.size, dtype=bool))
    rows = report_with_delays(pipeline, trace)
    return {(row["model"], row["solver"]): row["tracking_delay_s"] for row in rows}


def test_the_reference_follows_a_step_without_delay():
    t, x, v, k, force = pressed(2500.0)
    reference, deviation = reference_stiffness(x, v, force, np.ones(t.size, dtype=bool), 250)
    assert varies(reference, deviation)
    away = np.abs(t - 8.0) > 0.3
    assert np.abs(reference - k)[away].max() < 10.0
    crossing = t[np.flatnonzero(reference > 2000.0)[0]]
    assert crossing == pytest.approx(8.0, abs=0.1)


def test_a_step_gives_each_row_its_delay_and_forgetting_rows_the_short_one():
    delays = delays_of(2500.0, ["rls", "sprls"])
    assert 0.0 <= delays["kelvin-voigt", "rls"] < 0.4
    assert delays["hunt-crossley", "rls"] is None


def test_a_body_that_does_not_change_has_no_delay_to_report():
    delays = delays_of(1500.0, ["rls"])
    assert set(delays.values()) == {None}


def test_less_than_half_a_window_of_contact_is_no_reference():
    t, x, v, _, force = pressed(2500.0)
    usable = t % 1.0 < 0.1
    reference, _ = reference_stiffness(x, v, force, usable, 250)
    assert not np.any(np.isfinite(reference))
