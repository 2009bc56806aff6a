"""A table whose columns of position and force are exchanged gets a hint, and no other does."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from teleop_rt.diagnosis.samples.exchanged import exchange_note
from teleop_rt.offline import work
from teleop_rt.recordings.recording import from_arrays

DATA = Path(os.environ.get("TELEOP_RT_DATA", "/nowhere"))
TIME_S = np.arange(0.0, 10.0, 0.002)
NAMES = {"chiaro.csv": ("position_um", "force_nN"), "rack.csv": ("position_m", "force_N")}


def pressed(*, above=0.004, noise=0.05):
    motion = 0.006 * np.sin(4.0 * TIME_S) + 0.003 * np.sin(13.0 * TIME_S) + above
    force = np.maximum(2500.0 * motion, 0.0)
    return 0.04 + motion, force + noise * np.random.default_rng(3).standard_normal(TIME_S.size)


def hint(time_s, position, force):
    return exchange_note(from_arrays("table", time_s, position, force))


@pytest.mark.parametrize("above", [0.004, 0.0, -0.003])
def test_exchanged_columns_get_a_hint_and_the_same_in_order_none(above):
    position, force = pressed(above=above)
    assert hint(TIME_S, position, force) is None
    assert "columns exchanged?" in hint(TIME_S, 1e-3 * force, 1e3 * position)


def test_a_body_fixed_to_the_tool_a_held_step_and_friction_get_none():
    position, _ = pressed()
    noise = 0.05 * np.random.default_rng(4).standard_normal(TIME_S.size)
    velocity = np.gradient(position, TIME_S)
    held = np.minimum(TIME_S, 1.0)
    for motion, force in (
        (position, 2500.0 * (position - 0.04)),
        (position, 5.0 * np.sign(velocity)),
        (held, 30.0 * held * np.exp(-np.maximum(0.0, TIME_S - 1.0))),
    ):
        assert hint(TIME_S, motion, force + noise) is None


def measured():
    for path in sorted(DATA.rglob("*.csv")):
        if path.name.startswith("a3"):  # raw recorders of one channel each
            continue
        table = np.genfromtxt(path, delimiter=",", names=True, encoding="utf-8-sig")
        names = table.dtype.names
        pairs = [("xs_rad", "Fe_Nm"), ("xm_rad", "minusFh_Nm")] if "xs_rad" in names else None
        for position, force in pairs or [NAMES.get(path.name, names[1:3])]:
            yield path.name, table[position], table[force]
    for path in sorted(DATA.rglob("*.mat")):
        content = loadmat(path)
        if "x_F" in content:
            yield path.name, content["x_F"][:, 0], content["x_F"][:, 2]
        else:
            yield path.name, content["qm"].ravel(), content["vir"].ravel()


@pytest.mark.skipif(not DATA.is_dir(), reason="measured data: TELEOP_RT_DATA is not set")
def test_no_measured_recording_gets_a_hint():
    found = {}
    for name, position, force in measured():
        known = np.isfinite(position) & np.isfinite(force)
        time_s = 1e-3 * np.arange(np.count_nonzero(known))  # the times are of no account here
        found[name] = hint(time_s, position[known], force[known])
    assert len(found) >= 29
    assert set(found.values()) == {None}


def written(path, header, *columns):
    rows = np.column_stack(columns)
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return path


def test_the_diagnosis_of_a_table_carries_the_hint(call, tmp_path, monkeypatch):
    monkeypatch.setattr(work, "library", lambda _file: ())  # a hint looks at no effect
    position, force = pressed()
    table = written(tmp_path / "t.csv", "t_s,force_N,position_mm", TIME_S, 1e3 * position, force)
    code, out, _ = call("diagnose", table)
    assert code == 0
    assert "note: columns exchanged?" in out
    assert "with --columns position=force_N force=position_mm" in out


@pytest.mark.parametrize("command", ["diagnose", "replay"])
def test_a_refusal_for_the_unit_carries_the_hint_alone(call, tmp_path, command):
    position, force = pressed()
    table = written(tmp_path / "t.csv", "t_s,position_m,force_N", TIME_S, force, position)
    code, _, problem = call(command, table)
    assert code == 2
    assert problem.splitlines()[-1].count("exchanged") == 1
    assert "wrong unit?" in problem
    assert problem.endswith("; exchange them with --columns position=force_N force=position_m\n")


@pytest.mark.parametrize("command", ["diagnose", "replay"])
def test_a_refusal_for_the_sign_carries_the_hint(call, tmp_path, command):
    position, force = pressed()
    force = -force  # of a cell that counts pressure negative
    table = written(tmp_path / "t.csv", "t_s,position_mm,force_N", TIME_S, force, position)
    code, _, problem = call(command, table)
    assert code == 2
    assert "wrong sign?" in problem
    assert "columns exchanged?" in problem
