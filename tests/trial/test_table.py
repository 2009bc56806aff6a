"""The sentences of the summary on a terminal: none promises more than was judged."""

import io

import numpy as np
import pytest
from rich.console import Console

from teleop_rt.config.parameter_words import NO_DEVIATION
from teleop_rt.config.section import Units
from teleop_rt.trial.felt_lines import felt_lines, step_in_words
from teleop_rt.trial.summary import adequacy_of
from teleop_rt.trial.table import estimator_lines, model_in_words, print_summary

ROW = {"model": "kelvin-voigt", "regression": "direct", "solver": "rls"}
ADEQUATE = {"inadequate": False, "raised": False, "first_raised_s": None}


def summary(nrmse, adequacy):
    row = ROW | {"nrmse": nrmse, "convergence_s": 5.9, "status": "estimated", "parameters": {}}
    return {"selected": ROW, "estimators": [row], "adequacy": adequacy, "contact": {}}


def test_an_estimator_whose_predictions_were_not_judged_is_said_to_be_so():
    (line,) = estimator_lines(summary(None, ADEQUATE))
    assert "NRMSE not judged" in line


@pytest.mark.parametrize(
    ("nrmse", "said"),
    [
        (0.01, "adequate"),
        (0.05, "adequate; misses the force by 5 % of its range"),
        (8.2, "inadequate: it misses the force by 820 % of its range"),
    ],
)
def test_a_model_that_misses_the_force_is_never_called_adequate(nrmse, said):
    assert model_in_words(summary(nrmse, ADEQUATE)) == said


@pytest.mark.parametrize(("changed_at", "inadequate"), [(0, False), (1600, None)])
def test_a_model_is_adequate_only_if_it_was_in_use_long_enough(changed_at, inadequate):
    slave = {"predicted_force": np.ones(2000), "in_contact": np.ones(2000)}
    slave |= {"inadequate": np.zeros(2000), "selected": np.arange(2000) >= changed_at}
    slave["selected"] = slave["selected"].astype(float)
    assert adequacy_of(slave, 1e-3)["inadequate"] is inadequate


@pytest.mark.parametrize(("lag_ms", "direct_ms", "said"), [
    (None, None, "not judged"),
    (0.5, None, "0.5 ms, direct reflection not judged"),
    (0.5, 150.0, "0.5 ms, direct reflection 150 ms"),
])  # fmt: skip
def test_a_felt_force_that_was_not_judged_has_words_and_no_dash(lag_ms, direct_ms, said):
    master = {"nrmse": None, "lag_ms": lag_ms, "direct_reflection_lag_ms": direct_ms}
    assert dict(felt_lines(master)) == {"felt force: NRMSE": "not judged", "felt force: lag": said}


def test_an_algebraic_estimator_has_a_dash_for_its_deviation_and_the_reason_once():
    one = summary(0.01, ADEQUATE)
    (row,) = one["estimators"]
    row["parameters"] = {"m": {"value": 0.3, "std": None, "unit": "N s^2/m"}}
    assert list(estimator_lines(one))[1:] == ["      m = 0.3 kg"]
    one["estimators"] = 2 * [row | {"regression": "algebraic"}]
    _, first, _, second, reason = estimator_lines(one)
    assert first == second == "      m = 0.3 ± – kg"
    assert reason == f"  {NO_DEVIATION}"


@pytest.mark.parametrize("gone", [None, float("nan")])
def test_a_parameter_without_a_value_has_a_dash_and_no_line_is_left_out(gone):
    one = summary(0.01, ADEQUATE)
    known = {"value": 3600.0, "std": None, "unit": "N/m"}
    unknown = {"value": gone, "std": None, "unit": "N s/m"}
    one["estimators"][0]["parameters"] = {"k": known, "b": unknown}
    assert list(estimator_lines(one))[1:] == ["      k = 3600 N/m", "      b –"]
    one["estimators"][0]["parameters"] = {"k": unknown, "b": unknown}
    assert list(estimator_lines(one))[1:] == ["      k, b –"]


def test_an_estimator_that_did_not_settle_has_words_and_no_dash():
    unsettled = summary(0.01, ADEQUATE)
    unsettled["estimators"][0]["convergence_s"] = None
    (line,) = estimator_lines(unsettled)
    assert line.endswith("NRMSE 0.01, not settled")


@pytest.mark.parametrize(
    ("rendering", "said"),
    [
        (None, "0.891 N"),
        ({"adoption": {"largest_force_step": 0.308}}, "0.891 N, by a new model at most 0.308 N"),
    ],
)
def test_the_step_that_the_trial_limits_stands_beside_the_largest(rendering, said):
    master = {"largest_force_step": 0.891, "rendering": rendering}
    assert step_in_words(master, Units(position="m", force="N")) == said


def test_a_safeguard_that_the_rig_lacks_is_no_unsafe_run():
    figures = ("nrmse", "lag_ms", "direct_reflection_lag_ms", "largest_force_step")
    counts = ("sent", "received", "lost", "overtaken", "refused", "round_trip_ms")
    fault = {"code": 0, "name": "none", "cause": "no fault", "next_step": "nothing to do"}
    run = {
        "trial": "t", "estimators": [], "selected": None, "clock": "simulated", "duration_s": 1.0,
        "ticks": 9, "missed_ticks": 0, "notes": [], "wake_latency_us": None, "work_us": None,
        "contact": {"surface_found": None, "surface_true": None, "onsets": 0},
        "link": dict.fromkeys(counts), "master": dict.fromkeys(figures),
        "safety": {"state": "DISARMED", "fault": fault, "unsafe": ["no watchdog"]},
    }  # fmt: skip
    out = io.StringIO()
    print_summary(Console(file=out, width=300), run, Units(position="m", force="N"))
    (line,) = (line for line in out.getvalue().splitlines() if "no watchdog" in line)
    assert line.startswith("✕  missing safeguard ")
    assert "unsafe_i_know in the rig's file allows it: on hardware fit it, or keep out" in line
    assert "✓  safety" in out.getvalue()
