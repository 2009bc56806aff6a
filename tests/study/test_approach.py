"""The approach to an unknown wall: a slice of the study, and its page."""

from __future__ import annotations

import json

import pytest

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.study.approach import Approach, cases
from teleop_rt.study.sweep_report import SUMMARIES
from teleop_rt_dev.paths import TRIALS

WALKING = Approach(load_trial_file, open_bench, TRIALS / "handle.yaml")


def walks(round_trip_ms, speed_mm_per_s):
    leash, free = cases((round_trip_ms,), (speed_mm_per_s,))
    assert (leash["leash"], free["leash"]) == (True, False)
    return WALKING.walk(leash), WALKING.walk(free)


def test_a_hand_that_waits_for_nobody_is_a_third_as_far_ahead_on_the_leash():
    leash, free = walks(500.0, 40.0)
    assert leash["lead_mm"] < 50.0 < free["lead_mm"]
    assert leash["offset_mm"] < 0.4 * free["offset_mm"]
    assert leash["brake_N"] > 10.0
    assert free["brake_N"] == 0.0
    assert leash["felt_s"] < free["felt_s"] + 0.3


def test_a_wall_nearby_is_felt_without_a_brake_and_alike():
    leash, free = walks(150.0, 40.0)
    assert {**leash, "leash": False} == free
    assert leash["brake_N"] == 0.0
    assert leash["felt_s"] < 1.0


def test_the_command_runs_the_cases_and_says_who_never_feels_the_wall(call, tmp_path):
    options = ("--round-trip-ms", "0", "--hand-mm-per-s", "80", "--jobs", "1", "--json")
    code, out, _ = call("study", "approach", "--out", tmp_path / "out", *options)
    assert code == 0
    found = json.loads(out)
    assert [row["leash"] for row in found["summary"]] == [True, False]
    assert (tmp_path / "out" / "approach.html").is_file()
    never = [row | {"felt_s": None} for row in found["summary"] if not row["leash"]]
    page = SUMMARIES["approach"]([found["summary"][0], *never])
    assert "with the leash 1 of 1" in page.headline
    assert "without 0 of 1" in page.headline


@pytest.mark.parametrize("option", [("--round-trip-ms", "-1"), ("--hand-mm-per-s", "0")])
def test_a_case_that_cannot_be_is_refused(call, tmp_path, option):
    code, _, err = call("study", "approach", "--out", tmp_path / "out", *option)
    assert code == 2
    assert "every number lies between" in err
