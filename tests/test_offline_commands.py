import io
import json
import os
import re

import numpy as np
import pytest
import yaml
from offline_tables import press, write_csv
from rich.console import Console
from scipy.io import savemat

from teleop_rt.config.parameter_words import reached_by
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.models.base import MODELS, TERMS
from teleop_rt.extras import install_command
from teleop_rt.offline.commands import print_diagnosis
from teleop_rt.view.quantities import size_seen
from teleop_rt_dev.paths import SILICONE

DATA = os.environ.get("TELEOP_RT_DATA")


def row_of(answer, *names):
    keys = ("model", "regression", "solver")
    (row,) = (row for row in answer["estimators"] if tuple(row[k] for k in keys) == names)
    return row


def test_replay_finds_the_body_in_a_plain_csv_mat_and_npz(call, tmp_path):
    t, position, force = press()
    files = [write_csv(tmp_path / "a.csv", t, position, force)]
    np.savez(tmp_path / "a.npz", t_s=t, position_m=position, force_N=force)
    savemat(tmp_path / "a.mat", {"t_s": t, "position_m": position, "force_N": force})
    files += [tmp_path / "a.npz", tmp_path / "a.mat"]
    code, out, err = call("replay", *files, "--models", "kelvin-voigt", "--json")
    assert (code, err) == (0, "")
    answers = [json.loads(line) for line in out.splitlines()]
    assert [answer["recording"] for answer in answers] == [str(file) for file in files]
    for answer in answers:
        assert answer["samples"] == t.size
        parameters = row_of(answer, "kelvin-voigt", "direct", "rls")["parameters"]
        assert parameters["k"]["value"] == pytest.approx(1500, rel=0.02)
        assert parameters["b"]["value"] == pytest.approx(50, rel=0.05)
    assert answers[0]["estimators"] == answers[1]["estimators"]


ALONE = ("--jobs", "1")
"""In this process: to start others takes longer than the work."""


@pytest.mark.usefixtures("no_pages")
def test_replay_of_a_run_gives_its_very_estimates_and_a_trace(call, tmp_path):
    arguments = ("--clock", "simulated", "--duration", 4, "--json", "--out", "run")
    summary = json.loads(call("run", SILICONE, *arguments)[1])
    code, out, _ = call("replay", "run/recording.mcap", "--json", "--trace", "theta.npz")
    answer = json.loads(out)
    assert code == 0
    assert answer["estimators"] == summary["estimators"]
    assert answer["selected"] == summary["selected"]
    assert answer["gaps"] == {"count": 0, "samples": 0}
    of_folder = json.loads(call("replay", "run", "--json")[1])
    assert of_folder["estimators"] == answer["estimators"]
    with np.load(tmp_path / "theta.npz") as trace:
        last = trace["kelvin-voigt/direct/rls/k"][-1]
        assert trace["t_s"].size == answer["samples"]
    value = row_of(answer, "kelvin-voigt", "direct", "rls")["parameters"]["k"]["value"]
    assert last == pytest.approx(value, rel=1e-12)


def test_a_full_disk_loses_no_answer_of_a_replay_and_keeps_no_part_of_its_trace(
    call, tmp_path, files_end_at
):
    recording = write_csv(tmp_path / "a.csv", *press())
    files_end_at(2000)
    words = ("replay", recording, "--models", "kelvin-voigt", "--trace", "theta.npz", *ALONE)
    code, out, err = call(*words)
    assert code == 1
    assert "k = " in out
    cause = "theta.npz: cannot be made or written: File too large: make room, or name another file"
    assert err.startswith(f"{cause} with --trace")
    assert not (tmp_path / "theta.npz").exists()


def test_one_flag_takes_several_pairs_and_a_file_after_them(call, tmp_path):
    t, x, f = press()
    path = write_csv(tmp_path / "a.csv", t, 1e3 * x, -f, "clock,place,pull")
    odd = write_csv(tmp_path / "k=1500.csv", t, 1e3 * x, -f, "clock,place,pull")
    guess = "as none is given"
    said = f"time = clock [s, {guess}], position = place [mm], force = -pull [N, {guess}]"
    pairs = ("--columns", "time=clock", "position=place", "force=-pull", "--units", "position=mm")
    asked = ("--models", "kelvin-voigt", "--json")
    for arguments in ((path, *pairs, *asked), (*asked, *pairs, odd), (path, *pairs, odd, *asked)):
        code, out, err = call("replay", *arguments)
        assert code == 0
        if odd not in arguments or path not in arguments:  # others print in processes of their own
            assert err.partition(": read: ")[2] == f"{said}\n"
        for answer in map(json.loads, out.splitlines()):
            row = row_of(answer, "kelvin-voigt", "direct", "rls")
            assert row["parameters"]["k"]["value"] == pytest.approx(1500, rel=0.02)
    assert len(out.splitlines()) == 2


def test_replay_explains_its_order_and_ends_no_line_in_a_blank(call, tmp_path):
    good = write_csv(tmp_path / "good.csv", *press())
    code, out, err = call("replay", good, "--models", "hunt-crossley", "--regressions", "direct")
    assert (code, err) == (0, "")
    first, *lines = out.splitlines()
    assert first.endswith("selected on-line (*), then identified, then the others, each by NRMSE")
    assert any(line.startswith("      n = ") for line in lines)
    assert [line for line in lines if line != line.rstrip()] == []


def test_a_surface_may_have_a_unit(call, tmp_path):
    good = write_csv(tmp_path / "good.csv", *press())
    for command in ("replay", "diagnose"):
        code, _, err = call(command, good, "--surface", "10")
        assert code == 2
        assert "--surface takes m, or a unit as in 10mm" in err
    answers = [
        json.loads(call("replay", good, "--surface", text, "--json", "--models", "kelvin-voigt")[1])
        for text in ("10mm", "1e-2", "0.01 m")
    ]
    assert answers[0]["estimators"] == answers[1]["estimators"] == answers[2]["estimators"]


def test_diagnose_reports_a_class_with_deviations_and_the_motion_that_would_decide(call, tmp_path):
    t = np.arange(0.0, 5.0, 2e-3)
    x = 0.006 - 0.004 * np.cos(2 * np.pi * 1.5 * t)
    late = np.interp(t - 4e-3, t, 900.0 * x + 12.0 * np.gradient(x, t))
    force = late + np.random.default_rng(4).normal(0, 0.01, t.size)
    recording = write_csv(tmp_path / "a.csv", t, x, force, header="t,x_m,F")
    code, out, _ = call("diagnose", recording, "--surface", "0")
    first, base, effect, words, *rest = out.splitlines()
    assert (code, first) == (0, f"{recording}: class")
    assert re.match(r"  kelvin-voigt \(base\): k = .*\d ± \d.*b = .*\d ± \d", base)
    assert re.match(r"  \w+ \(\w+\): .*\d ± \d", effect)
    assert re.match(r"    The .* -?\d.*\. Probability 0\.\d\d; explains [\d.]+ % of", words)
    assert [line.split(":")[0].split(" on ")[0] for line in rest] == [
        "  one of",
        "  NRMSE",
        "  to decide",
    ]


def test_the_help_of_diagnose_lists_models_and_terms(call):
    code, out, _ = call("diagnose", "--help")
    words = set(re.sub(r"[^a-z-]+", " ", out).split())
    assert code == 0
    assert {*MODELS, *TERMS} <= words


def test_diagnose_says_that_nothing_is_missing_where_nothing_is(call, tmp_path):
    recording = write_csv(tmp_path / "clean.csv", *press(noise=0.2))
    code, out, _ = call("diagnose", recording, "--json", "--surface", "0.010")
    answer = json.loads(out)
    assert code == 0
    assert answer["verdict"] == "no_missing_effect"
    assert answer["effects"] == answer["class"] == []
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(1500, rel=0.02)
    assert set(answer["error"]) >= {"metric", "on", "before", "after", "noise_floor"}


@pytest.mark.usefixtures("no_pages")
def test_what_is_written_of_recordings_of_one_name_is_kept_apart(call, tmp_path):
    folders = [tmp_path / name for name in ("soft", "hard")]
    for folder, gain in zip(folders, (1.0, 2.0), strict=True):
        folder.mkdir()
        t, position, force = press(noise=0.2)
        write_csv(folder / "a.csv", t, position, gain * force)
    files = [folder / "a.csv" for folder in folders]
    code, out, err = call("diagnose", *files, "--surface", "0.010", "--out", "given", *ALONE)
    assert out.splitlines()[-1] == "files in given"
    assert (code, err.splitlines()) == (
        0,
        [f"no page: `{install_command('report')}` adds it to the next one"],
    )
    stiffness = [
        yaml.safe_load((tmp_path / "given" / name / "model.yaml").read_text())["base"]
        for name in ("a", "a-2")
    ]
    assert [each["parameters"]["k"] for each in stiffness] == pytest.approx([1500, 3000], rel=0.02)
    assert (
        call("replay", *files, "--models", "kelvin-voigt", "--trace", "theta.npz", *ALONE)[0] == 0
    )
    assert {path.name for path in tmp_path.glob("*.npz")} == {"theta-a.npz", "theta-a-2.npz"}


@pytest.mark.usefixtures("no_pages")
def test_what_is_written_of_runs_bears_the_names_of_their_folders(call, tmp_path):
    arguments = ("--clock", "simulated", "--duration", 1, "--json")
    for name in ("first", "second"):
        assert call("run", SILICONE, *arguments, "--out", name)[0] == 0
    runs = ("first", "second/recording.mcap")
    assert call("replay", *runs, "--models", "kelvin-voigt", "--trace", "theta.npz", *ALONE)[0] == 0
    assert {path.name for path in tmp_path.glob("*.npz")} == {"theta-first.npz", "theta-second.npz"}


def test_missing_samples_are_counted_where_the_answer_is_read(call, tmp_path):
    t, position, force = press(noise=0.2)
    kept = np.ones(t.size, dtype=bool)
    kept[[1000, 1001, 3000]] = False
    recording = write_csv(tmp_path / "a.csv", t[kept], position[kept], force[kept])
    code, out, _ = call("diagnose", recording, "--surface", "0.010")
    assert code == 0
    assert "  3 samples missing in 2 gaps" in out.splitlines()
    code, out, _ = call("replay", recording, "--models", "kelvin-voigt")
    assert code == 0
    assert "  3 samples missing in 2 gaps" in out.splitlines()


def test_a_cell_of_text_is_named_by_line_and_column_and_counted_as_missing(call, tmp_path):
    recording = write_csv(tmp_path / "a.csv", *press(noise=0.2))
    lines = recording.read_text().splitlines()
    time, position, _ = lines[1001].split(",")
    lines[1001] = f"{time},{position},OL"
    recording.write_text("\n".join(lines) + "\n")
    code, out, err = call("diagnose", recording, "--surface", "0.010")
    assert code == 0
    name = lines[0].lstrip("# ").split(",")[2]
    assert f"{recording}: line 1002, column {name!r}: 'OL' is no number: counted as missing" in err
    assert "  1 sample missing in 1 gap" in out.splitlines()


@pytest.mark.skipif(DATA is None, reason="TELEOP_RT_DATA is not set")
@pytest.mark.parametrize("name", ["run_a_foam", "run_a_spring", "run_a_rigid", "run_c_spring"])
def test_measured_runs_replay_without_a_fault(call, name):
    file = f"{DATA}/tue_teleop/{name}.csv"
    code, out, err = call("replay", file, "--columns", "position=xs_rad,force=Fe_Nm", "--json")
    assert (code, err) == (0, "")
    answer = json.loads(out)
    assert len(answer["estimators"]) >= 40
    json.dumps(answer, allow_nan=False)


def test_replay_prints_the_best_few_sorted_and_all_when_asked(call, tmp_path):
    t = np.arange(0.0, 5.0, 1e-3)
    x = 0.01 * np.sin(2 * np.pi * 1.1 * t) + 0.002
    force = np.where(x > 0, np.maximum(2500.0 * x + 12.0 * np.gradient(x, t), 0.0), 0.0)
    np.savez(tmp_path / "wall.npz", t_s=t, position_m=x, force_N=force)
    code, out, _ = call("replay", "wall.npz", "--solvers", "rls")
    lines = [line for line in out.splitlines() if ", NRMSE " in line]
    assert code == 0
    assert lines[0].startswith("* kelvin-voigt, ")
    assert "not identified" not in out.partition("mass-spring-damper")[0]
    assert len(lines) == 5
    assert "more: --all prints them" in out
    every = call("replay", "wall.npz", "--solvers", "rls", "--all")[1]
    rows = [line for line in every.splitlines() if ", NRMSE " in line]
    assert rows[:5] == lines
    assert len(rows) == 9
    assert not any(row.lstrip().startswith("mass,") for row in lines)
    assert rows[-1].startswith("  mass-spring-damper, direct, rls: warming up")


def test_a_size_that_would_have_been_detected_has_its_unit_with_the_values_in_it():
    base = {"k": {"value": 400.0, "unit": "N/m"}, "b": {"value": 20.0, "unit": "N s/m"}}
    drag = {"size": 2.0, "unit": "N/m^power", "shape": {"power": 1.5}}
    assert size_seen(drag, base) == "2 N/m^1.5"
    assert size_seen(drag | {"unit": "N s/m^(power+1)"}, base) == "2 N s/m^2.5"
    assert size_seen(drag | {"unit": "N"}, base) == "2 N"
    assert size_seen(drag | {"unit": "N/m"}, base) == "2 N/m (0.5 % of k)"
    assert size_seen(drag | {"unit": "N s/m"}, base) == "2 N s/m (10 % of b)"
    assert size_seen(drag | {"unit": "N/m", "size": 101.6}, base) == "102 N/m (25 % of k)"
    assert size_seen({"size": 0.01, "unit": "1", "shape": {}}, base) == "0.01 (ratio)"
    for unit, shown in (
        ("N/m^power", "0.002 N"),
        ("N s/m^(power+1)", "0.002 N s/m"),
        ("N s^2/m^(power+2)", "0.002 N s^2/m^2"),
    ):
        reached = drag | {"unit": unit} | reached_by(unit, 2.0, {"power": 1.5}, 0.01)
        assert size_seen(reached, base) == f"{shown} at 10 mm"
    assert reached_by("N/m^power", 2.0, {"power": 1.5, "centre": 0.0}, 0.01) == {}
    assert reached_by("N/s^power", 2.0, {"power": 1.5}, 0.01) == {}


def test_the_stiffness_of_a_power_law_has_its_force_at_the_deepest_point(call, tmp_path):
    t = np.arange(0.0, 8.0, 1e-3)
    x = 0.005 * np.sin(2 * np.pi * 0.9 * t) + 0.001 * np.sin(2 * np.pi * 2.3 * t)
    force = np.maximum(3e5 * np.maximum(x, 0.0) ** 2.2, 0.0)
    force += 0.002 * np.random.default_rng(1).standard_normal(t.size)
    np.savez(tmp_path / "power.npz", t_s=t, position_m=x, force_N=force)
    hertz = ("--models", "hunt-crossley", "--regressions", "direct", "--solvers", "rls")
    for command, options in (("replay", hertz), ("diagnose", ("--base", "hunt-crossley"))):
        said = call(command, "power.npz", *options)[1]
        there = re.search(r"k = .* N/m(?:\^n|ⁿ) \((\S+) N at (\S+) mm\)", said)
        reached = [float(number) for number in there.groups()]
        assert reached == pytest.approx([force.max(), 1e3 * x.max()], rel=0.03)


def test_sizes_that_would_have_been_detected_are_two_columns_below_all_else(call, tmp_path):
    recording = write_csv(tmp_path / "clean.csv", *press(noise=0.2))
    code, out, _ = call("diagnose", recording, "--surface", "0.010")
    lines = out.splitlines()
    assert code == 0
    assert "no missing effect" in lines[0]
    (heading,) = [n for n, line in enumerate(lines) if "would have been detected" in line]
    rows = lines[heading + 1 :]
    assert len(rows) > 5
    assert all(line.startswith("    ") and len(line) < 100 for line in rows)
    assert any(line.lstrip().startswith("adhesion ") for line in rows)
    places = {line.rindex("   ") for line in rows[:-1]}
    assert len(places) == 1, "the second column begins at one place"


def test_a_base_that_explains_all_is_printed_before_what_a_wrong_one_lacks(call, tmp_path):
    recording = write_csv(tmp_path / "a.csv", *press())
    wrong = ("--surface", "0.010", "--base", "kelvin-voigt-unilateral")
    code, out, _ = call("diagnose", recording, *wrong)
    _, base, note, *rest = out.splitlines()
    assert code == 0
    assert base.startswith("  kelvin-voigt-unilateral (base): ")
    assert note.startswith("  note: the base kelvin-voigt without any effect predicts this force")
    assert any("direction_dependent_damping" in line for line in rest)
    assert not any("the base kelvin-voigt without" in line for line in rest)


def test_effects_lists_each_name_of_the_library_once(call):
    code, out, _ = call("effects", "--json")
    assert code == 0
    names = [json.loads(line)["name"] for line in out.splitlines()]
    assert len(names) == len(set(names))
    assert set(names) == {effect.name for effect in LIBRARY}
    _, table, _ = call("effects")
    _, *lines, hint = table.splitlines()
    rows = {line.split()[0]: line for line in lines}
    assert list(rows) == names
    assert hint.startswith("`teleop-rt effects EFFECT` lists")
    assert "A play of <gap> lies between encoder and tip." in rows["backlash"]


def test_effects_gives_unit_bounds_and_neutral_value_of_each_parameter(call):
    _, out, _ = call("effects", "--json")
    entries = {entry["name"]: entry for entry in map(json.loads, out.splitlines())}
    for effect in LIBRARY:
        listed = {one["name"]: one for one in entries[effect.name]["parameters"][effect.law]}
        for shape in effect.shapes:
            one = listed.pop(shape.name)
            assert (one["lower"], one["upper"]) == (shape.lower, shape.upper)
            assert (one["neutral"], one["relative_to"]) == (shape.neutral, shape.relative_to)
        assert list(listed) == [effect.amplitude.name] * (not effect.amplitude.unity)
        assert not any("{" in one["unit"] for one in listed.values())
    _, table, _ = call("effects", "force_lag", "series_compliance")
    lines = table.splitlines()
    assert lines[0].startswith("force_lag (delay, rig): The force channel is slow")
    (bandwidth,) = [line.split() for line in lines if "- " in line and " Hz " in line][:1]
    assert bandwidth[-5:] == ["bandwidth", "Hz", "0.5", "2000", "-"]
    compliance = next(line for line in lines if " m/N " in line)
    assert compliance.split()[3:] == ["0.001", "compliance", "0.8", "compliance", "0"]
    assert "compliance: the largest penetration over the largest force" in lines
    code, _, error = call("effects", "force_lack")
    assert (code, error[:32]) == (2, "no effect 'force_lack'; one of: ")


def test_the_set_that_predicts_best_is_said_once():
    best = "coulomb_friction + force_lag"
    answer = {
        "recording": "a.csv",
        "verdict": "class",
        "base": {"model": "kelvin-voigt", "parameters": {}},
        "effects": [],
        "probability": {},
        "class": [],
        "predictor": best.split(" + "),
        "error": {"on": "a.csv", "before": 0.2, "after": 0.1, "noise_floor": 0.1},
        "notes": [f"the errors are those of the set that predicts best: {best}", "another note"],
        "gaps": {"samples": 0, "count": 0},
        "detectable": [],
    } | dict.fromkeys(("nearest", "dependence", "draft", "experiment"))
    console = Console(file=io.StringIO(), width=200)
    print_diagnosis(console, answer)
    said = console.file.getvalue()
    assert said.count(best) == 1
    assert f"  predicts best with: {best}; these are its errors" in said
    assert "note: another note" in said


def test_a_diagnosis_prints_one_dash_for_each_value_that_is_missing():
    nothing = {"value": None, "std": None, "unit": "N"}
    answer = {
        "recording": "a.csv",
        "verdict": "named",
        "base": {"model": "kelvin-voigt", "parameters": {"k": nothing}},
        "effects": [{"name": "bias", "belongs_to": "sensor", "template": "A bias of {size}.",
                     "parameters": {"size": nothing}}],
        "probability": {},
        "class": [],
        "predictor": [],
        "error": {"on": "blocks", "before": None, "after": float("nan"), "noise_floor": 0.01},
        "notes": [],
        "gaps": {"samples": 0, "count": 0},
        "detectable": [],
    } | dict.fromkeys(("nearest", "dependence", "draft", "experiment"))  # fmt: skip
    console = Console(file=io.StringIO(), width=200)
    print_diagnosis(console, answer)
    _, base, effect, sentence, errors = console.file.getvalue().splitlines()
    assert base == "  kelvin-voigt (base): k –"
    assert effect == "  bias (sensor): size –"
    assert sentence == "    A bias of –."
    assert errors == "  NRMSE on blocks: before –, after –, noise floor 0.01"


def test_an_open_answer_bounds_the_noise_and_compares_its_draft():
    error = {"on": "blocks", "before": 0.2, "after": 0.02, "noise_floor": 0.01}
    answer = {
        "recording": "a.csv",
        "verdict": "unexplained",
        "base": {"model": "kelvin-voigt", "parameters": {}},
        "effects": [],
        "probability": {},
        "class": [],
        "predictor": ["force_lag"],
        "error": error,
        "nearest": {"effects": ["force_drift"], "family": "drift", "share": 0.9,
                    "before": 0.2, "after": 0.01},
        "draft": {"terms": ["the position"], "file": "draft.py", "error": error},
        "notes": [],
        "gaps": {"samples": 0, "count": 0},
        "detectable": [],
    } | dict.fromkeys(("dependence", "experiment"))  # fmt: skip
    console = Console(file=io.StringIO(), width=200)
    print_diagnosis(console, answer)
    said = console.file.getvalue()
    assert "noise floor at most 0.01\n" in said
    assert "  chosen to predict: force_lag; these are its errors" in said
    assert "after 0.02, worse than the set of effects above; draft.py is ready" in said
