"""Scale, offset and lag of a force sensor, found at simulated rigs and written into their files."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from framed_bench import MS, RIGS, FramedBench
from rig_bench import plant_config
from test_trial_on_every_rig import TRIAL, open_bench

from teleop_rt.config.loader import load_rig, load_trial
from teleop_rt.config.section import Units
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt_drivers import registry
from teleop_rt_drivers.calibration import work
from teleop_rt_drivers.calibration.device import DeviceFit
from teleop_rt_drivers.calibration.force import (
    ScaleInFile,
    any_force,
    force_keys,
    read_force,
    scale_in_file,
)
from teleop_rt_drivers.calibration.lag import LagFit
from teleop_rt_drivers.calibration.rig_file import rewrite, with_values
from teleop_rt_drivers.calibration.shown import WORDS, lines
from teleop_rt_drivers.calibration.torque_lag import TorqueLag
from teleop_rt_drivers.calibration.weights import CalibrationError, ForceFit, Weighing, fit_weights
from teleop_rt_drivers.calibration.work import calibrate_force, masses_of

CELL = RIGS / "simulated_load_cell.yaml"
G = 9.80665


def reading_of(rig, force, *, noise=0.02, seconds=2.0):
    """The simulated load cell's reading under a constant force."""
    sensors = {"force_offset": force, "force_noise": noise}
    bench = FramedBench(rig, plant=plant_config(sensors=sensors))
    bench.axis.configure()

    def wait():
        bench.now += 2 * MS

    return read_force(bench.axis, wait, lambda: bench.now, force, seconds)


def test_weights_find_scale_and_offset_of_a_cell_that_was_set_up_wrong(tmp_path):
    file = tmp_path / "rig.yaml"
    text = CELL.read_text()
    wrong = "scale_N_per_unit: 3.0e-4\n        offset_N: -7.5"
    file.write_text(text.replace("scale_N_per_unit: 2.0e-4", wrong))
    rig = load_rig(file, registry.AXIS_SCHEMAS)
    fit = fit_weights([reading_of(rig, G * mass) for mass in (0.0, 1.0, 3.0)])
    assert fit.linearity < 1e-3
    assert fit.noise == pytest.approx(0.02, rel=0.3)
    kept = rewrite(file, force_keys(rig, fit))
    assert kept.read_text() == text.replace("scale_N_per_unit: 2.0e-4", wrong)
    right = load_rig(file, registry.AXIS_SCHEMAS)
    force = right.axis.parts["sensor"].force
    assert force.scale == pytest.approx(2.0e-4, rel=2e-3)
    assert force.offset == pytest.approx(0.0, abs=0.02)
    assert right.sensors.force_noise == pytest.approx(fit.noise, rel=1e-4)
    assert "# as `teleop-rt calibrate force` found it with weights" in file.read_text()
    again = fit_weights([reading_of(right, G * mass) for mass in (0.0, 2.0)])
    assert again.factor == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("scale", ["1", "1.0"])
def test_weights_scale_the_numbers_of_a_converter_that_nothing_has_scaled_yet(tmp_path, scale):
    file = tmp_path / "rig.yaml"
    text = CELL.read_text().replace("scale_N_per_unit: 2.0e-4", f"scale_N_per_unit: {scale}")
    file.write_text(text)
    rig = load_rig(file, registry.AXIS_SCHEMAS)
    found = ScaleInFile(("axis", "parts", "sensor", "force"), "unit", 1.0, 0.0, framed=False)
    assert scale_in_file(rig) == found, "the largest torque of a CANopen drive is written"
    assert not found.raw
    assert replace(found, framed=True).raw
    readings = [steady(0.0, 8e6, 80.0), steady(5.0, 8e6 + 25e3, 80.0)]
    fit = fit_weights(readings, raw=True)
    assert fit.factor == pytest.approx(2e-4, rel=1e-2)
    assert any_force(rig).limits.force_max > 1e18


def test_a_rig_without_a_scale_in_its_file_is_refused_before_a_weight_is_asked_for(tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text((RIGS / "measured_spring.yaml").read_text())
    lever = 1.0 if "force: Nm" in file.read_text() else None
    with pytest.raises(CalibrationError, match="no force sensor whose scale is in its file"):
        calibrate_force(
            file, "0,1", 1.0, lever, pytest.fail, pull=False, write=False, as_json=False
        )


def steady(force, reads, noise=0.01, rise=0.0, n=200):
    rng = np.random.default_rng(3)
    ramp = np.linspace(-0.5, 0.5, n) * rise
    return Weighing(force, reads + ramp + noise * rng.standard_normal(n), 2.0)


@pytest.mark.parametrize(
    ("readings", "words"),
    [
        ([steady(5.0, 5.0), steady(5.0, 5.1)], "two different ones"),
        ([steady(0.0, 0.0), steady(5.0, 5.0, n=10)], "read for longer"),
        ([steady(0.0, 3.0, 0.0), steady(5.0, 3.0, 0.0)], "does not change with the weight"),
        ([steady(0.0, 3.0, 0.05), steady(5.0, 2.998, 0.05)], "does not change with the weight"),
        ([steady(0.0, 0.0), steady(5.0, -5.0)], "falls as the weight grows"),
        ([steady(0.0, 0.0, 0.0), steady(5.0, 5e-4, 0.0)], "the scale would change by"),
        ([steady(0.0, 0.0), steady(5.0, 7.0), steady(10.0, 10.0)], "misses the line"),
        ([steady(0.0, 0.0, 0.8), steady(5.0, 5.0, 0.8)], "the noise is"),
        ([steady(0.0, 0.0), steady(5.0, 5.0, rise=0.5)], "a reading drifts"),
    ],
)
def test_nonsense_is_refused_with_what_to_do(readings, words):
    with pytest.raises(CalibrationError, match=words):
        fit_weights(readings)


@pytest.mark.parametrize("weights", ["", "1", "1,1", "a,b", "-1,2", "0;5", "0,nan", "0,inf"])
def test_weights_that_are_none_are_refused(weights):
    with pytest.raises(CalibrationError, match="--weights"):
        masses_of(weights)


def test_a_silent_sensor_ends_the_reading_with_its_name():
    rig = load_rig(CELL, registry.AXIS_SCHEMAS)
    bench = FramedBench(rig)
    bench.axis.configure()
    bench.simulated.inject("mute", "force sensor")

    def wait():
        bench.now += 2 * MS

    with pytest.raises(CalibrationError, match="force from cell: silent"):
        read_force(bench.axis, wait, lambda: bench.now, 0.0, 5.0)


def test_a_file_that_would_not_be_valid_is_left_as_it_is(tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text(CELL.read_text())
    with pytest.raises(ConfigError, match="force_noise_N"):
        rewrite(file, {("sensors", "force_noise_N"): -1.0})
    with pytest.raises(CalibrationError, match=r"no section axis\.force"):
        rewrite(file, {("axis", "force", "scale_N_per_unit"): 1.0})
    assert file.read_text() == CELL.read_text()
    assert list(tmp_path.iterdir()) == [file]


def test_values_are_changed_in_place_in_sections_of_either_style():
    text = "a:  # one\n  b: 1   # two\n  c: {d: 2, e: 3}\n"
    changed = with_values(text, {("a", "b"): 5.0, ("a", "c", "e"): 7.5, ("a", "c", "f"): 1e-4})
    assert changed == "a:  # one\n  b: 5   # two\n  c: {d: 2, e: 7.5, f: 0.0001}\n"
    assert with_values("a:\n  b: 1\n", {("a", "z"): 2.0}) == "a:\n  z: 2\n  b: 1\n"


def test_the_lag_of_the_load_cell_is_found_by_pressing_on_a_spring(tmp_path, call):
    file = tmp_path / "rig.yaml"
    text = CELL.read_text()
    (line,) = (one for one in text.splitlines() if "force_lag_ms" in one)
    file.write_text(text.replace(line, "  force_lag_ms: 20.0"))
    overrides = [f"rig={file}", "duration_s=9", "plant.environment.damping_N_s_per_m=0"]
    trial = load_trial(TRIAL, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, overrides)
    run = tmp_path / "run"
    run.mkdir()
    write_trial(run, trial)
    run_lockstep(trial, TRIAL, open_bench, run, lambda _: None)
    code, out, err = call(
        "calibrate", "lag", str(file), str(run / "recording.mcap"), "--write", "--json"
    )
    assert code == 0, err
    result = json.loads(out)
    # 25 ms of settling, 1 ms of the sensor, 1 ms until a line has come, 1 ms until it is looked at.
    assert result["lag_ms"] == pytest.approx(27.4, abs=0.6)
    assert 0.0 < result["deviation_ms"] < 1.0
    found = load_rig(file, registry.AXIS_SCHEMAS).sensors
    assert found.force_lag_ms == pytest.approx(result["lag_ms"], rel=1e-4)
    assert found.force_lag_deviation_ms == pytest.approx(result["deviation_ms"], rel=1e-4)


TAPS = ("operator.mean_m=0.0115", "operator.amplitude_m=0.004", "operator.frequency_hz=2.7")
"""Touches of a tenth of a second."""


def tapped(folder, damping):
    """A recorded run that taps on a stiff body with this damping, on a rig whose lag is 1 ms."""
    body = (f"plant.environment.damping_N_s_per_m={damping}",
            "plant.environment.stiffness_N_per_m=9000")  # fmt: skip
    overrides = ["duration_s=8", *TAPS, *body]
    trial = load_trial(TRIAL, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, overrides)
    folder.mkdir()
    write_trial(folder, trial)
    run_lockstep(trial, TRIAL, open_bench, folder, lambda _: None)
    return folder / "recording.mcap"


def test_the_lag_is_found_by_taps_and_a_body_that_damps_is_no_spring(tmp_path, call):
    file = tmp_path / "rig.yaml"
    before = (RIGS / "simulated_canopen.yaml").read_text()
    file.write_text(before.replace("force_lag_ms: 1.0", "force_lag_ms: 0.3"))
    code, out, err = call("calibrate", "lag", file, tapped(tmp_path / "spring", 0.0), "--json")
    assert code == 0, err
    assert json.loads(out)["lag_ms"] == pytest.approx(1.0, abs=0.1)
    rubber = tapped(tmp_path / "rubber", 20.0)
    code, _, err = call("calibrate", "lag", file, rubber, "--write")
    assert code != 0
    assert "the force would lead the position by 1.2" in err
    assert file.read_text() == before.replace("force_lag_ms: 1.0", "force_lag_ms: 0.3")
    code, out, err = call("calibrate", "lag", file, rubber, "--json", "--damping", "20")
    assert code == 0, err
    assert json.loads(out)["lag_ms"] == pytest.approx(1.0, abs=0.1)


def test_the_scale_is_found_without_hardware_by_simulated_weights(tmp_path, call):
    file = tmp_path / "rig.yaml"
    text = CELL.read_text()
    assert "scale_N_per_unit: 2.0e-4" in text
    file.write_text(text.replace("scale_N_per_unit: 2.0e-4", "scale_N_per_unit: 3.0e-4"))
    code, out, err = call(
        "calibrate", "force", file, "--weights", "0,0.5,1", "--seconds", "1.5",
        "--simulated", "silicone_cube", "--write", "--json",
    )  # fmt: skip
    assert code == 0, err
    found = json.loads(out)
    assert found["factor"] == pytest.approx(2.0 / 3.0, rel=0.005)
    assert found["noise"] == pytest.approx(0.05, abs=0.015)
    force = load_rig(file, registry.AXIS_SCHEMAS).axis.parts["sensor"].force
    assert force.scale == pytest.approx(2.0e-4, rel=0.005)
    assert found["keys"]["axis.parts.sensor.force.scale_N_per_unit"] == force.scale


def test_keys_are_printed_with_the_digits_that_are_written(tmp_path, capsys):
    file = tmp_path / "rig.yaml"
    file.write_text(CELL.read_text())
    keys = {("sensors", "force_lag_ms"): 27.123456789, ("sensors", "force_settling_ms"): 50}
    work.finish(file, keys, {}, ["lag  27.12 ms"], write=True, as_json=False)
    printed = capsys.readouterr().out
    lines = [line.strip() for line in file.read_text().splitlines()]
    for key in ("force_lag_ms", "force_settling_ms"):
        (written,) = (line.partition("#")[0].strip() for line in lines if line.startswith(key))
        assert f"sensors.{written}\n" in printed
    assert printed.startswith("lag  27.12 ms\n")


def test_results_are_printed_in_words_and_columns_with_the_units_of_the_rig():
    results = {"mass": 0.25119, "coulomb_friction": 0.2, "latency_s": 2e-3, "left_share": 0.011}
    linear, rotary = (
        list(lines(results, Units(position=x, force=f))) for x, f in (("m", "N"), ("rad", "Nm"))
    )
    assert linear == [
        "mass                                0.2512 kg",
        "dry friction                        0.2 N",
        "latency                             0.002 s",
        "share of the push left unexplained  0.011",
    ]
    assert rotary[0].endswith("0.2512 kg m^2")
    found = {"verdict": "named", "payload_inertia.mass": 2.0}
    assert list(lines(found, Units(position="m", force="N"), {"payload_inertia.mass": "kg"})) == [
        "verdict                named",
        "payload inertia: mass  2 kg",
    ]


def test_every_result_of_a_calibration_has_words():
    for fit in (ForceFit, LagFit, TorqueLag, DeviceFit):
        assert {field.name for field in fields(fit)} <= set(WORDS), fit


def test_what_a_trial_does_not_simulate_is_named(tmp_path, call):
    handle = CELL.with_name("simulated_odrive_handle.yaml")
    code, _, err = call(
        "calibrate", "device", handle, "--force", "4", "--reach", "0.005",
        "--simulated", "silicone_cube",
    )  # fmt: skip
    assert code == 2
    assert "simulates no operator's device: name one that does" in " ".join(err.split())
