"""Chapter 4: the simulations' figures, the cubes, and verdicts that follow the numbers."""

import copy
import io
import json
import sys
from contextlib import redirect_stdout

import pytest
from page_checks import page_failures

from teleop_rt.cli import main
from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.study import chapter4, chapter4_figures, noise
from teleop_rt.study.chapter4_report import judge
from teleop_rt.study.chapter4_silicone import Specimen
from teleop_rt_dev.paths import SILICONE


@pytest.fixture(scope="module")
def simulated():
    return [chapter4.simulate(case) for case in chapter4.cases(duration_s=2.0)]


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    changes = ["duration_s=6.0", "operator.lift_off_every_s=1000.0"]
    trial = load_trial_file(SILICONE, changes)
    cube = Specimen(trial, SILICONE, open_bench, tmp_path_factory.mktemp("study") / "cube")
    return [cube.press(case) for case in cube.cases()]


def verdicts(simulated, pressed):
    return {one.name: one for one in judge(simulated, pressed)}


def method(result, regression, solver, model=None):
    return next(
        one for one in result["methods"]
        if (one["regression"], one["solver"]) == (regression, solver)
        and one.get("model") == model
    )  # fmt: skip


def test_settling_times_are_those_of_an_independent_implementation(simulated):
    known = {0.5: (0.085, 0.39), 1.0: (0.052, 0.19), 3.0: (0.024, 0.066), 5.0: (0.016, 0.040),
             10.0: (0.010, 0.021)}  # fmt: skip
    for one in simulated:
        linear = one["model"] == "kelvin-voigt"
        reported = method(one, "direct", "rls")["settling_s"]["k" if linear else "b"]
        assert reported == pytest.approx(known[one["frequency_hz"]][not linear], abs=5e-3)


def test_parameters_of_table_4_1_are_found_by_every_method(simulated):
    for one in simulated:
        truth = {"k": 1500.0, "b": 50.0, "n": 1.5}
        for reported in one["methods"]:
            for name, value in reported["final"].items():
                assert value == pytest.approx(truth[name], rel=0.02)


def test_the_cube_on_the_rig_is_found_and_only_the_curved_one_needs_an_exponent(pressed):
    rig, curved = pressed
    found = method(rig, "direct", "rls", "kelvin-voigt")["final"]
    assert found["k"] == pytest.approx(3600, rel=0.02)
    assert found["b"] == pytest.approx(20, rel=0.05)
    errors = [method(curved, "direct", "rls", m)["nrmse"] for m in ("kelvin-voigt",
              "hunt-crossley")]  # fmt: skip
    assert errors[1] < 0.05 * errors[0]
    assert method(curved, "direct", "rls", "hunt-crossley")["final"]["n"] == pytest.approx(
        1.3, 1e-3
    )


def test_statements_come_out_as_the_literature_of_corrections_has_them(simulated, pressed):
    reported = {name: one.verdict for name, one in verdicts(simulated, pressed).items()}
    assert len(reported) == 13
    assert reported["converges-kelvin-voigt"] == "agrees"
    assert reported["integral-fastest"] == "agrees"
    assert reported["error-constant"] == "agrees"
    assert reported["silicone-values"] == "agrees"
    assert reported["rls-steadiest"] == "agrees"
    assert reported["integral-misses-damping"] == "in part"
    assert reported["one-frequency"] == "in part"
    assert reported["hunt-crossley-tracks"] == "in part"


def doctored(results, change):
    copied = copy.deepcopy(results)
    for one in copied:
        change(one)
    return copied


def lost_b(one):
    if one["model"] == "hunt-crossley":
        method(one, "direct", "iec")["final"]["b"] = 118.0


def slow_integral(one):
    if one["model"] == "kelvin-voigt":
        method(one, "direct", "iec")["settling_s"]["k"] = 1.0
        method(one, "direct", "iec")["overshoot"]["k"] = 0.5


def wrong_k(one):
    method(one, "algebraic", "rls")["final"]["k"] *= 2.0


def error_by_frequency(one):
    for reported in one["methods"]:
        reported["nrmse"] = 0.01 * one["frequency_hz"]


def slower_by_frequency(one):
    for reported in one["methods"]:
        reported["settling_s"] = dict.fromkeys(reported["settling_s"], one["frequency_hz"])


@pytest.mark.parametrize(
    ("change", "name", "verdict"),
    [
        (lost_b, "integral-misses-damping", "agrees"),
        (slow_integral, "integral-fastest", "disagrees"),
        (wrong_k, "converges-kelvin-voigt", "in part"),
        (error_by_frequency, "error-constant", "disagrees"),
        (slower_by_frequency, "frequency-kelvin-voigt", "disagrees"),
        (slower_by_frequency, "frequency-hunt-crossley", "disagrees"),
    ],
)
def test_doctored_simulations_turn_the_verdict_and_the_reason(simulated, change, name, verdict):
    before, after = (verdicts(one, [])[name] for one in (simulated, doctored(simulated, change)))
    assert before.verdict != verdict
    assert after.verdict == verdict
    assert after.found != before.found


def softer(cube):
    for one in cube["methods"]:
        one["final"]["k"] = 2000.0


def restless_rls(cube):
    for one in cube["methods"]:
        if one["solver"] == "rls" and one["regression"] == "direct":
            one["wander"] = dict.fromkeys(one["wander"], 3.0)
            one["convergence_s"] = 4.0


def exponent_helps(cube):
    for one in cube["methods"]:
        one["nrmse"] = 0.001 if one["model"] == "hunt-crossley" else 0.1


def straight(cube):
    for one in cube["methods"]:
        one["nrmse"], one["turning"] = 0.001, 0.5


def unestimated(cube):
    for one in cube["methods"]:
        one["nrmse"], one["convergence_s"] = None, None
        one["wander"] = dict.fromkeys(one["wander"], None)


@pytest.mark.parametrize(
    ("change", "name", "verdict"),
    [
        (softer, "silicone-values", "disagrees"),
        (restless_rls, "rls-steadiest", "disagrees"),
        (restless_rls, "about-a-second", "disagrees"),
        (exponent_helps, "hunt-crossley-tracks", "agrees"),
        (straight, "bad-at-turning", "disagrees"),
        (unestimated, "hunt-crossley-tracks", "disagrees"),
    ],
)
def test_doctored_cubes_turn_the_verdict(simulated, pressed, change, name, verdict):
    before, after = (verdicts(simulated, one)[name] for one in (pressed, doctored(pressed, change)))
    assert before.verdict != verdict
    assert after.verdict == verdict


def test_noise_hides_the_damping_that_least_squares_finds_without_it():
    reported = noise.hidden_damping()
    assert reported["exact"] == pytest.approx(50.0, abs=0.1)
    assert reported["ratio"] == pytest.approx(1.3e-3, rel=0.05)
    assert reported["high"] - reported["low"] > 50.0


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Give the words of a command that has written the study, its folder, and its output."""
    folder, printed = tmp_path_factory.mktemp("chapter4") / "out", io.StringIO()
    arguments = ("study", "chapter4", "--out", folder, "--frequencies", "1,10", "--duration", "2",
                 "--cube-s", "0", "--jobs", "1", "--json")  # fmt: skip
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed):
        patch.setattr(sys, "argv", ["teleop-rt", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
    assert not end.value.code
    return arguments, folder, printed.getvalue()


def test_the_page_says_how_many_statements_hold_and_fits_its_window(chromium, written):
    _, folder, out = written
    verdicts = [one["verdict"] for one in json.loads(out)["statements"]]
    assert page_failures(chromium, folder / "chapter4.html") == []
    headline = chromium.find_element("css selector", ".verdict").text
    assert f"{verdicts.count('agrees')} agree, {verdicts.count('in part')} in part" in headline


def test_the_command_writes_page_tables_and_figures_and_is_taken_up(call, monkeypatch, written):
    arguments, folder, out = written
    assert len(json.loads(out)["statements"]) == 7
    page = (folder / "chapter4.html").read_text()
    statements = json.loads(out)["statements"]
    assert all(one["why"].split(",")[0][:20] in page for one in statements[:1])
    for name in ("figure_4_1", "figure_4_2", "figure_4_3", "figure_4_4"):
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (folder / f"{name}.svg").read_text()
        assert f"{name}.svg" in page
    lines = (folder / "cases.jsonl").read_bytes()
    monkeypatch.setattr(chapter4_figures, "write_figures", lambda *_: None)  # drawn already
    assert call(*arguments)[1] == out
    assert (folder / "cases.jsonl").read_bytes() == lines
