"""The report of a run, of a run that ended badly, and of two runs side by side."""

import copy
import csv
import json
import re
import shutil
import sys
from contextlib import closing
from dataclasses import replace
from datetime import datetime
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from schema_checks import violations

from teleop_rt.cli import main
from teleop_rt.cli.schema import SchemaName
from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.config.parameter_words import NO_DEVIATION
from teleop_rt.config.section import Units
from teleop_rt.diagnosis.answers.notes import STEPS_OF_MOTION
from teleop_rt.realtime.alarms import of_recorder
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.signals import MASTER, MASTER_TOPIC
from teleop_rt.trial.folder import plain_json
from teleop_rt.trial.processes import Child
from teleop_rt.trial.rebuild import rebuilt_summary
from teleop_rt.trial.run_processes import outcome_of
from teleop_rt.trial.summary import summarise
from teleop_rt.view.commands import report_of_run
from teleop_rt_dev.paths import SILICONE

pytest.importorskip("matplotlib")

pytest.importorskip("jinja2")

pytest.importorskip("bokeh")

from teleop_rt.cli.reporting import felt_of
from teleop_rt.trial.grades import GRADE_COLOURS, grades
from teleop_rt.trial.summary_file import read_summary
from teleop_rt.view import figures, headline, run_folder, run_times
from teleop_rt.view.charts import SWINGS, kept_rows, robust_limits
from teleop_rt.view.compare import compared, different_keys
from teleop_rt.view.delay import one_way_delays
from teleop_rt.view.run_folder import load_run, read_recorded
from teleop_rt.view.style import (
    ASKED,
    FELT,
    FILTERED,
    MEASURED,
    PREDICTED,
    RAW,
    RESIDUAL,
    TRUE_FORCE,
    parameter,
)


def run_trial(folder, *changes):
    patch = pytest.MonkeyPatch()
    overrides = [part for change in changes for part in ("--set", change)]
    arguments = ["run", str(SILICONE), "--clock", "simulated", "--json", "--out", str(folder)]
    patch.setattr(sys, "argv", ["teleop-rt", *arguments, *overrides])
    with pytest.raises(SystemExit) as end:
        main()
    patch.undo()
    return end.value.code or 0


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view") / "good"
    assert run_trial(folder, "duration_s=7.0") == 0
    return folder


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view") / "stopped"
    assert run_trial(folder, "rig.limits.force_max_N=3.0", "slave.force_cap_N=3.0") == 1
    return folder


@pytest.mark.parametrize("run", ["good", "stopped"])
def test_the_summary_of_a_run_follows_its_schema_and_not_with_a_key_more_or_less(run, request):
    summary = json.loads((request.getfixturevalue(run) / "summary.json").read_text())
    assert violations(SchemaName.SUMMARY, summary) == []
    parts = [summary, *(part for part in summary.values() if isinstance(part, dict))]
    for part in [*parts, summary["estimators"][0], summary["master"]["rendering"]["passivity"]]:
        part["key_of_a_later_version"] = 1
        assert len(violations(SchemaName.SUMMARY, summary)) == 1
        del part["key_of_a_later_version"]
    del summary["safety"]["fault"]["cause"]
    assert len(violations(SchemaName.SUMMARY, summary)) == 1


def test_a_summary_of_processes_that_died_or_from_the_recording_alone_follows_the_schema(good):
    trial = load_trial_file(good / "trial.yaml", ["estimation.models=[kelvin-voigt]"])
    dead = [Child(name, None) for name in ("slave", "master", "recorder")]
    slave = read_recorded(good)["/slave"]
    for summary in (
        summarise(good, trial, outcome_of(*dead, interrupted=False), None),
        rebuilt_summary(good, trial, slave, None),
    ):
        assert summary["master"]["rendering"] is None
        assert violations(SchemaName.SUMMARY, plain_json(summary)) == []


def test_a_safeguard_that_the_rig_goes_without_is_a_red_tile(good):
    summary = read_summary(good)
    graded = grades(summary)["safety"]
    assert headline.safety(summary, graded).grade == "good"
    missing = "the drive measures no force of its own"
    summary["safety"]["unsafe"] = [missing]
    tile = headline.safety(summary, grades(summary)["safety"])
    assert tile.grade == "bad"
    assert f"unsafe: {missing}" in tile.lines
    assert headline.UNSAFE_STEP in tile.lines
    assert GRADE_COLOURS["bad"] == "bold red"


def test_limited_commands_beside_no_fault_are_said_to_be_intended(good):
    summary = read_summary(good)
    summary["safety"] |= {"commands_limited": 9805, "unsafe": []}
    tile = headline.safety(summary, grades(summary)["safety"])
    assert (tile.grade, tile.value) == ("good", "no fault")
    (line,) = (one for one in tile.lines if "9805 commands" in one)
    assert line.startswith("the limiter works as intended")


def test_the_key_of_the_residual_names_it_as_its_own_panel_does():
    assert RESIDUAL.startswith("residual: ")


def first_screen(folder: Path) -> str:
    page = (folder / "report.html").read_text()
    return page[: page.index("<h2>Force and residual")]


@pytest.fixture
def no_charts(monkeypatch):
    """Draw no chart below the first screen: they take most of a report's time."""
    monkeypatch.setattr(figures, "charts", lambda *_: [])


def test_the_first_screen_says_that_it_worked_and_how_well(good):
    screen = first_screen(good)
    summary = json.loads((good / "summary.json").read_text())
    assert "Ran to its end" in screen or "It worked" in screen
    assert parameter("k", summary["selected"]["parameters"]["k"]) in screen
    assert f"{100 * summary['master']['nrmse']:.2g} % error" in screen
    assert f"0 of {summary['ticks']} ticks missed" in screen
    assert f"teleop-rt {summary['software']['version']}" in screen
    assert "simulated CANopen rig" in screen


def fault_of(folder):
    return json.loads((folder / "summary.json").read_text())["safety"]["fault"]


def test_the_first_screen_of_a_stopped_run_says_why_and_what_next(stopped):
    screen, fault = unescape(first_screen(stopped)), fault_of(stopped)
    assert 'class="verdict bad"' in screen
    assert f"Stopped: {fault['cause']}. Next: {fault['next_step']}." in screen
    page = unescape((stopped / "report.html").read_text())
    assert f"{fault['name']}: {fault['cause']}" in page


def charts_of(folder):
    run = load_run(folder, read_summary(folder), read_recorded(folder), felt_of)
    return run, {chart.name: chart for chart in figures.charts(run, None, None)}


def test_a_page_needs_nothing_from_elsewhere_and_stays_below_its_size(good):
    page = (good / "report.html").read_text()
    assert len(page) < 5_000_000
    assert not re.findall(r"<script[^>]* src=|<link(?! rel=\"icon\" href=\"data:,\")|@import", page)
    paper = "".join(re.findall(r'<div class="paper">.*?</div>', page, re.DOTALL))
    ids = re.findall(r'\bid="([^"]+)"', paper)
    assert len(ids) == len(set(ids)) > 0
    referred = set(re.findall(r"(?:url\(|href=\")#([^)\"]+)", paper))
    assert len(referred) > 5
    assert referred <= set(ids)


def test_every_estimator_that_ran_is_in_the_figures_with_its_parameters(good):
    page = (good / "report.html").read_text()
    for model in ("Kelvin-Voigt", "mass-spring-damper", "Hunt-Crossley"):
        assert f"<h3>{model}</h3>" in page
        assert f'aria-label="parameters of {model} over time"' in page
    for name in ("force over time", "delay of the models sent", "energy at the operator"):
        assert f'aria-label="{name}' in page


def test_measured_and_predicted_force_are_shown_behind_the_same_filter(good):
    run, charts = charts_of(good)
    raw, filtered, predicted, _ = charts["force"].panels[0].curves
    start, end = charts["force"].window
    near = (raw.x >= start) & (raw.x <= end)
    assert raw.faint
    assert not filtered.faint
    errors = [np.sqrt(np.nanmean((one.y - predicted.y)[near] ** 2)) for one in (raw, filtered)]
    assert errors[0] > 1.0
    assert errors[1] < 0.2
    assert np.array_equal(filtered.y - predicted.y, run.residual, equal_nan=True)


def test_force_and_position_that_were_held_while_samples_were_lost_are_not_drawn(good):
    topics = dict(read_recorded(good))
    valid = topics["/slave"]["valid"].copy()
    lost = slice(4000, 4200)
    valid[lost] = 0.0
    topics["/slave"] = {**topics["/slave"], "valid": valid}
    run = load_run(good, read_summary(good), topics, felt_of)
    found = {chart.name: chart for chart in figures.charts(run, None, None)}
    drawn = {c.label: c.y for name in ("force", "position") for c in found[name].curves}
    for label in (RAW, FILTERED, PREDICTED, RESIDUAL, MEASURED):
        assert np.isnan(drawn[label][lost]).all()
    assert np.isfinite(drawn[MEASURED][:4000]).all()
    assert np.isfinite(drawn[ASKED][lost]).all()
    assert np.isfinite(run.felt.rendered).all()


def test_the_force_opens_with_a_few_swings_of_the_last_long_contact(good):
    run, charts = charts_of(good)
    start, end = charts["force"].window
    period_s = 1.0 / run.trial["operator"]["frequency_hz"]
    assert end - start == pytest.approx(SWINGS * period_s, rel=0.1)
    assert any(a <= start + 1e-6 and end <= b + 1e-6 for a, b in charts["force"].shaded)
    assert charts["force"].limits[1] > end - start + 3.0


def test_a_run_that_was_stopped_opens_at_its_fault(stopped):
    _, charts = charts_of(stopped)
    (label, at_s), *_ = charts["force"].panels[0].lines
    assert label == "fault"
    assert charts["force"].window[0] < at_s < charts["force"].window[1]


def test_one_spike_does_not_set_the_scale_of_the_residual_and_is_marked():
    t = np.arange(10_000) * 1e-3
    left = 0.02 * np.sin(40.0 * t)
    left[5000:5003] = [-1.0, -7.0, -1.0]
    left[8000] = 3.0
    (low, high), spikes = robust_limits(t, left)
    assert 0.02 < high == -low < 0.05
    assert spikes == ((5.001, -7.0), (8.0, 3.0))
    assert robust_limits(t, np.where(t < 20.0, 0.01, 0.0))[1] == ()
    assert robust_limits(t, np.full(t.size, np.nan)) == (None, ())


def test_the_felt_force_lies_on_the_true_one_and_the_reflected_one_lags(good):
    run, charts = charts_of(good)
    felt = run.felt
    rows = felt.converged & np.isfinite(felt.reflected)
    spread = np.ptp(felt.true[rows])
    assert np.sqrt(np.mean((felt.rendered - felt.true)[rows] ** 2)) < 0.01 * spread
    assert np.sqrt(np.mean((felt.reflected - felt.true)[rows] ** 2)) > 0.3 * spread
    over_time, over_true = charts["felt"].panels
    assert [curve.label for curve in over_time.curves] == [
        curve.label for curve in over_true.curves
    ]
    assert load_run(good, read_summary(good), read_recorded(good)).felt is None


def test_no_curve_hides_the_one_that_it_lies_on(good):
    """A curve that fits is drawn on a wider one, which stays visible on both sides of it."""
    _, charts = charts_of(good)
    for chart, over, under in (
        ("felt", FELT, TRUE_FORCE), ("force", PREDICTED, FILTERED),
    ):  # fmt: skip
        curves = {curve.label: curve for curve in charts[chart].panels[0].curves}
        order = list(curves)
        assert order.index(under) < order.index(over)
        assert curves[under].width - curves[over].width >= 1.5


def test_the_text_beside_the_strip_says_where_it_is(good):
    page = (good / "report.html").read_text()
    assert "The strip at the bottom of the figure shows the whole run: drag its window" in page
    assert "strip below" not in page


def test_without_the_truth_there_is_no_picture_of_the_felt_force(good, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(good, folder)
    (folder / "truth.json").unlink()
    _, charts = charts_of(folder)
    assert "felt" not in charts
    assert "force" in charts


def test_the_date_and_time_of_a_run_stand_in_its_summary_and_on_its_page(good):
    summary = json.loads((good / "summary.json").read_text())
    began = datetime.fromisoformat(summary["began_at"])
    assert began.tzinfo is not None
    assert abs(began.timestamp() - (good / "trial.yaml").stat().st_mtime) < 1.0
    assert f'<time datetime="{summary["began_at"]}">' in first_screen(good)


@pytest.mark.usefixtures("no_charts")
def test_a_run_that_was_cut_off_is_reported_as_far_as_it_can_be_read(good, call, tmp_path):
    cut = tmp_path / "cut"
    cut.mkdir()
    shutil.copy(good / "trial.yaml", cut)
    recording = (good / "recording.mcap").read_bytes()
    (cut / "recording.mcap").write_bytes(recording[: 2 * len(recording) // 3])
    code, out, err = call("report", cut)
    assert (code, out.strip()) == (0, str(cut / "report.html"))
    said = re.fullmatch(r".*/cut: (cut off in state RUN.*: 4\.[0-9] of 7 s are recorded\.)\n", err)
    assert said is not None
    screen = first_screen(cut)
    assert f"C{said[1][1:]}" in screen
    assert "this summary uses only the recording" in screen
    assert not (cut / "summary.json").exists()


@pytest.mark.usefixtures("no_charts")
def test_a_recording_that_is_shorter_than_its_summary_is_judged_by_itself(good, call, tmp_path):
    cut = tmp_path / "cut"
    shutil.copytree(good, cut)
    recording = (good / "recording.mcap").read_bytes()
    (cut / "recording.mcap").write_bytes(recording[: 4 * len(recording) // 5])
    code, out, err = call("report", cut, "--figures", tmp_path / "figures")
    assert (code, out.splitlines()[0]) == (0, str(cut / "report.html"))
    said = re.fullmatch(
        r".*/cut: the (recording is cut off: (5\.[0-9]) of 7\.0 s of the run and ([0-9]+)"
        r" of ([0-9]+) ticks can be read, and only these are judged\.)\n",
        err,
    )
    assert said is not None
    whole = read_summary(good)
    assert int(said[4]) == whole["ticks"]
    assert int(said[3]) == pytest.approx(1000 * float(said[2]), abs=60)
    screen = first_screen(cut)
    assert f"The {said[1]}" in screen
    assert "Ran to its end" not in screen
    assert f"1000 Hz for {said[2]} of 7 s" in screen
    assert f"of {whole['ticks']} ticks missed" not in screen
    assert "ended before its processes could report" not in screen
    assert "too little contact" not in screen
    assert f'<time datetime="{whole["began_at"]}">' in screen
    assert read_summary(cut) == whole, "what the run wrote is kept"


@pytest.mark.usefixtures("no_charts")
def test_a_recording_damaged_in_the_middle_is_said_to_be(good, call, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(good, folder)
    data = bytearray((good / "recording.mcap").read_bytes())
    ends, at = [], len(MCAP0_MAGIC)
    while at < len(data) - len(MCAP0_MAGIC):
        at, kind = at + 9 + int.from_bytes(data[at + 1 : at + 9], "little"), data[at]
        ends += [at] if kind == int(Opcode.CHUNK) else []
    middle = ends[len(ends) // 2]
    data[middle - 3000 : middle - 2000] = bytes(1000)
    (folder / "recording.mcap").write_bytes(data)
    code, _, err = call("report", folder)
    assert code == 0
    assert "messages" in err
    assert "recording is damaged: 7.0 of 7.0 s of the run" in err
    screen = first_screen(folder)
    assert "The recording is damaged" in screen
    assert "ticks missed" not in screen


@pytest.mark.usefixtures("no_charts")
def test_a_run_without_a_summary_did_not_report_its_end(good, call, tmp_path):
    killed = tmp_path / "killed"
    shutil.copytree(good, killed)
    (killed / "summary.json").unlink()
    code, _, err = call("report", killed)
    assert (code, err) == (
        0,
        f"{killed}: the run did not report its end: 7.0 of 7 s are recorded.\n",
    )
    screen = first_screen(killed)
    assert "The run did not report its end: 7.0 of 7 s are recorded." in screen
    assert "Ran to its end" not in screen


@pytest.mark.parametrize("left", ["", '{"trial": "sili', "null"])
@pytest.mark.usefixtures("no_charts")
def test_of_a_summary_and_a_truth_that_were_not_written_to_their_end_the_recording_reports(
    stopped, call, tmp_path, left
):
    """As after a power failure, or in a copy on a full disk."""
    folder = tmp_path / "copied"
    shutil.copytree(stopped, folder)
    for name in ("summary.json", "truth.json"):
        (folder / name).write_text(left)
    assert call("report", folder)[0] == 0
    assert "this summary uses only the recording" in first_screen(folder)
    assert "cut off: no summary" in call("runs", folder)[1]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (shutil.rmtree, "no such folder"),
        (lambda f: (f / "recording.mcap").unlink(), "a folder without recording.mcap"),
        (lambda f: (f / "recording.mcap").write_bytes(b""), "recording.mcap: is empty"),
        (lambda f: (f / "recording.mcap").write_bytes(b"text"), "not an MCAP recording"),
        (lambda f: (f / "trial.yaml").write_text("a: 1"), "trial.yaml: not the trial of a run"),
    ],
)
def test_what_cannot_be_reported_is_refused_with_its_place(stopped, call, tmp_path, damage, words):
    folder = tmp_path / "damaged"
    shutil.copytree(stopped, folder)
    damage(folder)
    code, out, err = call("report", folder)
    assert (code, out) == (2, "")
    assert words in err


@pytest.mark.usefixtures("no_charts")
@pytest.mark.parametrize("what", ["page", "comparison", "figures"])
def test_on_a_full_disk_a_report_names_its_page_and_leaves_no_part_of_it(
    stopped, call, tmp_path, monkeypatch, files_end_at, what
):
    def figures_on_a_full_disk(_charts, out):
        out.mkdir()
        (out / "force.svg").write_text("x" * 3000)

    monkeypatch.setattr("teleop_rt.view.commands.write_figures", figures_on_a_full_disk)
    if what == "figures":
        monkeypatch.setattr("teleop_rt.view.commands.write_report", lambda _run: None)
    folder = tmp_path / "full"
    shutil.copytree(stopped, folder)
    (folder / "report.html").unlink()
    before = sorted(tmp_path.glob("**/*"))
    words, written = {
        "page": ([folder], folder / "report.html"),
        "comparison": (["--compare", folder, stopped, "--out", "c.html"], "c.html"),
        "figures": ([folder, "--figures", "drawn"], "drawn"),
    }[what]
    files_end_at(2000)
    code, _, err = call("report", *words)
    assert code == 1
    assert err.startswith(f"{written}: cannot be written: File too large: make room")
    assert sorted(tmp_path.glob("**/*")) == before


@pytest.mark.usefixtures("no_charts")
def test_the_first_screen_shows_what_the_recorder_lost_and_why(good, tmp_path):
    reported = {"dropped": {"/slave": 12}, "alarm": "the disk refuses the recording", "restarts": 1}
    summary = json.loads((good / "summary.json").read_text())
    folder = tmp_path / "run"
    shutil.copytree(good, folder)
    report_of_run(folder, {**summary, "notes": list(of_recorder(reported))}, felt_of)
    screen = first_screen(folder)
    for words in ("12 rows were not recorded", reported["alarm"], "ended unexpectedly once"):
        assert words in screen


@pytest.mark.usefixtures("no_charts")
def test_an_algebraic_estimator_shows_a_dash_for_its_deviation_and_why(good, tmp_path):
    summary = json.loads((good / "summary.json").read_text())
    assert NO_DEVIATION not in (good / "report.html").read_text()
    chosen = next(row for row in summary["estimators"] if row["model"] == "kelvin-voigt")
    chosen["regression"] = "algebraic"
    for one in chosen["parameters"].values():
        one["std"] = None
    folder = tmp_path / "run"
    shutil.copytree(good, folder)
    report_of_run(folder, {**summary, "selected": chosen}, felt_of)
    page = (folder / "report.html").read_text()
    assert page.count(NO_DEVIATION) == 1
    assert len(re.findall(r"k = [\d.]+ ± – N/m", page)) == 2  # first screen and table


@pytest.mark.parametrize(("note", "headline"), [
    (STEPS_OF_MOTION, "It worked"), ("the master never engaged", "read the notes below"),
])  # fmt: skip
@pytest.mark.usefixtures("no_charts")
def test_a_note_on_how_a_run_was_judged_leaves_it_good(good, tmp_path, note, headline):
    summary = json.loads((good / "summary.json").read_text())
    folder = tmp_path / "run"
    shutil.copytree(good, folder)
    report_of_run(folder, {**summary, "notes": [note]}, felt_of)
    screen = first_screen(folder)
    assert headline in screen
    assert note.partition(":")[0] in screen


def test_a_folder_of_another_version_is_refused_by_name(stopped, call, tmp_path):
    folder = tmp_path / "later"
    shutil.copytree(stopped, folder)
    summary = json.loads((folder / "summary.json").read_text())
    del summary["safety"]
    summary["software"]["version"] = "9.9"
    (folder / "summary.json").write_text(json.dumps(summary))
    code, _, err = call("report", folder)
    assert code == 2
    assert "written by teleop-rt 9.9" in err
    assert "'safety'" in err


def test_runs_stand_side_by_side_with_what_differs(good, stopped, call, tmp_path):
    page = tmp_path / "three.html"
    code, out, _ = call("report", "--compare", good, stopped, good, "--out", page)
    assert (code, out.strip()) == (0, str(page))
    text = page.read_text()
    assert "<h1>3 runs, side by side</h1>" in text
    assert fault_of(stopped)["name"].replace("_", " ") in text
    assert "<code>rig.limits.force_max_N</code>" in text
    assert "<code>operator.frequency_hz</code>" not in text
    assert text.count('aria-label="force and residual of every run"') >= 1
    assert "k [N/m]" in text
    for folders in ((good, stopped), ("--compare", good)):
        code, _, err = call("report", *folders)
        assert code == 2
        assert "--compare" in err


def test_an_effect_hidden_in_the_plant_is_among_the_keys_that_differ(good, tmp_path):
    folder = tmp_path / "layered"
    shutil.copytree(good, folder)
    truth = json.loads((folder / "truth.json").read_text())
    truth["undeclared"] = [{"effect": "second_layer", "stiffness": 2500.0, "depth": 0.013}]
    (folder / "truth.json").write_text(json.dumps(truth))
    runs = [load_run(f, read_summary(f), read_recorded(f)) for f in (good, folder)]
    assert different_keys(runs) == [
        ("plant.undeclared[0].depth", ["–", "0.013"]),
        ("plant.undeclared[0].effect", ["–", "second_layer"]),
        ("plant.undeclared[0].stiffness", ["–", "2500"]),
    ]


def test_only_figures_with_a_zero_have_a_percentage_and_colour_follows_the_grade(good, stopped):
    runs = [load_run(f, read_summary(f), read_recorded(f)) for f in (good, stopped, good)]
    worse = copy.deepcopy(dict(runs[2].summary))
    worse["master"] |= {"nrmse": 3.0 * worse["master"]["nrmse"], "lag_ms": 400.0}
    worse["contact"]["surface_found"] *= 1.5
    runs[2] = replace(runs[2], summary=worse)
    headings, rows = compared(runs)
    third = dict(zip(headings, rows[2], strict=True))
    assert third["felt error"].change == "× 3"
    assert third["felt error"].better is False
    assert third["felt lag [ms]"].grade == "attention"
    assert third["surface [mm]"].change == ""
    assert third["k [N/m]"].change == "same"
    ended = dict(zip(headings, rows[1], strict=True))["ended"]
    assert (ended.text, ended.grade) == (fault_of(stopped)["name"].replace("_", " "), "bad")


def test_the_report_is_the_one_that_the_run_wrote_and_every_figure_is_exported(
    good, call, tmp_path
):
    out, before = tmp_path / "figures", (good / "report.html").read_bytes()
    code, reported, err = call("report", good, "--figures", out)
    assert (code, err) == (0, "")
    page, *exported = reported.splitlines()
    assert page == str(good / "report.html")
    assert (good / "report.html").read_bytes() == before
    written = {path.name for path in out.iterdir()}
    assert {Path(line).name for line in exported} == written
    for name in ("felt", "force", "position", "parameters-kelvin-voigt", "link", "energy"):
        assert {f"{name}.svg", f"{name}.pdf", f"{name}.csv"} <= written
    assert (out / "force.pdf").read_bytes().startswith(b"%PDF")
    with (out / "force.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    run = load_run(good, read_summary(good), read_recorded(good))
    reported = [(row["time [s]"], row["force [N] measured, raw"]) for row in rows]
    known = np.array([(t, force) for t, force in reported if force], dtype=np.float64)
    assert np.allclose(known[:, 1], run.slave["force"], rtol=1e-8)
    assert np.allclose(known[:, 0], run_times.seconds(run, run.slave), atol=1e-8)
    code, _, err = call("report", good, "--figures", out)
    assert code == 2
    assert "--figures" in err


def test_the_runs_of_a_folder_are_listed_filtered_and_graded(good, stopped, call, tmp_path):
    runs = tmp_path / "runs"
    runs.mkdir()
    for run in (good, stopped):
        (runs / run.name).symlink_to(run)
    code, text, _ = call("runs", runs)
    assert code == 0
    header, first, second = (line.split() for line in text.splitlines())
    assert header[:3] == ["began", "why", "trial"]
    assert {first[0], second[0]} == {"✓", "✕"}
    code, lines, _ = call("runs", runs, "--grade", "bad", "--json")
    (row,) = (json.loads(line) for line in lines.splitlines())
    assert (row["folder"], row["ended"]) == (
        str(runs / stopped.name),
        fault_of(stopped)["name"],
    )
    assert "safety" in row["why"]
    assert row["why"] in text
    (row,) = (json.loads(line) for line in call("runs", good, "--json")[1].splitlines())
    assert not row["why"]
    selected = json.loads((good / "summary.json").read_text())["selected"]
    found = selected["parameters"]["k"]
    assert row["parameters"]["k"] == {key: found[key] for key in ("value", "std", "unit")}
    line = next(line for line in text.splitlines() if "✓" in line)
    std = float(f"{found['std']:.2g}")
    assert f" ± {std:g} N/m, b = " in line
    assert (
        call("runs", runs, "--trial", "other")[1] == f"no runs of this trial or grade in {runs}\n"
    )
    assert call("runs", good / "nowhere")[0] == 2


@pytest.mark.parametrize(
    ("summary", "grade", "ended"),
    [
        ({"side": "sim"}, "unknown", "sim alone"),
        ({"side": "master", "state": "IDLE"}, "unknown", "master alone"),
        (
            {"side": "slave", "safety": {"state": "HOLD", "fault": {"code": 0, "name": "none"}}},
            "good",
            "slave alone: HOLD",
        ),
        (
            {"side": "slave", "safety": {"state": "FAULT", "fault": {"code": 7, "name": "late"}}},
            "bad",
            "slave alone: late",
        ),
    ],
)
def test_a_side_that_ran_alone_is_listed_and_has_no_report(call, tmp_path, summary, grade, ended):
    (tmp_path / "summary.json").write_text(json.dumps({"trial": "cube"} | summary))
    (row,) = (json.loads(line) for line in call("runs", tmp_path, "--json")[1].splitlines())
    assert (row["trial"], row["grade"], row["ended"]) == ("cube", grade, ended)
    code, _, error = call("report", tmp_path)
    assert code == 2
    assert f"{summary['side']} ran alone" in error


def test_the_report_of_the_newest_listed_run_is_opened(good, stopped, call, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("teleop_rt.cli.showing.typer.launch", opened.append)
    for run, began_at in ((good, "2026-01-02T10:00:00"), (stopped, "2026-01-03T10:00:00")):
        shutil.copytree(run, tmp_path / "runs" / run.name)
        file = tmp_path / "runs" / run.name / "summary.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | {"began_at": began_at}))
    runs = tmp_path / "runs"
    assert call("runs", runs, "--open")[0] == 0
    assert call("runs", runs, "--grade", "bad", "--open")[0] == 0
    assert opened == [(runs / stopped.name / "report.html").as_uri()] * 2
    (runs / stopped.name / "report.html").unlink()
    code, _, errors = call("runs", runs, "--open")
    assert code == 2
    assert f"`teleop-rt report {runs / stopped.name}` writes it" in errors


def test_delays_are_reported_per_model_and_one_overtaken_counts_as_lost():
    slave = {"stamp_ns": np.arange(6) * 1e6, "model_sequence": np.array([0, 1, 2, 3, 3, 4.0])}
    master = {"stamp_ns": np.arange(6) * 1e6, "model_sequence": np.array([0, 0, 0, 1, 1, 3.0])}
    delays = one_way_delays(slave, master)
    assert delays.sent_ns.tolist() == [1e6, 2e6, 3e6]
    assert np.array_equal(delays.delay_ms, [2.0, np.nan, 2.0], equal_nan=True)
    assert one_way_delays(slave, {}) is None


def test_the_link_figure_shows_half_of_the_round_trip_that_was_configured(good):
    run = load_run(good, read_summary(good), read_recorded(good))
    delays = one_way_delays(run.slave, run.master)
    assert delays.median_ms == pytest.approx(75.0, abs=1.5)
    assert 0.5 < delays.jitter_ms < 5.0


@pytest.mark.parametrize(("most", "step"), [(7_000, 8), (7_050, 1)])
def test_a_run_is_read_whole_or_where_it_is_longer_down_to_a_few_rows(
    good, monkeypatch, most, step
):
    monkeypatch.setattr(run_folder, "MOST_ROWS", dict.fromkeys(run_folder.MOST_ROWS, most))
    longer = dict.fromkeys(run_folder.MOST_ROWS, 1_000)
    monkeypatch.setattr(run_folder, "ROWS_OF_LONGER", longer)
    topics = read_recorded(good)
    run = load_run(good, read_summary(good), topics, felt_of)
    assert run.step == step
    assert (run.felt is None) == (step > 1)
    assert run.slave["tick"].size == pytest.approx(7_050 / step, abs=2)
    assert run.slave["tick"][-1] == 7_050
    assert run.master["stamp_ns"].size == pytest.approx(7_050 / step, abs=2)


def test_a_single_peak_survives_thinning_and_the_columns_stay_of_one_table():
    values, other = np.zeros(100_000), np.arange(100_000.0)
    values[54_321] = 7.0
    other[100:400] = np.nan
    kept = kept_rows([values, other], 2400)
    assert kept.size < 2500
    assert 54_321 in kept
    assert np.all(np.diff(kept) > 0)
    assert np.isnan(other[kept]).any()
    values[200:203] = np.nan  # shorter than a bucket
    assert np.isnan(values[kept_rows([values], 2400)]).any()
    assert np.array_equal(kept_rows([values[:10]], 2400), np.arange(10))


def test_a_master_alone_that_was_killed_is_reported_as_such_and_listed_by_its_trial(
    good, call, tmp_path
):
    folder = tmp_path / "killed"
    folder.mkdir()
    shutil.copy(good / "trial.yaml", folder)
    units = Units(position="m", force="N")
    with closing(RecordingWriter(folder / "recording.mcap", units)) as writer:
        writer.add_topic(MASTER_TOPIC, MASTER)
        writer.write_rows(MASTER_TOPIC, np.zeros((10, len(MASTER))))
    code, _, error = call("report", folder)
    assert code == 2
    assert "the master ran alone here and was cut off" in error
    (row,) = (json.loads(line) for line in call("runs", folder, "--json")[1].splitlines())
    assert (row["trial"], row["ended"]) == ("silicone_cube", "cut off: no summary")
