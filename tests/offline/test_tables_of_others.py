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


def table(
    path: Path, *, time: np.ndarray = T, position: np.ndarray = X, force: np.ndarray = FORCE
) -> Path:
    rows = np.column_stack([time, position, force])
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
    said = f"is exactly {mark:g} in 100 of 3000 samples, .* times .* missing values.* remove"
    with pytest.raises(RecordingError, match=said):
        load(path)
    rows[name][700:800] = np.nan
    np.savez(path, **rows)
    assert load(path).missing == 100


def test_the_columns_are_printed_where_a_name_or_a_unit_is_a_guess(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "a.csv")
    load(path)
    assert capsys.readouterr().err == ""
    text = path.read_text()
    for names, read in (
        (
            "time,x_mm,F_N",
            "time = time [s, as none is given], position = x_mm [mm], force = F_N [N]",
        ),
        ("Zeit [s],x_mm,F_N", "time = Zeit [s], position = x_mm [mm], force = F_N [N]"),
        ("t_s,disp_mm,load_g", "time = t_s [s], position = disp_mm [mm], force = load_g [g]"),
    ):
        path.write_text(text.replace("t_s,x_mm,F_N", names))
        load(path)
        assert capsys.readouterr().err == f"{path}: read: {read}\n"


JOIN = 1500


def test_two_recordings_that_were_joined_are_refused_with_the_time_to_cut(tmp_path: Path) -> None:
    moved = X + np.where(np.arange(X.size) < JOIN, 0.0, 4.0)
    with pytest.raises(RecordingError, match=r"position jumps by 0.004\d* m at t = 1.5 s .*cut it"):
        load(table(tmp_path / "a.csv", position=moved))
    again = np.where(np.arange(T.size) < JOIN, T, T - T[JOIN])
    with pytest.raises(RecordingError, match=r"time does not increase .*two recordings in one"):
        load(table(tmp_path / "a.csv", time=again, position=moved))


@pytest.mark.parametrize("kind", ["bad counts", "gap", "step", "begun"])
def test_counts_that_return_gaps_and_steps_of_a_tool_at_rest_are_no_joined_recordings(
    tmp_path: Path, kind: str
) -> None:
    position, kept = X.copy(), np.ones(X.size, dtype=bool)
    late = np.arange(X.size) >= JOIN
    if kind == "bad counts":
        position[JOIN : JOIN + 7] += 40.0
    elif kind == "gap":
        position[late] += 4.0
        kept[JOIN - 50 : JOIN] = False
    else:
        noise = np.random.default_rng(2).normal(0.0, 0.002, X.size)
        position = np.where(late, 4.0 + (X if kind == "begun" else 0.0), 0.0) + noise
    file = tmp_path / "a.npz"
    np.savez(file, t_s=T[kept], x_mm=position[kept], F_N=FORCE[kept])
    assert load(file).name == "a.npz"


def test_a_force_that_is_cut_at_its_range_is_no_mark_for_missing_values(tmp_path: Path) -> None:
    assert load(table(tmp_path / "a.csv", force=np.minimum(FORCE, 6.0))).missing == 0


def test_a_column_of_texts_that_is_no_number_anywhere_is_not_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "a.csv")
    names, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{names},status", *(f"{row},OK" for row in rows)]))
    assert load(path).force == pytest.approx(FORCE)
    assert capsys.readouterr().err == ""
    rows[5] = rows[5].rpartition(",")[0] + ",OL"
    path.write_text("\n".join([f"{names},status", *(f"{row},OK" for row in rows)]))
    load(path)
    assert capsys.readouterr().err == (
        f"{path}: line 7, column 'F_N': 'OL' is no number: counted as missing\n"
    )


def test_a_line_that_names_the_columns_again_is_pointed_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "a.csv")
    names, *rows = path.read_text().splitlines()
    path.write_text("\n".join([names, *rows, names, *rows]))
    with pytest.raises(RecordingError, match=r"two recordings in one file\?"):
        load(path)
    assert capsys.readouterr().err == f"{path}: line 3002 names the columns again\n"


@pytest.mark.parametrize(
    ("time", "cause"),
    [
        (np.where(T < 2.0, T, T - 2.0), r"two recordings in one file\? Save each"),
        (86398.0 + np.where(T < 2.0, T, T - 86400.0), r"past midnight\? Add 86400 s to the later"),
        (np.where(np.arange(3000) == 900, T - 0.0015, T), "sort the rows by time"),
    ],
)
def test_time_that_runs_backwards_is_explained(
    tmp_path: Path, time: np.ndarray, cause: str
) -> None:
    with pytest.raises(RecordingError, match=cause) as raised:
        load(table(tmp_path / "a.csv", time=time))
    assert ("sort" in str(raised.value)) is ("sort" in cause)


def test_a_file_of_names_alone_is_said_to_have_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t_s,x_mm,F_N\n")
    with pytest.raises(RecordingError, match="no lines of numbers below line 1: was anything rec"):
        load(path)


@pytest.mark.parametrize("names", ["t_s,x_mm,F_N\n", "bench 3\nt_s,x_mm,F_N\n", ""])
def test_a_file_with_one_row_of_numbers_is_said_to_have_one(tmp_path: Path, names: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{names}0,1,2\n")
    row = names.count("\n") + 1
    with pytest.raises(RecordingError, match=f"line {row} is the only row of numbers: was the rec"):
        load(path)


def test_labels_before_names_and_units_are_no_names_and_volts_are_no_length(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = np.column_stack([T, FORCE, T, X])
    head = 'Interval,1,Interval,1\nChannel name,"Force",Channel name,"Input 1"\nUnit,"N",Unit,"V"'
    path = tmp_path / "a.csv"
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.9g")
    columns = {"time": "column1", "position": "Input 1 [V]"}
    with pytest.raises(RecordingError, match=r"Input 1 \[V\]: V is no unit of position: .*FACTOR"):
        load(path, layout_of(path, columns))
    found = load(path, layout_of(path, columns, {"position": "1e-3"}))
    assert found.position == pytest.approx(1e-3 * X)
    assert found.force == pytest.approx(FORCE)
    assert "columns: column1, Force [N], column3, Input 1 [V]" in capsys.readouterr().err
