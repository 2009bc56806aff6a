"""Tables as others save them: structures, coarse stamps, and the advice that helps with each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from teleop_rt.errors import RecordingError
from teleop_rt.recordings.layout import layout_of
from teleop_rt.recordings.recording import load

T = np.arange(3000) * 1e-3
X = 12.0 - 8.0 * np.cos(6.0 * T)
FORCE = np.where(X > 10.0, 2.0 * (X - 10.0), 0.0)


def table(path: Path, *, time: np.ndarray = T, force: np.ndarray = FORCE) -> Path:
    rows = np.column_stack([time, X, force])
    np.savetxt(path, rows, delimiter=",", header="t_s,x_mm,F_N", comments="", fmt="%.9g")
    return path


def test_fields_of_a_matlab_struct_are_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"log": {"time": T, "position_mm": X, "force": FORCE, "rig": "A", "n": {"f": T}}})
    found = load(path)
    assert found.position == pytest.approx(1e-3 * X)
    assert found.force == pytest.approx(FORCE)
    assert load(path, layout_of(path, {"force": "-log.force"})).force == pytest.approx(-FORCE)


def test_a_whole_name_comes_before_that_of_a_field(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"time": T, "position": X, "force": FORCE, "goal": {"position": -X}})
    assert load(path).position == pytest.approx(X)


def test_times_that_repeat_are_left_out_as_the_refusal_says(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", time=np.floor(T / 0.0156) * 0.0156)
    advice = "--columns position=NAME force=NAME --rate HZ"
    for rate_hz in (None, 1000.0):
        with pytest.raises(RecordingError, match=advice):
            load(path, layout_of(path, rate_hz=rate_hz))
    found = load(path, layout_of(path, {"position": "x_mm", "force": "F_N"}, rate_hz=1000.0))
    assert found.dt == pytest.approx(1e-3)
    assert found.force == pytest.approx(FORCE)


def test_a_rate_beside_a_column_that_is_given_for_the_time_is_refused(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv")
    columns = {"time": "t_s", "position": "x_mm", "force": "F_N"}
    with pytest.raises(RecordingError, match="leave out --rate"):
        load(path, layout_of(path, columns, rate_hz=1000.0))


@pytest.mark.parametrize(("role", "mark"), [("force", -9999.0), ("x", 32767.0)])
def test_a_mark_for_missing_values_is_pointed_at(tmp_path: Path, role: str, mark: float) -> None:
    path = tmp_path / "a.npz"
    rows = {"t_s": T, "x_mm": X.copy(), "force_mN": FORCE.copy()}
    name = next(name for name in rows if name.startswith(role))
    rows[name][700:800] = mark
    np.savez(path, **rows)
    said = f"is exactly {mark:g} in 100 of 3000 samples, .* times .* missing values.* delete"
    with pytest.raises(RecordingError, match=said):
        load(path)
    rows[name][700:800] = np.nan
    np.savez(path, **rows)
    assert load(path).missing == 100


def test_a_force_that_is_cut_at_its_range_is_no_mark_for_missing_values(tmp_path: Path) -> None:
    assert load(table(tmp_path / "a.csv", force=np.minimum(FORCE, 6.0))).missing == 0
