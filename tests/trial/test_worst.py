"""The worst of a whole run, which a mean in converged contact does not show."""

from types import SimpleNamespace

import numpy as np
import pytest

from teleop_rt.config.section import Units
from teleop_rt.trial import felt_lines
from teleop_rt.trial.felt_force import Felt
from teleop_rt.trial.worst import since_touch, wall_offset, worst_felt, worst_surface

TRIAL = SimpleNamespace(master=SimpleNamespace(offset_speed=0.02, rate_hz=1000))
STAMPS = 5e9 + 1e6 * np.arange(8)


def felt(true, rendered):
    true = np.array(true)
    return Felt(STAMPS, true, np.array(rendered), true, np.zeros(8) > 0)


def test_times_count_from_the_beginning_of_the_run_and_not_of_a_master_that_began_before():
    one = felt([0, 0, 0, 0, 30, 60, 0, 0.0], [0, 0, 0, 4, 25, 60, 0, 0.0])
    found = worst_felt(one, np.ones(8, dtype=bool), STAMPS[2])
    assert (found["phantom_s"], found["force_error_s"]) == pytest.approx((0.001, 0.002))


def test_a_wall_that_is_not_there_counts_before_contact_has_converged_too():
    one = felt([0, 0, 0, 0, 30, 60, 0, 0.0], [0, 0, 9, 4, 25, 60, 0, 0.0])
    found = worst_felt(one, np.ones(8, dtype=bool), STAMPS[0])
    assert found["phantom_force"] == 9.0
    assert found["phantom_s"] == pytest.approx(0.002)
    assert found["force_error"] == 9.0
    assert found["force_range"] == 60.0


@pytest.mark.parametrize(
    ("phantom", "words"),
    [
        (None, "not judged; largest error since the first touch 11.1 N"),
        (0.0, "none; largest"),
        (1.5, "at most 1.5 N (at 5.2 s)"),
    ],
)
def test_a_phantom_of_no_force_has_no_time(phantom, words):
    felt = {"phantom_force": phantom, "phantom_s": 5.2, "force_error": 11.1, "force_error_s": 1.0}
    summary = {"master": {"worst": felt}, "contact": {}}
    ((_, line),) = felt_lines.worst_lines(summary, Units(position="m", force="N"))
    assert line.startswith(words)


def test_a_force_that_is_too_large_inside_the_true_wall_is_no_phantom():
    one = felt([0, 0, 0, 0, 30, 60, 0, 0.0], [0, 0, 0, 0, 45, 60, 0, 0.0])
    found = worst_felt(one, np.ones(8, dtype=bool), STAMPS[0])
    assert (found["phantom_force"], found["force_error"]) == (0.0, 15.0)
    assert found["force_error_s"] == pytest.approx(0.004)


def test_a_force_is_missed_by_no_more_than_the_tool_has_met():
    """The hand is at a depth where the wall would give 376 N; the tool stayed at 72 N."""
    true, reflected = np.array([0, 0, 0, 40, 376, 376, 0, 0.0]), np.full(8, np.nan)
    reflected[2:] = [0, 0, 40, 72, 0, -0.2]
    soft = Felt(STAMPS, true, np.minimum(true, 14.5), reflected, true > 0)
    found = worst_felt(soft, np.ones(8, dtype=bool), STAMPS[0])
    assert found["force_error"] == pytest.approx(72 - 14.5)
    assert found["force_range"] == 72.0


def test_what_comes_before_the_first_touch_and_at_a_jump_of_place_is_not_judged():
    master = {
        "contact_id": np.array([0, 0, 1, 1, 1, 1, 0, 1.0]),
        "offset": np.array([0, 5e-3, 5e-3, 5e-3, 4.99e-3, 9e-3, 9e-3, 9e-3]),
    }
    counts = since_touch(TRIAL, master)
    assert counts.tolist() == [False, False, True, True, False, False, True, True]
    found = worst_felt(felt(np.zeros(8), [7, 7, 0, 1, 7, 7, 0, 0.0]), counts, STAMPS[0])
    assert found["phantom_force"] == 1.0


def test_rows_that_were_not_recorded_are_no_error_and_a_run_of_none_has_none():
    one = felt([np.nan] * 8, [7.0] * 8)
    assert set(worst_felt(one, np.ones(8, dtype=bool), STAMPS[0]).values()) == {None}


def test_the_surface_is_judged_over_the_whole_run_and_not_at_its_end():
    slave = {
        "stamp_ns": STAMPS,
        "surface": np.array([np.nan, 13.6, 13.6, 9.27, 9.27, 13.7, 13.7, 13.7]) * 1e-3,
        "position": np.array([0, 14, 20, 10, 15, 22, 9, 9]) * 1e-3,
    }
    truth = {"environment": {"surface": 13.7e-3}, "undeclared": []}
    found = worst_surface(slave, truth)
    assert found["surface_error"] == pytest.approx(4.43e-3)
    assert found["surface_error_s"] == pytest.approx(0.003)
    assert found["deepest"] == pytest.approx(8.3e-3)
    moving = truth | {"undeclared": [{"effect": "moving_surface", "swing": 0.002}]}
    for unknown in (moving, None):
        assert set(worst_surface(slave, unknown).values()) == {None}


def test_a_wall_felt_beside_its_place_has_the_largest_offset_and_that_of_the_end():
    """The offset before the first touch is the leash's, where no wall is felt."""
    master = {
        "stamp_ns": 1e9 * np.arange(7.0) + 1e9,
        "contact_id": np.array([0.0, 0.0, 1.0, 0.0, 2.0, 2.0, np.nan]),
        "offset": 1e-3 * np.array([20.0, 0.0, -9.0, -9.0, -3.0, 1.6, np.nan]),
    }
    offset = wall_offset(master, 0.0)
    assert offset == pytest.approx({"largest": 9e-3, "largest_s": 3.0, "at_end": 1.6e-3})
    line = ("felt wall: offset", "at most 9 mm (at 3.0 s), 1.6 mm at the end")
    assert list(felt_lines.offset_lines({"offset": offset}, Units(position="m", force="N"))) == [
        line
    ]
    assert wall_offset(master | {"contact_id": np.zeros(7)}, 0.0) is None
    assert wall_offset({}, 0.0) is None
    assert list(felt_lines.offset_lines({"offset": None}, Units(position="m", force="N"))) == []
