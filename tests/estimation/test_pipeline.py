import math

import numpy as np
import pytest

from teleop_rt.estimation.layout import WHOLE
from teleop_rt.estimation.parameters import leading, physical_over_time, traced_names
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.report import report
from teleop_rt.estimation.rows import rows_for, whole_for
from teleop_rt.estimation.trace import Trace
from teleop_rt_dev.estimation.plant import Press, hunt_crossley, kelvin_voigt, record

from .cube_rig import SETTINGS
from .streamed_wall import streamed

ROWS = rows_for(
    ["kelvin-voigt", "mass-spring-damper", "hunt-crossley"], ["direct", "algebraic"], ["rls"]
)


@pytest.fixture(scope="module")
def silicone():
    pipeline = Pipeline(ROWS, SETTINGS)
    pipeline.run(*record(Press(), kelvin_voigt))
    return pipeline


def test_silicone_stiffness_damping_and_surface_are_found(silicone):
    row = report(silicone)[0]
    assert row["status"] in {"estimated", "held"}
    assert row["parameters"]["k"]["value"] == pytest.approx(3600, rel=0.003)
    assert row["parameters"]["b"]["value"] == pytest.approx(20, rel=0.03)
    assert silicone.contact.surface == pytest.approx(Press().surface, abs=2e-5)
    assert silicone.onsets == 3


def test_soft_short_motion_is_found_as_well():
    pipeline = Pipeline(ROWS[:1], SETTINGS)
    pipeline.run(*record(Press(mean=0.005, amplitude=0.002), kelvin_voigt))
    _, (k, b), _ = pipeline.estimate(0)
    assert k == pytest.approx(3600, rel=0.003)
    assert b == pytest.approx(20, rel=0.03)


def test_hunt_crossley_is_found_and_streamed_where_it_is_the_truth():
    pipeline = Pipeline(ROWS, SETTINGS)
    pipeline.run(*record(Press(), hunt_crossley))
    wall = streamed(pipeline)
    assert wall.model == "hunt-crossley"
    assert wall.n == pytest.approx(1.5, abs=0.05)


def assert_equal_values(one: Trace, other: Trace) -> None:
    """Assert that two traces have the same parameters over time."""
    assert one.rows == other.rows
    for row in range(len(one.rows)):
        assert one.names(row) == other.names(row)
        for name in one.names(row):
            values = one.physical(row, name), other.physical(row, name)
            assert np.array_equal(*values, equal_nan=True)


def test_a_whole_recording_gives_the_same_numbers_as_tick_by_tick():
    samples = record(Press(duration=3.0), kelvin_voigt)
    whole, stepped = Pipeline(ROWS, SETTINGS), Pipeline(ROWS, SETTINGS)
    trace = whole.run(*samples, decimate=1)
    theta = []
    for position, force, valid in zip(*samples, strict=True):
        stepped.update(position, force, bool(valid))
        theta.append(stepped.theta.copy())
    scales = SETTINGS.length, SETTINGS.time
    for r, row in enumerate(ROWS):
        expected = physical_over_time(row, np.array(theta)[:, r], *scales)
        found = np.column_stack([trace.physical(r, name) for name in traced_names(row)])
        assert np.array_equal(found, expected, equal_nan=True)
        assert np.abs(found).max() > 0.0
    assert np.array_equal(whole.bank.state, stepped.bank.state)


def test_kernels_without_what_a_bank_does_not_use_give_the_same_numbers_bit_for_bit(
    monkeypatch,
):
    samples = record(Press(duration=6.0), hunt_crossley)
    rows = rows_for(["kelvin-voigt", "mass-spring-damper", "hunt-crossley"], ["direct"], ["rls"])
    assert whole_for(rows) is None
    lean = Pipeline(rows, SETTINGS)
    monkeypatch.setattr("teleop_rt.estimation.rows.whole_for", lambda rows: WHOLE)
    whole = Pipeline(rows, SETTINGS)
    traces = [pipeline.run(*samples) for pipeline in (lean, whole)]
    assert_equal_values(*traces)
    assert np.array_equal(traces[0].signals, traces[1].signals, equal_nan=True)
    assert np.array_equal(lean.bank.state, whole.bank.state)
    assert np.abs(traces[0].physical(0, "k")).max() > 0.0


@pytest.mark.parametrize("decimate", [1, 3])
@pytest.mark.parametrize("model", ["kelvin-voigt", "hunt-crossley"])
def test_a_trace_is_the_same_in_pieces_and_has_the_names_that_were_asked_for(
    monkeypatch, decimate, model
):
    samples = record(Press(duration=3.0), hunt_crossley)
    rows = rows_for([model, "mass-spring-damper"], ["direct"], ["rls"])
    whole = Pipeline(rows, SETTINGS).run(*samples, decimate)
    monkeypatch.setattr("teleop_rt.estimation.pipeline._PIECE", 100)
    pieces = Pipeline(rows, SETTINGS).run(*samples, decimate)
    assert len(whole.signals) == len(samples[0]) // decimate > 5 * 100
    assert_equal_values(whole, pieces)
    assert np.array_equal(whole.signals, pieces.signals, equal_nan=True)
    assert np.array_equal(whole.status, pieces.status)
    one = Pipeline(rows, SETTINGS).run(*samples, decimate, lambda row: [leading(row)])
    assert [one.names(row) for row in range(2)] == [["k"], ["k"]]
    assert np.array_equal(one.physical(1, "k"), whole.physical(1, "k"))


@pytest.mark.parametrize(
    ("regressions", "solvers"), [(["algebraic"], ["rls"]), (["direct"], ["sprls"])]
)
def test_a_bank_with_any_other_regression_or_solver_has_all_kernels(regressions, solvers):
    assert whole_for(rows_for(["kelvin-voigt"], ["direct"], ["rls"])) is None
    rows = rows_for(["kelvin-voigt"], ["direct"], ["rls"])
    assert whole_for([*rows, *rows_for(["kelvin-voigt"], regressions, solvers)]) == WHOLE


def test_a_run_that_starts_in_contact_has_no_surface_but_an_offset():
    press = Press(duration=4.0, lift_every=100.0)
    position, force, valid = record(press, kelvin_voigt)
    pipeline = Pipeline(ROWS, SETTINGS)
    pipeline.run(position[1000:], force[1000:], valid[1000:])
    assert not pipeline.contact.surface_known
    assert math.isnan(pipeline.contact.surface)
    assert "never leaves contact" in pipeline.surface_reason
    rows = report(pipeline)
    assert rows[0]["parameters"]["k"]["value"] == pytest.approx(3600, rel=0.003)
    first = position[1000] - press.surface
    assert rows[0]["parameters"]["offset"]["value"] == pytest.approx(3600 * first, rel=0.01)
    assert "not identifiable" in rows[-1]["reason"]
