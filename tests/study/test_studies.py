"""A slice of the studies of noise, varying parameters and excitation."""

import csv
import json
import re

import pytest

from teleop_rt.study import excitation, noise, time_varying
from teleop_rt.study.page import table
from teleop_rt.study.sweep_report import SUMMARIES
from teleop_rt.view.style import model_name


def row(result, regression, solver):
    return next(
        one for one in result["methods"]
        if (one["regression"], one["solver"]) == (regression, solver)
    )  # fmt: skip


@pytest.mark.parametrize(("lag_ms", "b"), [(0.0, 50.0), (1.0, 48.5), (2.0, 47.0)])
def test_lag_takes_k_tau_off_the_damping(lag_ms, b):
    (case, _) = noise.cases((0.01,), (5e-6,), (lag_ms,), (1,), duration_s=4.0)
    assert case["model"] == "kelvin-voigt"
    error = row(noise.evaluate(case), "direct", "rls")["error"]["b"]
    assert 50.0 * (1.0 + error) == pytest.approx(b, abs=0.3)


def test_more_noise_is_more_error_and_a_seed_repeats_it():
    quiet, loud = (
        noise.cases((sigma,), (5e-6,), (0.0,), (1,), duration_s=4.0)[0] for sigma in (0.01, 0.5)
    )
    reported = noise.evaluate(loud)
    assert reported == noise.evaluate(loud)
    small = row(noise.evaluate(quiet), "algebraic", "rls")["error"]["b"]
    assert abs(row(reported, "algebraic", "rls")["error"]["b"]) > 3 * abs(small)


def test_a_step_is_followed_by_solvers_that_forget_and_not_by_those_that_do_not():
    (case,) = time_varying.cases((0.0,), (1.0,), (3.0,), (1,), duration_s=5.0)
    reported = time_varying.evaluate(case)
    for solver in ("sprls", "ni-sprls", "gn-vff-rls"):
        assert row(reported, "direct", solver)["delay_s"] < 0.15
        assert abs(row(reported, "direct", solver)["error_after"]) < 0.01
    assert abs(row(reported, "direct", "rls")["error_after"]) > 0.1
    (case,) = time_varying.cases((0.0,), (0.99,), (3.0,), (1,), duration_s=5.0)
    assert row(time_varying.evaluate(case), "direct", "rls")["delay_s"] < 0.15


def condition(model, mean, amplitude, *, bias=False):
    case = {"model": model, "mean_m": mean, "amplitude_m": amplitude, "frequency_hz": 3.0,
            "bias": bias, "duration_s": 2.0}  # fmt: skip
    reported = excitation.evaluate(case)
    return reported["condition"], reported["excited"]


def test_one_sinusoid_about_zero_does_not_excite_a_mass_spring_damper():
    value, excited = condition("mass-spring-damper", 0.0, 0.008)
    assert value is None or value > 1e12
    assert not excited
    assert condition("mass-spring-damper", 0.005, 0.001) == (pytest.approx(1.3, abs=0.1), True)
    assert not condition("mass-spring-damper", 0.005, 0.001, bias=True)[1]
    assert condition("kelvin-voigt", 0.0, 0.008)[1]


@pytest.mark.parametrize("study", ["excitation", "noise", "time-varying"])
def test_the_commands_write_table_figure_and_page(call, tmp_path, study):
    out = tmp_path / study
    options = ["--seeds", "1"] if study != "excitation" else []
    code, printed, _ = call("study", study, "--out", out, "--duration", "1", *options, "--json",
                            "--jobs", "1")  # fmt: skip
    assert code == 0
    reported = json.loads(printed)
    rows = list(csv.DictReader((out / f"{study}.csv").read_text().splitlines()))
    per_case = 1 if study == "excitation" else 10
    assert len(rows) == reported["cases"] * per_case
    assert (out / f"{study.replace('-', '_')}.png").read_bytes().startswith(b"\x89PNG")
    assert (out / f"{study.replace('-', '_')}.pdf").read_bytes().startswith(b"%PDF")
    page = (out / f"{study}.html").read_text()
    assert "<table>" in page
    for name in ("Figure", "Every case"):
        assert re.search(rf'<nav.*<a href="#part-\d">{name}</a>.*</nav>', page)
    if study == "excitation":
        for model in {one["model"] for one in rows}:
            own = [one["excited"] == "True" for one in rows if one["model"] == model]
            words = f"{model_name(model)} by {sum(own)} of {len(own)} motions"
            assert words in re.search(r'class="verdict.*?</p>', page)[0]


def test_a_table_of_a_study_is_headed_in_words_with_units():
    page = table(
        [{"model": "kelvin-voigt", "amplitude_m": 0.004, "excited": True, "error_b": None}]
    )
    for text in ("amplitude [m]", "Kelvin-Voigt", "yes", "error b", "–"):
        assert f">{text}<" in page


def noise_row(model, lag_ms, error_b, seed=1):
    return {"model": model, "regression": "direct", "solver": "rls", "noise_N": 0.1, "seed": seed,
            "resolution_m": 5e-6, "lag_ms": lag_ms, "error_b": error_b, "error_k": 0.0}  # fmt: skip


def test_the_headline_on_noise_gives_the_error_by_the_lag():
    rows = [noise_row("kelvin-voigt", 0.0, 0.001), noise_row("kelvin-voigt", 2.0, -0.06),
            noise_row("hunt-crossley", 2.0, None)]  # fmt: skip
    headline = SUMMARIES["noise"](rows).headline
    assert headline == (
        "Median relative error of b by the lag of the force: "
        "Kelvin-Voigt 0.001 at 0 ms, 0.06 at 2 ms; Hunt-Crossley – at 0 ms, – at 2 ms."
    )


@pytest.mark.parametrize(("delays", "end"), [
    ((0.3, 0.05, None), "in 2 of 3 cases, soonest by SPRLS: after 0.05 s."),
    ((None, None, None), "in 0 of 3 cases."),
])  # fmt: skip
def test_the_headline_on_change_names_the_soonest_method(delays, end):
    solvers = ("rls", "sprls", "gn-vff-rls")
    rows = [
        {"regression": "direct", "solver": solver, "forgetting_factor": 1.0, "ramp_s": 0.0,
         "frequency_hz": 3.0, "delay_s": delay, "error_after": 0.0}
        for solver, delay in zip(solvers, delays, strict=True)
    ]  # fmt: skip
    assert SUMMARIES["time-varying"](rows).headline == f"The change is followed {end}"


def test_only_a_long_cell_is_set_as_prose():
    page = table([{"verdict": "hand does not come to rest; gives energy", "mode": "direct"}])
    assert '<td class="prose">hand does not' in page
    assert "<td>direct</td>" in page
