"""`teleop-rt close-loop` on measured files: nothing moves, another file is the fresh data."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from trial_files import TRIALS

FOAM = TRIALS / "stiffening_foam.yaml"
SURFACE = 0.010


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


def test_measured_files_close_the_loop_without_moving_anything(call, tmp_path):
    first = measured(tmp_path / "first.csv", 1.3)
    other = measured(tmp_path / "other.csv", 1.0, seed=2)
    out = tmp_path / "loop"
    code, text, _ = call(
        "close-loop", "--recording", first, "--test", other, "--out", out, "--json"
    )
    assert code == 0
    answer = json.loads(text)
    assert answer == json.loads((out / "loop.json").read_text())
    assert answer["class"][0] == ["nonlinear_stiffening"]
    for error in (answer["fresh"]["slave"]["free_run"], answer["fresh"]["slave"]["on_line"]):
        assert error["after"] < 0.4 * error["before"]
    assert answer["fresh"]["master"]["before"] is None
    assert "no hand" in answer["fresh"]["master"]["reason"]
    assert answer["withdrawn"] is None
    model = yaml.safe_load((out / "model.yaml").read_text())
    assert model["effects"][0]["name"] == "nonlinear_stiffening"


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


def test_an_unknown_base_of_measured_files_is_told_and_nothing_is_written(call, tmp_path):
    first, other = (measured(tmp_path / f"{hertz}.csv", hertz) for hertz in (1.0, 1.3))
    arguments = ("--recording", first, "--test", other, "--out", tmp_path / "loop")
    code, out, err = call("close-loop", *arguments, "--base", "maxwell")
    assert (code, out) == (2, "")
    assert err.startswith("unknown base 'maxwell'")
    assert not (tmp_path / "loop").exists()
