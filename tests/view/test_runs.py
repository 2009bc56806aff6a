"""The list of runs names the cause of each grade."""

import json

import pytest

from teleop_rt.config.section import Units
from teleop_rt.realtime.recording import RecordingWriter
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


@pytest.mark.parametrize("missed", [0, 100])
@pytest.mark.parametrize("whole", [True, False])
def test_a_run_whose_recording_lacks_its_end_is_listed_as_cut_off(tmp_path, whole, missed):
    summary = json.dumps(SUMMARY | {"missed_ticks": missed})
    (tmp_path / "summary.json").write_text(summary, encoding="utf-8")
    recording = tmp_path / "recording.mcap"
    RecordingWriter(recording, Units(position="m", force="N"), {}).close()
    if not whole:
        recording.write_bytes(recording.read_bytes()[:-20])
    (run,) = runs_of(tmp_path)
    assert run.ended == ("DISARMED" if whole else "DISARMED; recording cut off")
    causes = ["loop"] * (missed > 0) + ["recording"] * (not whole)
    assert (run.grade, run.why) == ("attention" if causes else "good", ", ".join(causes))
