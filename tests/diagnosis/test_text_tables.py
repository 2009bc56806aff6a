"""Text files as testing machines, microscopes and data loggers write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.samples.converter import without_steps
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.layout import layout_of
from teleop_rt.recordings.recording import from_arrays, load
from teleop_rt.recordings.table_files import read_table
from teleop_rt.recordings.units import factor_of

RATE_HZ, SAMPLES = 50.0, 1500


@pytest.fixture
def rows() -> np.ndarray:
    """Time [s], position [mm] and force [N] of a spring of 2 N/mm that is left and met again."""
    t = np.arange(SAMPLES) / RATE_HZ
    x = 3.0 - 5.0 * np.cos(2.0 * np.pi * 0.2 * t) + np.sin(2.0 * np.pi * 0.53 * t)
    force = 2.0 * np.maximum(x, 0.0) + 0.01 * np.random.default_rng(4).standard_normal(t.size)
    return np.round(np.column_stack((t, x, force)), 5)


def lines(rows: np.ndarray, delimiter: str, decimal: str = ".") -> list[str]:
    return [delimiter.join(f"{v:.5f}".replace(".", decimal) for v in row) for row in rows]


def written(path: Path, text: list[str], encoding: str = "utf-8") -> Path:
    path.write_text("\n".join([*text, ""]), encoding=encoding)
    return path


def test_a_testing_machines_export_is_read_as_it_is(
    tmp_path: Path, rows: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    """Settings with as many fields, names, units, decimal commas and a Windows encoding."""
    head = [
        "Pr\u00fcfprotokoll;;",
        "Vorkraft:;2;N",
        "",
        "Pr\u00fcfzeit;Standardweg;Standardkraft",
        "s;mm;N",
    ]
    path = written(tmp_path / "zug.csv", head + lines(rows, ";", ","), "cp1252")
    found = load(path)
    np.testing.assert_allclose(found.position, 1e-3 * rows[:, 1])
    np.testing.assert_allclose(found.force, rows[:, 2])
    assert found.units_stated
    assert "numbers begin in line 6, columns: Pr\u00fcfzeit [s]" in capsys.readouterr().err


def test_quoted_fields_and_a_line_of_units_in_brackets_are_read(
    tmp_path: Path, rows: np.ndarray
) -> None:
    """Time in minutes at 10 Hz, compression negative, in mm and kN."""
    slow = rows[::5] * (1.0 / 60.0, -1.0, -1e-3)
    quoted = [",".join(f'"{v:.8f}"' for v in row) for row in slow]
    head = ['"Method","Foam, soft.im_comp"', '"Time","Extension","Load"', '"(min)","(mm)","(kN)"']
    path = written(tmp_path / "foam.csv", head + quoted)
    assert list(read_table(path)) == ["Time [min]", "Extension [mm]", "Load [kN]"]
    with pytest.raises(RecordingError, match=r"turn both, --columns ") as said:
        diagnose(load(path))
    assert "--columns 'position=-Extension [mm]' 'force=-Load [kN]'" in str(said.value)
    found = load(path, layout_of(path, {"position": "-Extension", "force": "-Load"}))
    assert found.dt == pytest.approx(0.1, rel=1e-3)
    np.testing.assert_allclose(found.force, rows[::5, 2], atol=1e-4)


def test_a_header_of_labview_is_no_table(tmp_path: Path, rows: np.ndarray) -> None:
    head = ["LabVIEW Measurement\t", "X0\t0.0E+0\t0.0E+0\t", "Delta_X\t0.02\t0.02\t",
            "***End_of_Header***\t\t\t", "X_Value\tLVDT\tLoad cell\tComment"]  # fmt: skip
    path = written(tmp_path / "a.lvm", head + [f"{line}\t" for line in lines(rows, "\t")])
    table = read_table(path)
    assert list(table) == ["X_Value", "LVDT", "Load cell", "Comment"]
    np.testing.assert_allclose(table["LVDT"], rows[:, 1])


def test_columns_by_blanks_without_names_are_numbered(tmp_path: Path, rows: np.ndarray) -> None:
    head = ["# setpoint: 25 nN", "# units: nm nN"]
    path = written(tmp_path / "curve.txt", head + lines(rows[:, 1:], " "))
    with pytest.raises(
        RecordingError, match=r"there are: column1, column2; write --columns time=NAME"
    ):
        load(path)
    layout = layout_of(path, {"position": "column1", "force": "column2"}, rate_hz=RATE_HZ)
    np.testing.assert_allclose(load(path, layout).force, rows[:, 2])


@pytest.mark.parametrize("delimiter", [";", ",", "\t"])
def test_a_line_of_blanks_within_a_table_is_passed_over(
    tmp_path: Path, rows: np.ndarray, delimiter: str
) -> None:
    text = lines(rows, delimiter)
    text[40:40] = ["", "   "]
    table = read_table(written(tmp_path / "blank.csv", text))
    np.testing.assert_allclose(np.column_stack(list(table.values())), rows, atol=1e-6)


def test_names_by_blanks_keep_their_units(tmp_path: Path, rows: np.ndarray) -> None:
    path = written(tmp_path / "a.dat", ["time [s]  disp [mm]  load (N)", *lines(rows, "   ")])
    np.testing.assert_allclose(load(path).position, 1e-3 * rows[:, 1])


def test_units_behind_a_slash_and_in_gravity_are_read(tmp_path: Path, rows: np.ndarray) -> None:
    path = written(
        tmp_path / "a.tsv", ["t/s\tdisp/\u00b5m\tforce/gf", *lines(rows, "\t")], "utf-16"
    )
    found = load(path)
    np.testing.assert_allclose(found.position, 1e-6 * rows[:, 1])
    np.testing.assert_allclose(found.force, 9.80665e-3 * rows[:, 2])


@pytest.mark.parametrize(
    ("role", "unit", "expected"),
    [
        *(("force", unit, newtons) for unit, newtons in (
            ("g", 9.80665e-3), ("kgf", 9.80665), ("lbf", 4.4482216), ("N m", 1.0), ("nN", 1e-9),
        )),
        *(("position", unit, metres) for unit, metres in (
            ("in", 0.0254), ("\u00b5m", 1e-6), ("um", 1e-6), ("nm", 1e-9),
        )),
        ("position", "rev", 6.2831853), ("time", "h", 3600.0), ("time", "min", 60.0),
    ],
)  # fmt: skip
def test_a_unit_counts_as_its_definition_says(role: str, unit: str, expected: float) -> None:
    assert factor_of(role, unit) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("day", ["2024-05-03 ", "3.5.2024 ", ""])
def test_stamps_of_date_and_time_become_seconds(tmp_path: Path, rows: np.ndarray, day: str) -> None:
    clock = [f"{day}12:{int(t // 60):02d}:{t % 60:06.3f}" for t in rows[:, 0]]
    body = [f"{when};{rest}" for when, rest in zip(clock, lines(rows[:, 1:], ";"), strict=True)]
    path = written(tmp_path / "a.csv", ["Date/Time;Weg [mm];Kraft [N]", *body])
    found = load(path)
    assert found.dt == pytest.approx(1.0 / RATE_HZ)
    np.testing.assert_allclose(found.force, rows[:, 2])


def test_a_unit_may_follow_the_word_in(tmp_path: Path, rows: np.ndarray) -> None:
    body = [row.replace(".", ",") for row in lines(rows, ";")]
    path = written(tmp_path / "a.csv", ["Zeit in s;Weg in mm;Kraft in N", *body])
    found = load(path)
    np.testing.assert_allclose(found.position, 1e-3 * rows[:, 1])
    np.testing.assert_allclose(found.force, rows[:, 2])


def test_quoted_decimals_that_could_be_read_in_two_ways_are_refused(
    tmp_path: Path, rows: np.ndarray
) -> None:
    body = [",".join(f'"{v:.3f}"' for v in row) for row in rows]
    body[-1] = '"29.980","2.5","1,234"'
    path = written(tmp_path / "a.csv", ["t_s,x_mm,F_N", *body])
    with pytest.raises(RecordingError, match=r"both , and \. for decimals"):
        load(path)


def test_two_columns_of_one_name_are_reported_by_number(tmp_path: Path, rows: np.ndarray) -> None:
    body = [f"{line},0" for line in lines(rows, ",")]
    path = written(tmp_path / "a.csv", ["t_s,x_mm,F_N,F_N", *body])
    with pytest.raises(RecordingError, match=r"F_N \(column 3\), F_N \(column 4\)"):
        load(path)


@pytest.mark.parametrize(
    ("names", "flags"),
    [
        ("millis,servo_mm,hx711_g", "--columns time=NAME position=servo_mm force=hx711_g"),
        ("t_s,pos_mm,current_A", "force=current_A --units force=NEWTON_PER_UNIT"),
        ("t_s,/tool/position.z,/wrench.force.z", "position=/tool/position.z force=/wrench.force.z"),
    ],
)  # fmt: skip
def test_the_refusal_names_the_columns_that_may_be_meant(
    tmp_path: Path, rows: np.ndarray, names: str, flags: str
) -> None:
    with pytest.raises(RecordingError) as raised:
        load(written(tmp_path / "a.csv", [names, *lines(rows, ",")]))
    assert flags in str(raised.value)


def test_slow_samples_are_taken_where_the_unit_of_time_is_stated(
    tmp_path: Path, rows: np.ndarray
) -> None:
    slow = rows * (25.0, 1.0, 1.0)
    for name, refused in (("time", True), ("time [s]", False)):
        path = written(tmp_path / "a.csv", [f"{name},x_mm,F_N", *lines(slow, ",")])
        if refused:
            with pytest.raises(RecordingError, match=r"wrong unit\?"):
                load(path)
        else:
            assert load(path).dt == pytest.approx(0.5)


def test_an_offset_of_a_force_that_never_presses_is_no_turned_sign(rows: np.ndarray) -> None:
    t, x, force = rows.T
    recording = from_arrays("tared", t, 1e-3 * x, force - 40.0)
    assert ["force_bias"] in diagnose(recording).answer["class"]


def test_a_slow_rounded_force_is_prepared(rows: np.ndarray) -> None:
    """At 20 Hz no window of 20 ms is there; the cubic needs five samples."""
    t, x, force = rows.T
    read = from_arrays("slow", t * 2.5, 1e-3 * x, 0.05 * np.round(force / 0.05))
    assert problem_of(read, base_of("spring,viscous,bias"), 0.0).force.size == SAMPLES
    assert np.std(without_steps(read.force, 2, read.force_step) - read.force) < 0.05


def test_a_stiffness_of_a_testing_machine_is_taken_where_its_units_are_stated(
    tmp_path: Path, rows: np.ndarray
) -> None:
    body = lines(rows * (1.0, 1.0, 1e3), ",")
    path = written(tmp_path / "a.csv", ["t_s,x_mm,F_N", *body])
    assert diagnose(load(path)).answer["verdict"] == "no_missing_effect"
    with pytest.raises(RecordingError, match=r"wrong unit\? a spring of 2e\+06"):
        diagnose(from_arrays("bare", rows[:, 0], 1e-3 * rows[:, 1], 1e3 * rows[:, 2]))


@pytest.mark.parametrize("delimiter", [",", ";"])
def test_units_behind_each_number_are_refused_at_the_first_cell(
    tmp_path: Path, rows: np.ndarray, delimiter: str
) -> None:
    table = [delimiter.join((f"{t} s", f"{x} mm", f"{f:.2e} N")) for t, x, f in rows[:300]]
    path = written(tmp_path / "a.csv", [delimiter.join(("time", "pos", "force")), *table])
    with pytest.raises(
        RecordingError, match=r"' ?[\d.]+ s' is a number with a unit: leave"
    ) as raised:
        load(path)
    assert str(raised.value).endswith("as force [N]")


def test_stamps_of_a_form_that_is_unknown_are_counted_with_the_form_that_is_read(
    tmp_path: Path, rows: np.ndarray
) -> None:
    path = written(
        tmp_path / "a.csv",
        ["time,x_mm,F_N", *(f"05/03/2024 10:11:{t:06.3f} AM,{x},{f}" for t, x, f in rows)],
    )
    with pytest.raises(RecordingError, match="of 1500 samples 1500 of time are not a number") as no:
        load(path)
    assert str(no.value).endswith("export times in seconds, or as 2026-01-31 14:05:09.250")


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_the_unit_that_times_may_have_is_given(
    tmp_path: Path, rows: np.ndarray, unit: str, factor: float
) -> None:
    table = [f"{factor * t:.0f},{x},{f}" for t, x, f in rows]
    path = written(tmp_path / "a.csv", ["time,x_mm,F_N", *table])
    with pytest.raises(RecordingError, match=f"say so with --units time={unit}$"):
        load(path)
    assert load(path, layout_of(path, units={"time": unit})).dt == pytest.approx(1.0 / RATE_HZ)


def test_times_that_repeat_are_counted_and_those_that_go_back_are_not(
    tmp_path: Path, rows: np.ndarray
) -> None:
    for name, times, next_step in (
        ("coarse", np.floor(rows[:, 0] * 25.0) / 25.0, "750 of 1500 times are the same as those b"),
        (
            "back",
            np.where(np.arange(SAMPLES) < 700, rows[:, 0], rows[:, 0] - 9.0),
            "two recordings",
        ),
    ):
        table = np.column_stack((times, rows[:, 1:]))
        path = written(tmp_path / f"{name}.csv", ["t_s,x_mm,F_N", *lines(table, ",")])
        with pytest.raises(RecordingError, match=f"does not increase at sample .* s; {next_step}"):
            load(path)


def test_stamps_of_minutes_and_seconds_are_no_hours_and_minutes(
    tmp_path: Path, rows: np.ndarray
) -> None:
    """As a spreadsheet writes a time below an hour: 00:12.340."""
    stamps = [f"{int(t) // 60:02d}:{t % 60.0:06.3f}" for t in rows[:, 0] + 45.0]
    table = [f"{stamp},{x},{f}" for stamp, (_, x, f) in zip(stamps, rows, strict=True)]
    found = load(written(tmp_path / "a.csv", ["Time,x_mm,F_N", *table]))
    assert found.dt == pytest.approx(1.0 / RATE_HZ)
    np.testing.assert_allclose(found.position, 1e-3 * rows[:, 1])


def test_a_rule_below_the_names_is_no_name(tmp_path: Path, rows: np.ndarray) -> None:
    head = ["t_s      x_mm     F_N", "-------  -------  -------"]
    found = load(written(tmp_path / "a.txt", head + lines(rows, "  ")))
    np.testing.assert_allclose(found.force, rows[:, 2])


def test_the_last_line_is_shown_where_no_numbers_are_found(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", ["t,x,F", *(f'="{t}",="{t}",="0"' for t in range(99))])
    with pytest.raises(RecordingError, match=r"""other found \(line 100: '="98",="98",="0"'\)"""):
        load(path)
