"""Columns of a table by the names that people give them, and the text beside the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from teleop_rt.errors import RecordingError
from teleop_rt.recordings.layout import layout_of
from teleop_rt.recordings.recording import load

T = np.arange(3000) * 1e-3
X = 12.0 - 8.0 * np.cos(6.0 * T)
FORCE = np.where(X > 10.0, 2.0 * (X - 10.0), 0.0)


def table(path: Path, *names: str) -> Path:
    rows = np.column_stack([T, X, FORCE, X][: len(names)])
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return path


@pytest.mark.parametrize(
    ("position", "force"), [("Encoder", "Load"), ("stroke", "load_cell"), ("Travel", "Fz")]
)
def test_names_of_sensors_are_taken_for_what_they_measure(
    tmp_path: Path, position: str, force: str
) -> None:
    found = load(table(tmp_path / "a.csv", "timestamp", f"{position} (mm)", f"{force} [N]"))
    assert found.position == pytest.approx(1e-3 * X)
    assert found.force == pytest.approx(FORCE)


def test_a_column_named_by_its_quantity_comes_before_one_named_by_its_sensor(
    tmp_path: Path,
) -> None:
    found = load(table(tmp_path / "a.csv", "t_s", "x_mm", "F_N", "encoder_m"))
    assert found.position == pytest.approx(1e-3 * X)


def test_a_name_in_small_letters_has_its_unit(tmp_path: Path) -> None:
    for name, newtons in (("force_n", 1.0), ("f_n", 1.0), ("force_kn", 1e3)):
        found = load(table(tmp_path / f"{name}.csv", "t_s", "x_mm", name))
        assert found.force == pytest.approx(newtons * FORCE)


def test_a_column_is_named_with_or_without_its_unit(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", "t_s", "Rod (mm)", "Cell (N)")
    for columns in (
        {"position": "Rod", "force": "Cell"},
        {"position": "Rod (mm)", "force": "Cell (N)"},
        {"position": "-Rod", "force": "-Cell"},
    ):
        sign = -1.0 if columns["position"].startswith("-") else 1.0
        found = load(path, layout_of(path, columns))
        assert found.position == pytest.approx(sign * 1e-3 * X)
        assert found.force == pytest.approx(sign * FORCE)
    path = table(tmp_path / "b.csv", "t_s", "Rod (mm)", "Cell (N)", "Rod (m)")
    with pytest.raises(RecordingError, match=r"'Rod' for position; there are: t_s, Rod \(mm\), C"):
        load(path, layout_of(path, {"position": "Rod", "force": "Cell"}))
    with pytest.raises(RecordingError, match=r"'Cel' for force; did you mean 'Cell \(N\)'\?"):
        load(path, layout_of(path, {"position": "Rod (mm)", "force": "Cel"}))


@pytest.mark.parametrize("sign", ["", "-"])
def test_the_surface_beside_a_table_is_in_the_unit_and_sign_of_its_position(
    tmp_path: Path, sign: str
) -> None:
    path = table(tmp_path / "a.csv", "t_s", "x_mm", "F_N")
    beside = tmp_path / "a.columns.yaml"
    beside.write_text(f"columns: {{position: '{sign}x_mm'}}\nsurface: 10\n")
    assert load(path).surface == pytest.approx(-0.01 if sign else 0.01)
    assert load(path, layout_of(path, {"position": "x_mm"})).surface is None
    beside.write_text("surface: .nan\n")
    with pytest.raises(RecordingError, match="surface"):
        load(path)


def test_a_line_of_units_below_names_with_the_same_units_changes_nothing(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", "t_s", "x_mm", "F_N")
    names, rest = path.read_text().split("\n", 1)
    path.write_text(f"{names}\ns,mm,N\n{rest}")
    found = load(path)
    assert found.position == pytest.approx(1e-3 * X)
    assert load(path, layout_of(path, {"position": "-x_mm"})).position == pytest.approx(-1e-3 * X)


def test_names_with_two_units_are_all_refused_until_the_true_one_is_stated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "a.csv", "t_s", "x_m [mm]", "F_kN [N]")
    with pytest.raises(RecordingError) as raised:
        load(path)
    assert "two units of x_m [mm] (mm or m?), F_kN [N] (N or kN?): " in str(raised.value)
    assert "--units position=mm force=N" in str(raised.value)
    for units, factor in (({"position": "mm", "force": "N"}, 1e-3), ({"position": "m"}, 1.0)):
        found = load(path, layout_of(path, units={"force": "N", **units}))
        assert found.position == pytest.approx(factor * X)
        assert found.force == pytest.approx(FORCE)
    assert capsys.readouterr().err == ""


def test_a_unit_that_is_stated_counts_before_the_names_and_both_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "a.csv", "t_s", "x_mm", "F_kN")
    found = load(path, layout_of(path, units={"force": "N", "position": "mm"}))
    assert found.force == pytest.approx(FORCE)
    said = capsys.readouterr().err
    assert said == f"{path}: F_kN is read with the unit N, as stated, in place of kN, as named\n"


def test_a_unit_that_is_stated_counts_before_an_unknown_one_in_the_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "a.csv", "t_s", "Weg [Zoll]", "F_N")
    assert load(path, layout_of(path, units={"position": "in"})).position == pytest.approx(
        0.0254 * X
    )
    assert "position = Weg [Zoll] [in]" in capsys.readouterr().err
    with pytest.raises(RecordingError, match=r"unknown unit of Weg \[Zoll\] \(unit 'Zoll'\)"):
        load(path, layout_of(path, units={"force": "N"}))


@pytest.mark.parametrize(
    ("names", "cause", "options"),
    [
        (
            ("clock", "x_mm", "Cell", "pos_mm"),
            "no column for time and force; x_mm, pos_mm could each be the position;",
            "--columns time=NAME force=NAME position=NAME,",
        ),
        (
            ("t_s", "x_ft", "wrench"),
            "no column for force; unknown unit of x_ft (unit 'ft'): give its factor",
            "--columns position=x_ft force=NAME --units position=FACTOR,",
        ),
        (
            ("time", "force", "force", "x_mm"),
            "force (column 2), force (column 3) could each be the force;",
            "--columns force=NAME,",
        ),
        (("t_s", "x_mm", "force_sensor"), "no column for force; ", "--columns force=force_sensor,"),
        (("t_s", "pos_z", "F_N"), "no column for position; ", "--columns position=pos_z,"),
        (
            ("Time [Sek.]", "Distance [mm]", "F_N"),
            "unknown unit of Time [Sek.] (unit 'Sek.'): give its factor to s,",
            "--columns 'time=Time [Sek.]' --units time=FACTOR,",
        ),
    ],
)
def test_all_that_lacks_is_listed_at_once_with_what_there_is_and_options_to_paste(
    tmp_path: Path, names: tuple[str, ...], cause: str, options: str
) -> None:
    with pytest.raises(RecordingError) as raised:
        load(table(tmp_path / "a.csv", *names))
    assert cause in str(raised.value)
    assert f"; write {options}" in str(raised.value)
    assert all(name in str(raised.value).partition("there are: ")[2] for name in names)
    assert str(raised.value).endswith(" with --rate") == ("time" in options)


def test_the_seconds_and_distance_of_a_texture_analyser_are_found(tmp_path: Path) -> None:
    found = load(table(tmp_path / "a.csv", "Time [sec.]", "Distance [mm]", "Force [N]"))
    assert found.position == pytest.approx(1e-3 * X)


def test_a_unit_behind_a_comma_is_one_and_the_column_can_be_named(tmp_path: Path, call) -> None:
    path = table(tmp_path / "a.csv", "t", "x", "F")
    text = path.read_text().replace("t,x,F", '"Time, s","Crosshead, mm","Force, N"')
    path.write_text(text)
    assert load(path).position == pytest.approx(1e-3 * X)
    named = "position=Crosshead, mm,force=Force, N"
    code, _, errors = call("replay", path, "--columns", named, "--models", "kelvin-voigt")
    assert code == 0, errors
