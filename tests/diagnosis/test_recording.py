from __future__ import annotations

import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import prev_fast_len
from scipy.io import savemat

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.samples.surface import surface_of
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.excerpt import MOST_SAMPLES, most_active
from teleop_rt.recordings.layout import layout_of
from teleop_rt.recordings.recording import from_arrays, load, without_lag
from teleop_rt.recordings.rows import quantisation_step
from teleop_rt.trial.folder import recording_of

N = 4000


@pytest.fixture
def pressed() -> dict[str, np.ndarray]:
    """A Kelvin-Voigt contact from free air: k = 2000 N/m, b = 8 N s/m."""
    rng = np.random.default_rng(3)
    t = np.arange(N) * 1e-3
    x = 0.004 - 0.008 * np.cos(2 * np.pi * 0.9 * t)
    v = np.gradient(x, t)
    force = np.where(x > 0, 2000 * x + 8 * v, 0.0) + 0.02 * rng.standard_normal(N)
    return {"t_s": t, "position_m": x, "force_N": force}


def write_csv(path: Path, table: dict[str, np.ndarray]) -> Path:
    rows = np.column_stack(list(table.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(table), comments="", fmt="%.9g")
    return path


def test_csv_mat_and_npz_of_one_recording_load_alike(
    tmp_path: Path, pressed: dict[str, np.ndarray]
) -> None:
    np.savez(tmp_path / "a.npz", **pressed)
    savemat(tmp_path / "a.mat", pressed)
    files = [write_csv(tmp_path / "a.csv", pressed), tmp_path / "a.npz", tmp_path / "a.mat"]
    for path in files:
        recording = load(path)
        assert recording.dt == pytest.approx(1e-3)
        np.testing.assert_allclose(recording.force, pressed["force_N"], rtol=1e-8)
        assert (recording.gaps, recording.missing) == (0, 0)


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_a_table_by_semicolons_or_tabs_is_read(
    tmp_path: Path, pressed: dict[str, np.ndarray], delimiter: str
) -> None:
    path = write_csv(tmp_path / "s.csv", pressed)
    path.write_text(path.read_text().replace(",", delimiter))
    np.testing.assert_allclose(load(path).force, pressed["force_N"], rtol=1e-8)


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_commas_that_mark_decimals_are_read_where_they_part_no_columns(
    tmp_path: Path, pressed: dict[str, np.ndarray], delimiter: str
) -> None:
    plain = write_csv(tmp_path / "plain.csv", pressed)
    given = plain.read_text().replace(",", delimiter).replace(".", ",")
    for name, text in {"a.csv": given, "windows.csv": given.replace("\n", "\r\n")}.items():
        path = tmp_path / name
        path.write_bytes(text.encode())
        np.testing.assert_array_equal(load(path).force, load(plain).force)
    words = given.replace("\n", f"{delimiter}fine, so far\n")
    (tmp_path / "words.csv").write_text(words)
    np.testing.assert_array_equal(load(tmp_path / "words.csv").force, load(plain).force)


def test_decimals_that_could_be_read_in_two_ways_are_refused(
    tmp_path: Path, pressed: dict[str, np.ndarray]
) -> None:
    plain = write_csv(tmp_path / "plain.csv", pressed).read_text()
    path = tmp_path / "mixed.csv"
    path.write_text(plain.replace(",", ";") + "4,000;0.001;2.5\n")
    with pytest.raises(RecordingError, match=r"both , and \. for decimals: save it with one"):
        load(path)
    path.write_text(plain.replace(".", ","))
    with pytest.raises(RecordingError, match="if commas mark the decimals, separate"):
        load(path)


def test_a_column_in_a_foreign_unit_is_refused_for_its_unit(
    tmp_path: Path, pressed: dict[str, np.ndarray]
) -> None:
    rows = dict(zip(("t_s", "position_ft", "force [dyn]"), pressed.values(), strict=True))
    path = write_csv(tmp_path / "i.csv", rows)
    with pytest.raises(RecordingError) as raised:
        load(path)
    assert "unknown unit of position_ft (unit 'ft'), force [dyn] (unit 'dyn')" in str(raised.value)
    assert "--columns position=position_ft" in str(raised.value)


@pytest.mark.parametrize("kept", ["0.5", "0.5,", "0.5,0.0"])
def test_a_last_line_that_a_logger_could_not_complete_is_left_out_and_named(
    tmp_path: Path, pressed: dict[str, np.ndarray], kept: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_csv(tmp_path / "cut.csv", pressed)
    whole = load(path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, kept]))
    assert np.array_equal(load(path).force, whole.force)
    expected = f"line {len(lines) + 1}, the last one, is cut off, and left out"
    assert expected in capsys.readouterr().err
    path.write_text("\n".join([*lines[:-1], kept, lines[-1]]))
    with pytest.raises(RecordingError, match="complete it"):
        load(path)


def test_lines_of_another_length_are_reported_in_few_words(
    tmp_path: Path, pressed: dict[str, np.ndarray]
) -> None:
    path = write_csv(tmp_path / "ragged.csv", pressed)
    header, first, *rest = path.read_text().splitlines()
    path.write_text("\n".join([header, first, *(f"{line},7" for line in rest)]))
    with pytest.raises(RecordingError, match="line 3 has 4 fields, not 3") as raised:
        load(path)
    assert len(str(raised.value)) < 500
    assert "UTF-8" not in str(raised.value)
    path.write_text("\n".join([header, *(line.replace(".", ",") for line in (first, *rest))]))
    with pytest.raises(RecordingError, match=r"separate the columns by semicolons$"):
        load(path)


def test_foreign_columns_units_and_signs_are_read_from_the_yaml_beside(
    tmp_path: Path, pressed: dict[str, np.ndarray]
) -> None:
    matrix = np.column_stack([1e3 * pressed["position_m"], -pressed["force_N"]])
    savemat(tmp_path / "b.mat", {"x_F": matrix})
    (tmp_path / "b.columns.yaml").write_text(
        "columns: {position: 'x_F[0]', force: '-x_F[1]'}\nunits: {position: mm}\nrate_hz: 1000\n"
    )
    recording = load(tmp_path / "b.mat")
    np.testing.assert_allclose(recording.position, pressed["position_m"], rtol=1e-9)
    np.testing.assert_allclose(recording.force, pressed["force_N"], rtol=1e-9)


def test_a_gap_is_used_around_and_counted(pressed: dict[str, np.ndarray]) -> None:
    keep = np.ones(N, dtype=bool)
    keep[1200:1300] = False
    keep[2500] = False
    force = pressed["force_N"].copy()
    force[3000:3005] = np.nan
    recording = from_arrays("g", pressed["t_s"][keep], pressed["position_m"][keep], force[keep])
    assert recording.gaps == 3
    assert recording.missing == 106
    found = diagnose(recording, "kelvin-voigt", surface=0.0)
    k = found.answer["base"]["parameters"]["k"]
    assert abs(k["value"] - 2000) < 4 * k["std"]
    assert found.answer["gaps"] == {"count": 3, "samples": 106}


def test_positions_across_a_gap_lie_on_the_steps_of_the_readings() -> None:
    t = 1e-3 * np.arange(3000)
    position = 5e-6 * np.round(2e3 * (1.0 + np.sin(5.0 * t)))
    kept = np.r_[:1003, 1200:1503, 1504:3000]
    recording = from_arrays("gap", t[kept], position[kept], np.cos(3.0 * t[kept]))
    assert (recording.gaps, recording.missing) == (2, 198)
    np.testing.assert_array_equal(recording.position[recording.mask > 0.0], position[kept])
    assert quantisation_step(recording.position) == pytest.approx(5e-6)


def test_no_force_is_made_up_where_it_would_have_come_in_a_gap() -> None:
    t = 1e-3 * np.arange(100)
    force = t**2
    kept = np.r_[:40, 60:80, 81:100]
    found = without_lag(t[kept], force[kept], 2e-3)
    lost = np.isnan(found)
    assert np.flatnonzero(lost).tolist() == [38, 39]
    late = ~lost & (t[kept] < 0.097)
    np.testing.assert_allclose(found[late], (t[kept][late] + 2e-3) ** 2, atol=2e-6)


def test_small_jitter_of_the_stamps_is_no_gap(pressed: dict[str, np.ndarray]) -> None:
    rng = np.random.default_rng(0)
    t = pressed["t_s"] + rng.uniform(-1e-4, 1e-4, N)
    recording = from_arrays("j", t, pressed["position_m"], pressed["force_N"])
    assert recording.missing == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: {k: v[:100] for k, v in d.items()}, "too short"),
        (lambda d: d | {"force_N": np.full(N, 1.5)}, r"force is constant \(1.5 N\)"),
        (lambda d: d | {"position_m": np.full(N, 0.01)}, "no excitation"),
        (lambda d: d | {"t_s": np.where(np.arange(N) == 50, 0.0, d["t_s"])}, "does not increase"),
        (lambda d: d | {"force_N": np.full(N, np.nan)}, "not a number"),
        (lambda d: {k: v for k, v in d.items() if k != "force_N"}, "no column for force"),
        (
            lambda d: {k: v for k, v in d.items() if k != "t_s"},
            "no column for time; there are: position_m,",
        ),
        (lambda d: d | {"t_s": 1e3 * d["t_s"]}, "wrong unit.*time=ms"),
        (lambda d: d | {"t_s": 1e-3 * d["t_s"]}, "wrong unit.*lasts.*time=s"),
    ],
)
def test_a_recording_that_cannot_be_used_is_refused_with_the_reason(
    tmp_path: Path, pressed: dict[str, np.ndarray], change: object, message: str
) -> None:
    path = write_csv(tmp_path / "bad.csv", change(pressed))
    with pytest.raises(RecordingError, match=message):
        load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d | {"position_m": d["position_m"] - 0.1}, "no contact"),
        (lambda d: d | {"force_N": -d["force_N"]}, "wrong sign.*force=-NAME"),
        (
            lambda d: d | {"position_m": -d["position_m"], "force_N": -d["force_N"]},
            "wrong sign.*in free air",
        ),
        (lambda d: d | {"position_m": 1e3 * d["position_m"]}, "wrong unit.*position=mm$"),
        (
            lambda d: d | {"force_N": 1500 * d["force_N"]},
            "wrong unit.*3e\\+06.*right.*--units force=N",
        ),
        (lambda d: d | {"position_m": 0.01 + 1e-6 * (np.arange(N) % 2)}, "no excitation"),
    ],
)
def test_data_without_contact_or_in_wrong_units_are_refused_with_the_reason(
    pressed: dict[str, np.ndarray], change: object, message: str
) -> None:
    data = change(pressed)
    recording = from_arrays("bad", data["t_s"], data["position_m"], data["force_N"])
    with pytest.raises(RecordingError, match=message):
        diagnose(recording, "kelvin-voigt", surface=0.0)


@pytest.mark.parametrize(
    ("pulls", "reason"),
    [
        (False, "mm; columns exchanged. .* with "),
        (True, "mm; the force varies by 0.016 N only: if "),
    ],
)
def test_columns_under_each_others_header_are_asked_for(
    tmp_path: Path, pressed: dict[str, np.ndarray], pulls: bool, reason: str
) -> None:
    force = (
        2000.0 * pressed["position_m"] if pulls else pressed["force_N"]
    )  # else free air shows it
    table = pressed | {"position_m": force, "force_N": pressed["position_m"]}
    option = "--columns position=force_N force=position_m$"
    with pytest.raises(RecordingError, match=f"{reason}.*{option}"):
        diagnose(load(write_csv(tmp_path / "exchanged.csv", table)))


@pytest.mark.parametrize("kind", ["csv", "mat", "npz"])
@pytest.mark.parametrize("kept", [0.0, 0.5])
def test_a_file_that_was_cut_off_or_is_empty_is_refused(
    tmp_path: Path, pressed: dict[str, np.ndarray], kind: str, kept: float
) -> None:
    path = tmp_path / f"cut.{kind}"
    if kind == "csv":
        path.write_text("t_s,position_m,force_N\n0,1\n0.001,1,2\n")
    elif kind == "mat":
        savemat(path, pressed, do_compression=True)
    else:
        np.savez(path, **pressed)
    path.write_bytes(path.read_bytes()[: round(kept * path.stat().st_size)])
    with pytest.raises(RecordingError, match=f"cut.{kind}: cannot be read") as raised:
        load(path)
    assert "\n" not in str(raised.value)


def test_an_unknown_role_or_unit_or_column_is_refused(
    tmp_path: Path, pressed: dict[str, np.ndarray]
) -> None:
    path = write_csv(tmp_path / "c.csv", pressed)
    with pytest.raises(RecordingError, match="unknown role"):
        layout_of(path, {"colour": "x"})
    with pytest.raises(RecordingError, match="no column 'F'"):
        load(path, layout_of(path, {"force": "F"}))
    with pytest.raises(RecordingError, match="did you mean 'position_m'"):
        load(path, layout_of(path, {"position": "position_mm"}))
    with pytest.raises(RecordingError, match="unknown unit"):
        load(path, layout_of(path, {"force": "force_N"}, {"force": "dyn"}))


@pytest.mark.parametrize(
    ("names", "factors"),
    [
        (("t", "x", "f"), (1.0, 1.0, 1.0)),
        (("Time", "Position", "Force"), (1.0, 1.0, 1.0)),
        (("time [ms]", "x_mm", "F (kN)"), (1e3, 1e3, 1e-3)),
        (("t_s", "pos_m", "force_N"), (1.0, 1.0, 1.0)),
    ],
)
def test_a_column_whose_name_has_role_and_unit_needs_no_option(
    tmp_path: Path,
    pressed: dict[str, np.ndarray],
    names: tuple[str, ...],
    factors: tuple[float, ...],
) -> None:
    plain = load(write_csv(tmp_path / "plain.csv", pressed))
    given = zip(names, pressed.values(), factors, strict=True)
    named = load(write_csv(tmp_path / "n.csv", {name: row * f for name, row, f in given}))
    assert named.position == pytest.approx(plain.position, rel=1e-6, abs=1e-9)
    assert named.force == pytest.approx(plain.force, rel=1e-6, abs=1e-9)
    assert (named.dt, named.units) == (pytest.approx(plain.dt), ("m", "N"))


def test_the_unit_in_the_name_of_a_given_column_counts_unless_another_is_given(
    tmp_path: Path, pressed: dict[str, np.ndarray]
) -> None:
    rows = dict(zip(("t_s", "xs_mrad", "tau_Nm"), pressed.values(), strict=True))
    path = write_csv(tmp_path / "c.csv", rows)
    columns = {"position": "xs_mrad", "force": "tau_Nm"}
    found = load(path, layout_of(path, columns))
    assert found.units == ("rad", "Nm")
    assert found.position == pytest.approx(1e-3 * rows["xs_mrad"])
    assert load(path, layout_of(path, columns, {"position": "rad"})).position == pytest.approx(
        rows["xs_mrad"]
    )


@pytest.mark.parametrize(
    ("position", "force", "factors", "units"),
    [
        ("x_um", "F_nN", (1e-6, 1e-9), ("m", "N")),
        ("x_nm", "F_uN", (1e-9, 1e-6), ("m", "N")),
        ("x [\u00b5m]", "F [\u03bcN]", (1e-6, 1e-6), ("m", "N")),
        ("x_cm", "F_pN", (1e-2, 1e-12), ("m", "N")),
        ("angle_deg", "torque_mNm", (np.pi / 180.0, 1e-3), ("rad", "Nm")),
        ("angle_rev", "torque_Ncm", (2.0 * np.pi, 1e-2), ("rad", "Nm")),
        ("angle_urad", "torque_Nmm", (1e-6, 1e-3), ("rad", "Nm")),
    ],
)
def test_small_and_rotary_units_are_read_from_the_names(
    tmp_path: Path, pressed: dict[str, np.ndarray], position: str, force: str,
    factors: tuple[float, float], units: tuple[str, str],
) -> None:  # fmt: skip
    rows = {"t_s": pressed["t_s"], position: pressed["position_m"], force: pressed["force_N"]}
    found = load(write_csv(tmp_path / "c.csv", rows))
    assert found.position == pytest.approx(factors[0] * rows[position], rel=1e-6, abs=1e-15)
    assert found.force == pytest.approx(factors[1] * rows[force], rel=1e-6, abs=1e-18)
    assert found.units == units


def test_a_number_or_another_quantity_is_no_column_of_a_role(
    tmp_path: Path, pressed: dict[str, np.ndarray]
) -> None:
    rows = {"position": pressed["position_m"], "F": pressed["force_N"]}
    np.savez(tmp_path / "a.npz", **rows, t=np.array(3.0), T=np.full(N, 293.0))
    found = load(tmp_path / "a.npz", layout_of(tmp_path / "a.npz", rate_hz=1000.0))
    assert (found.dt, found.position.size) == (pytest.approx(1e-3), N)


def test_two_columns_that_could_be_the_position_are_both_named(
    tmp_path: Path, pressed: dict[str, np.ndarray]
) -> None:
    path = write_csv(tmp_path / "c.csv", pressed | {"pos_mm": pressed["position_m"]})
    with pytest.raises(RecordingError, match=r"position_m, pos_mm could each be the position"):
        load(path)
    path = write_csv(tmp_path / "x.csv", pressed | {"x_mm": pressed["position_m"]})
    with pytest.raises(RecordingError, match=r"position_m, x_mm could each be the position"):
        load(path)
    rates = {"velocity_m_s": pressed["position_m"], "velocity_mm_s": pressed["position_m"]}
    assert load(write_csv(tmp_path / "v.csv", pressed | rates)).units == ("m", "N")  # not needed
    path = write_csv(tmp_path / "d.csv", pressed | {"x": 7.0 * pressed["position_m"]})
    assert np.ptp(load(path).position) == pytest.approx(np.ptp(pressed["position_m"]), rel=1e-3)


def test_the_surface_is_found_wherever_the_axis_counts_from(
    pressed: dict[str, np.ndarray],
) -> None:
    t, x, f = pressed["t_s"], pressed["position_m"], pressed["force_N"]
    for place in (0.0, 0.05):
        found = surface_of(from_arrays("a", t, x + place, f))
        assert found[:2] == (pytest.approx(place, abs=3e-4), False)
        assert abs(found.position - place) < found.within


def test_the_answer_to_a_long_recording_says_which_part_was_judged() -> None:
    """The presses of its first 8 s are slight."""
    t = 1e-3 * np.arange(10 * N)
    x = np.where(t > 8.0, 8e-3, 5e-3) * np.sin(2.0 * np.pi * 0.875 * t)
    pressing = np.where(x > 0.0, 2000.0 * x + 8.0 * np.gradient(x, t), 0.0)
    force = pressing + 0.02 * np.random.default_rng(3).standard_normal(t.size)
    recording = from_arrays("long", t, x, force)
    notes = diagnose(recording, surface=0.0).answer["notes"]
    (said,) = [note for note in notes if "were judged" in note]
    assert said.startswith("only the busiest 30.0 s of 40.0 s were judged, from 7.5 s on:")
    short = diagnose(from_arrays("short", t[:N], x[-N:], force[-N:]), surface=0.0)
    assert not [note for note in short.answer["notes"] if "were judged" in note]


def test_of_a_long_recording_the_part_with_the_most_movement_is_used() -> None:
    size = 400_000
    t = np.arange(size) * 1e-3
    busy = (t > 200.0) & (t < 250.0)
    x = 0.002 + 0.0005 * np.sin(t) + busy * 0.004 * np.sin(2 * np.pi * t)
    part, start = most_active(from_arrays("long", t, x, 2000.0 * x))
    assert part.position.size == MOST_SAMPLES
    assert 190.0 < start < 225.0
    np.testing.assert_array_equal(part.position, x[round(start * 1e3) :][:MOST_SAMPLES])
    again, start_again = most_active(part)
    assert start_again == start
    np.testing.assert_array_equal(again.position, part.position)
    assert part.position.base is None, "the whole stays in memory"


@pytest.mark.parametrize("size", [2003, 9973, 21_875])
def test_no_length_of_a_fourier_transform_has_a_large_prime_factor(size: int) -> None:
    x = np.sin(1e-2 * np.arange(size))
    part, _ = most_active(from_arrays("odd", 1e-3 * np.arange(size), x, 2000.0 * x))
    fourth, rest = divmod(part.position.size, 4)
    assert rest == 0
    assert fourth == prev_fast_len(fourth, real=True)
    assert part.position.size > 0.93 * size


@pytest.mark.parametrize("late", ["stamps", "samples"])
def test_where_the_clock_jitters_the_movement_shows_whether_the_samples_do(late: str) -> None:
    rng = np.random.default_rng(7)
    ticks = 2e-3 * np.delete(np.arange(N), slice(1500, 1540))
    stamps = ticks + 2e-3 * rng.uniform(-0.3, 0.3, ticks.size)
    taken = ticks if late == "stamps" else stamps
    position = 1e-6 * np.round(5e3 * np.sin(2 * np.pi * 2.0 * taken))
    recording = from_arrays("jitter", stamps, position, position + 1.0)
    assert recording.dt == pytest.approx(2e-3, rel=1e-5)
    assert (recording.gaps, recording.missing) == (1, 40)
    grid = stamps[0] * (late == "samples") + recording.dt * np.arange(recording.position.size)
    error = recording.position - 5e-3 * np.sin(2 * np.pi * 2.0 * grid)
    assert np.std(error[recording.mask > 0]) < 2e-6


def pressed_in_air() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    t = np.arange(10_000) * 1e-3
    x = 3e-3 * np.sin(2 * np.pi * 0.7 * t) + 1e-3 * np.sin(2 * np.pi * 2.9 * t)
    force = np.where(x > 0.0, 2000.0 * x + 8.0 * np.gradient(x, t), 0.0)
    return t, x + 0.02, force + 0.03 * np.random.default_rng(5).standard_normal(t.size)


def test_one_slip_of_the_encoder_is_a_sample_that_is_missing() -> None:
    t, x, force = pressed_in_air()
    for slip in (-0.5, 0.0, 1.0):
        x[4321] = slip
        recording = from_arrays("slip", t, x, force)
        assert (recording.gaps, recording.missing) == (1, 1)
    assert diagnose(recording).answer["verdict"] == "no_missing_effect"


@pytest.mark.parametrize("spike", [-1e4, 1e6])
def test_one_wrong_sample_of_the_force_hides_nothing(spike: float) -> None:
    t, x, force = pressed_in_air()
    force[4321] = spike
    assert diagnose(from_arrays("spike", t, x, force)).answer["verdict"] == "no_missing_effect"


@pytest.mark.parametrize("air", [True, False])
def test_a_force_that_counts_the_other_way_is_refused(air: bool) -> None:
    t, x, force = pressed_in_air()
    if not air:
        force = 2000.0 * (x - 0.01)
    with pytest.raises(RecordingError, match=r"wrong sign.*force=-NAME"):
        diagnose(from_arrays("turned", t, x, -force))


def test_a_table_that_begins_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    t, x, force = pressed_in_air()
    path = tmp_path / "table.csv"
    rows = "\n".join(f"{a:.4f},{b:.7f},{c:.5f}" for a, b, c in zip(t, x, force, strict=True))
    path.write_text("t_s,position_m,force_N\n" + rows + "\n", encoding="utf-8-sig")
    assert load(path).position.size == t.size


def test_an_archive_whose_header_is_cut_off_in_an_expression_is_refused_in_a_sentence(tmp_path):
    path = tmp_path / "run.npz"
    header = b"{'descr':__import"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("t.npy", b"\x93NUMPY\x01\x00" + bytes([len(header), 0]) + header)
    with pytest.raises(RecordingError, match=r"cannot be read as .npz: "):
        load(path)


@pytest.mark.parametrize("name", ["run.csv", "run.mcap"])
def test_a_pipe_under_the_name_of_a_recording_is_refused_and_not_waited_for(tmp_path, name):
    path = tmp_path / name
    os.mkfifo(path)
    writer = os.open(path, os.O_RDWR)  # who opens it unduly finds nothing, but does not wait
    os.write(writer, b"x")
    try:
        with pytest.raises(RecordingError, match="not a regular file"):
            recording_of(path)
    finally:
        os.close(writer)
