"""The list of runs names the cause of each grade."""

import json

import pytest

from teleop_rt.view.runs import runs_of

SUMMARY = {
    "trial": "silicone_cube",
    "selected": {"model": "kelvin-voigt", "regression": "direct", "solver": "rls", "effects": None},
    "estimators": [],
    "adequacy": {"inadequate": False},
    "master": {"nrmse": 0.001, "lag_ms": 0.0},
    "safety": {"state": "DISARMED", "fault": {"code": 0, "name": "none"}},
    "missed_ticks": 0,
    "ticks": 5000,
    "planned_s": 20.0,
    "duration_s": 5.0,
    "link": {"round_trip_ms": 150.0, "lost": 0, "received": 5000},
}


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, ""),
        ({"interrupted": True}, "interrupted"),
        ({"interrupted": True, "missed_ticks": 100}, "loop"),
        ({"missed_ticks": 100}, "loop"),
    ],
)
def test_a_run_that_somebody_ended_is_not_laid_to_its_loop(tmp_path, changes, why):
    (tmp_path / "summary.json").write_text(json.dumps(SUMMARY | changes), encoding="utf-8")
    (run,) = runs_of(tmp_path)
    assert (run.grade, run.why) == ("attention" if why else "good", why)
