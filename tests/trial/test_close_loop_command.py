"""`teleop-rt close-loop` on measured files: nothing moves, another file is the fresh data."""

from __future__ import annotations

import errno
import io
import json
import os
import re
import shutil
import sys
from contextlib import redirect_stdout

import numpy as np
import pytest
import typer
import yaml

from teleop_rt.cli import main
from teleop_rt.contact.effects.user import load_file
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.offline import closing_command, closing_files
from teleop_rt.offline.closing_files import Files, close_over
from teleop_rt.offline.load import load_any
from teleop_rt.offline.table import Table
from teleop_rt_dev.trial.files import TRIALS

FOAM = TRIALS / "stiffening_foam.yaml"
SURFACE = 0.010
OF_THE_COMMAND = {"seconds", "phases", "finished_at"}
"""Added to the answer by the command itself."""


def measured(path, hertz, seed=1):
    """Write a press on a body that stiffens with depth, with lift-offs in between."""
    t = np.arange(3000) * 1e-3
    x = 0.004 + 0.01 * np.sin(2 * np.pi * hertz * t) + 0.004 * np.sin(5.1 * np.pi * hertz * t)
    v = np.gradient(x, t)
    spring = 1500 * x + 6e4 * np.maximum(x, 0.0) ** 2
    force = np.where(x > 0, np.maximum(0.0, spring + 20 * v), 0.0)
    force += np.random.default_rng(seed).normal(0, 0.05, t.size)
    position = SURFACE + np.round(x / 5e-6) * 5e-6
    np.savetxt(path, np.c_[t, position, force], delimiter=",", header="t_s,position_m,force_N",
               comments="")  # fmt: skip
    return path


@pytest.fixture(scope="module")
def closed(tmp_path_factory):
    """Close the loop over two files with `--json`; returns its folder and the printed answer."""
    place = tmp_path_factory.mktemp("measured")
    first = measured(place / "first.csv", 1.3)
    other = measured(place / "other.csv", 1.0, seed=2)
    out = place / "loop"
    words = ("close-loop", "--recording", first, "--test", other, "--out", out, "--json")
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as printed:
        patch.setattr(sys, "argv", ["teleop-rt", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
    assert not end.value.code
    return out, json.loads(printed.getvalue())


def test_measured_files_close_the_loop_without_moving_anything(closed):
    out, answer = closed
    assert answer == json.loads((out / "loop.json").read_text())
    assert answer["class"][0] == ["nonlinear_stiffening"]
    for error in (answer["fresh"]["slave"]["free_run"], answer["fresh"]["slave"]["on_line"]):
        assert error["after"] < 0.4 * error["before"]
    assert answer["fresh"]["master"]["before"] is None
    assert "no hand" in answer["fresh"]["master"]["reason"]
    assert answer["withdrawn"] is None
    model = yaml.safe_load((out / "model.yaml").read_text())
    assert model["effects"][0]["name"] == "nonlinear_stiffening"
    assert (out / "diagnosis" / "residual.pdf").read_bytes().startswith(b"%PDF")
    page = (out / "loop.html").read_text()
    assert "nonlinear stiffening" in page
    assert f"{100 * answer['fresh']['slave']['free_run']['after']:.2g} %" in page
    assert "no hand has felt" in page
    assert "<h2>Residual over time, on fresh data</h2>" in page
    assert "not measured" in page
    assert [phase["name"] for phase in answer["phases"]] == ["diagnosis"]


@pytest.mark.usefixtures("no_pages")
def test_a_closed_loop_is_printed_with_its_effect_and_errors(closed, call, tmp_path, monkeypatch):
    first, other = (closed[0].parent / name for name in ("first.csv", "other.csv"))
    found = {key: part for key, part in closed[1].items() if key not in OF_THE_COMMAND}
    monkeypatch.setattr(closing_command, "close_recordings", lambda *_: (found, None))
    code, text, err = call(
        "close-loop", "--recording", first, "--test", other, "--out", tmp_path / "loop"
    )
    assert (code, "Traceback" in err) == (0, False)
    assert "nonlinear_stiffening (environment): " in text
    assert re.search(r"Probability 0\.\d\d; explains [\d.]+ % of the base's residual", text)
    assert re.search(r"predicted in free run: NRMSE before [\d.]+, after [\d.]+", text)
    assert text.splitlines()[-1] == f"files in {tmp_path / 'loop'}"
    assert json.loads((tmp_path / "loop" / "loop.json").read_text())["probability"]


@pytest.mark.usefixtures("no_pages")
def test_the_first_line_of_a_closed_loop_says_that_its_model_is_withdrawn(
    closed, call, tmp_path, monkeypatch
):
    first, other = (closed[0].parent / name for name in ("first.csv", "other.csv"))
    found = {key: part for key, part in closed[1].items() if key not in OF_THE_COMMAND}
    gone = found | {"withdrawn": ["an error"], "reason": "it is withdrawn"}
    monkeypatch.setattr(closing_command, "close_recordings", lambda *_: (gone, None))
    _, text, _ = call(
        "close-loop", "--recording", first, "--test", other, "--out", tmp_path / "loop"
    )
    assert text.splitlines()[0].endswith(f": {found['verdict']}, model withdrawn")
    assert "in the withdrawn model nonlinear_stiffening is rendered to the operator: " in text


def no_room(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.usefixtures("no_pages")
@pytest.mark.parametrize("full_at", ["write_diagnosis", "write_json"])
def test_a_full_disk_loses_no_answer_of_a_closed_loop(closed, call, tmp_path, monkeypatch, full_at):
    first, other = (closed[0].parent / name for name in ("first.csv", "other.csv"))
    out = tmp_path / "loop"
    place = closing_files if full_at == "write_diagnosis" else closing_command
    monkeypatch.setattr(place, full_at, no_room)
    words = ("close-loop", "--recording", first, "--test", other, "--out", out)
    code, text, err = call(*words)
    assert code == 1
    assert "nonlinear_stiffening (environment): " in text
    assert re.search(r"predicted in free run: NRMSE before [\d.]+, after [\d.]+", text)
    assert "files in" not in text
    cause = f"{out}: cannot be written: No space left on device: make room, or name another folder"
    assert err.splitlines()[-1].startswith(cause)
    if full_at == "write_json":
        shutil.rmtree(out)
    code, text, _ = call(*words, "--json")
    answer = json.loads(text)
    assert (code, answer["fresh"]) == (1, closed[1]["fresh"])
    assert answer["problem"].startswith(cause)


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), typer.Exit(1)])
def test_the_diagnosis_of_a_trial_outlives_a_fresh_run_that_fails(
    closed, call, tmp_path, monkeypatch, error
):
    found = {key: part for key, part in closed[1].items() if key not in OF_THE_COMMAND}

    def close_loop(_trial, _base, _run, _library, _out, keep):
        keep(found | {"fresh": None})
        raise error

    monkeypatch.setattr(closing_command, "close_loop", close_loop)
    code, text, err = call("close-loop", FOAM, "--clock", "simulated", "--out", tmp_path / "loop")
    assert code == 1
    assert "nonlinear_stiffening (environment): " in text
    assert ("No space left" in err) == isinstance(error, OSError)


def rubbed(path, hertz, seed=1):
    """Write a press on a body that rubs the more the deeper the tool is: no declared effect."""
    t = np.arange(3000) * 1e-3
    x = 0.004 + 0.01 * np.sin(2 * np.pi * hertz * t) + 0.004 * np.sin(5.1 * np.pi * hertz * t)
    v = np.gradient(x, t)
    rub = 8.0 * (x / 0.018) ** 2 * np.tanh(v / 0.01)
    force = np.where(x > 0, 1500 * x + 20 * v + rub, 0.0)
    force += np.random.default_rng(seed).normal(0, 0.05, t.size)
    np.savetxt(path, np.c_[t, x, force], delimiter=",", header="t_s,position_m,force_N",
               comments="")  # fmt: skip
    return path


def test_without_a_word_for_it_the_loop_goes_on_with_a_drafted_law(tmp_path):
    paths = [rubbed(tmp_path / f"{hz}.csv", hz, seed=seed) for seed, hz in enumerate((1.3, 1.0))]
    first, other = (load_any(path, Table({}, {}, None)) for path in paths)
    out = tmp_path / "loop"
    out.mkdir()
    found = diagnose(first, "kelvin-voigt", test=other, effects=())
    answer, shown = close_over(found, first, other, Files(*paths, Table({}, {}, None)), out)
    assert (answer["verdict"], answer["effects"]) == ("unexplained", [])
    assert max(answer["dependence"], key=answer["dependence"].get) in {"velocity", "past"}
    slave = answer["fresh"]["slave"]
    assert slave["free_run"]["after"] < 0.4 * slave["free_run"]["before"]
    assert slave["free_run"]["after"] == answer["draft"]["error"]["after"]
    ratio = np.std(shown.after) / np.std(shown.before)  # the page draws the other file
    assert ratio == pytest.approx(
        slave["free_run"]["after"] / slave["free_run"]["before"], rel=0.02
    )
    # An estimator that forgets follows some of the law by itself.
    assert slave["on_line"]["after"] < 0.7 * slave["on_line"]["before"]
    assert answer["fresh"]["handled"][0]["where"] == "rendered to the operator"
    assert answer["withdrawn"] is None
    assert [e["name"] for e in yaml.safe_load((out / "model.yaml").read_text())["effects"]] == [
        "draft_effect"
    ]
    (declared,) = load_file(out / "diagnosis" / "draft_effect.py")
    assert declared.belongs_to == "environment"
    assert (out / "diagnosis" / "draft_effect.png").stat().st_size > 10_000
    page = (out / "diagnosis" / "diagnosis.html").read_text()
    assert "A law was drafted from it" in page
    assert "What is left depends on" in page


def test_a_trial_and_measured_files_at_once_are_refused(call, tmp_path):
    code, out, err = call("close-loop", "--recording", tmp_path / "first.csv")
    assert (code, out) == (2, "")
    assert "both --recording and --test" in err


@pytest.mark.parametrize("base", ["maxwell", "stiffness,damping"])
def test_a_base_that_does_not_run_on_line_is_refused_before_the_trial_moves(call, tmp_path, base):
    arguments = ("--clock", "simulated", "--base", base, "--out", tmp_path / "loop")
    code, out, err = call("close-loop", FOAM, *arguments)
    assert (code, out) == (2, "")
    assert f"estimation.models=[{base}]" in err
    assert not (tmp_path / "loop").exists()


def test_an_unknown_base_of_measured_files_is_reported_and_nothing_is_written(call, tmp_path):
    first, other = (measured(tmp_path / f"{hertz}.csv", hertz) for hertz in (1.0, 1.3))
    arguments = ("--recording", first, "--test", other, "--out", tmp_path / "loop")
    code, out, err = call("close-loop", *arguments, "--base", "maxwell")
    assert (code, out) == (2, "")
    assert err.splitlines()[-1].startswith("unknown base 'maxwell'")
    assert not (tmp_path / "loop").exists()
