"""One rule of quality: never green beside a model that is inadequate."""

import pytest

from teleop_rt.trial import grades

CUT_OFF = {"fault": {"code": 13}}


def summary(**changes):
    parts = {
        "master": {"nrmse": 0.001, "lag_ms": 0.0},
        "selected": {"model": "kelvin-voigt"},
        "estimators": [],
        "adequacy": {"inadequate": False},
        "safety": {"fault": {"code": 0}, "unsafe": []},
        "missed_ticks": 0,
        "ticks": 10_000,
        "link": {"trouble": None, "round_trip_ms": 150.0, "lost": 1, "received": 99},
    }
    return parts | changes


def worst_felt(phantom, span=90.0):
    worst = {"phantom_force": phantom, "force_range": span}
    return {"nrmse": 0.001, "lag_ms": 0.0, "worst": worst}


def worst_surface(error, deepest=0.02):
    return {"worst": {"surface_error": error, "deepest": deepest}}


@pytest.mark.parametrize(
    ("changes", "part", "grade"),
    [
        ({}, "felt_force", "good"),
        ({"master": {"nrmse": 0.045, "lag_ms": 0.0}}, "felt_force", "attention"),
        ({"master": {"nrmse": 0.2, "lag_ms": 0.0}}, "felt_force", "bad"),
        ({"master": {"nrmse": 0.001, "lag_ms": -30.0}}, "felt_force", "attention"),
        ({"master": {"nrmse": None, "lag_ms": None}}, "felt_force", "unknown"),
        ({}, "model", "good"),
        ({"adequacy": {"inadequate": True}}, "model", "attention"),
        ({"adequacy": {"inadequate": None}}, "model", "unknown"),
        ({"selected": None}, "model", "attention"),
        ({"safety": {"fault": {"code": 3}}}, "safety", "bad"),
        ({"safety": {"fault": {"code": 0}, "unsafe": ["no watchdog"]}}, "safety", "bad"),
        ({"safety": {"fault": {"code": None}}}, "safety", "unknown"),
        ({"missed_ticks": 10}, "loop", "good"),
        ({"missed_ticks": 11}, "loop", "attention"),
        ({"missed_ticks": None}, "loop", "unknown"),
        ({"planned_s": 10.0, "duration_s": 9.99}, "loop", "good"),
        ({"planned_s": 10.0, "duration_s": 6.0}, "loop", "good"),
        ({"safety": CUT_OFF, "planned_s": 10.0, "duration_s": 6.0}, "loop", "attention"),
        ({"safety": CUT_OFF, "planned_s": 10.0, "duration_s": 9.999}, "loop", "good"),
        ({"interrupted": True}, "loop", "attention"),
        ({}, "link", "good"),
        ({}, "phantom", "unknown"),
        ({"master": worst_felt(4.1)}, "phantom", "good"),
        ({"master": worst_felt(10.9)}, "phantom", "attention"),
        ({"master": worst_felt(27.1)}, "phantom", "bad"),
        ({"master": worst_felt(27.1)}, "felt_force", "good"),
        ({"master": worst_felt(4.1, 0.0)}, "phantom", "unknown"),
        ({}, "surface", "unknown"),
        ({"contact": worst_surface(0.0011)}, "surface", "good"),
        ({"contact": worst_surface(0.0044)}, "surface", "attention"),
        ({"contact": worst_surface(0.0061)}, "surface", "bad"),
        ({"contact": worst_surface(None)}, "surface", "unknown"),
    ],
)
def test_each_part_has_its_grade(changes, part, grade):
    assert grades.grades(summary(**changes))[part] == grade


def test_the_error_of_the_selected_model_counts_and_not_that_of_another():
    keys = {"regression": "direct", "solver": "rls", "effects": None}
    rows = [
        {"model": "kelvin-voigt", **keys, "nrmse": 0.05},
        {"model": "hunt-crossley", **keys, "nrmse": 0.001},
    ]
    for row, grade in zip(rows, ("attention", "good"), strict=True):
        assert grades.grades(summary(estimators=rows, selected=row))["model"] == grade


def test_much_loss_and_trouble_are_seen_on_the_link():
    link = {"trouble": None, "round_trip_ms": 150.0, "lost": 6, "received": 94}
    assert grades.of_link(link) == "attention"
    assert grades.of_link(link | {"trouble": "no master answers"}) == "bad"
    assert grades.of_link(link | {"round_trip_ms": None}) == "unknown"


def test_the_worst_grade_counts_and_what_is_not_known_weighs_nothing():
    assert grades.worst(["good", "attention", "bad"]) == "bad"
    assert grades.worst(["unknown", "good"]) == "good"
    assert grades.worst([]) == "unknown"


@pytest.mark.parametrize(("code", "grade"), [(0, "good"), (3, "bad"), (None, "unknown")])
def test_how_a_run_ended_is_graded_apart_from_the_safeguards_of_its_rig(code, grade):
    assert grades.of_fault({"fault": {"code": code}, "unsafe": ["no watchdog"]}) == grade
