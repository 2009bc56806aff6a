"""Calibration of an operator's device by a short swing of simulated ones that nobody holds."""

from __future__ import annotations

import numpy as np
import pytest
from rig_bench import MS, START_NS
from test_actuator_handles import handle_of

from teleop_rt.axis import AxisError
from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.config.loader import load_rig
from teleop_rt_dev.faults.handle import CANOPEN, SERIAL
from teleop_rt_drivers import registry
from teleop_rt_drivers.calibration.device import device_keys, fit_device
from teleop_rt_drivers.calibration.device_motion import SwingRecord, swing
from teleop_rt_drivers.calibration.rig_file import rewrite
from teleop_rt_drivers.calibration.weights import CalibrationError
from teleop_rt_drivers.operator_device import device_transport, simulated_device

NOBODY = "operator.hand.let_go_s=0.001"
KINDS = {
    "canopen": (CANOPEN, []),
    "serial": (SERIAL, []),
    "damiao": (SERIAL, [handle_of("damiao")]),
    "odrive": (SERIAL, [handle_of("odrive")]),
}


class Table:
    """A simulated device on a table: free, unless somebody holds it."""

    def __init__(self, kind: str, *changes: str) -> None:
        trial, own = KINDS[kind]
        self.now = START_NS
        self.operator = load_trial_file(trial, [*own, *changes]).operator
        self.rig = self.operator.rig
        self.device, self.network, self.plant = simulated_device(self.operator, lambda: self.now, 1)
        self.device.configure()

    def wait(self) -> None:
        self.now += MS

    def swing(self, force=4.0, reach=0.005, seconds=3.0) -> SwingRecord:
        return swing(self.device, self.wait, lambda: self.now, force, reach, seconds)


@pytest.mark.parametrize("kind", list(KINDS))
def test_mass_damping_friction_and_latency_of_a_free_device_are_found(kind):
    table = Table(kind, NOBODY)
    fit = fit_device(table.swing())
    body, transport = table.operator.body, device_transport(table.rig)
    assert fit.mass == pytest.approx(body.mass, rel=0.01)
    assert fit.damping == pytest.approx(body.damping, rel=0.01)
    assert fit.coulomb_friction == pytest.approx(body.coulomb_friction, abs=0.01)
    worst_s = transport.sample_age_s + transport.force_delay_s + body.latency_s
    # A period of a grid that is nobody's, and half a period in which a force is held.
    assert worst_s - 1e-3 < fit.latency_s < worst_s + 0.1e-3
    assert not table.network.drive.powered


def test_what_is_found_replaces_what_the_rig_s_file_said(tmp_path):
    table = Table("damiao", NOBODY)
    file = tmp_path / "rig.yaml"
    text = (CANOPEN.parents[1] / "rigs" / "simulated_damiao_handle.yaml").read_text()
    wrong = text.replace("damping_N_s_per_m: 12.0", "damping_N_s_per_m: 30.0")
    assert wrong != text
    file.write_text(wrong)
    keys = device_keys(table.rig, device_transport(table.rig), fit_device(table.swing()))
    kept = rewrite(file, keys)
    assert kept.read_text() == wrong
    body = load_rig(file, registry.AXIS_SCHEMAS).device
    assert 0.97 * 12.0 < body.damping < 12.0, "never more than there is: the bound counts on it"
    assert body.mass == pytest.approx(0.2, rel=0.01)
    assert body.coulomb_friction == pytest.approx(0.2, abs=0.01)
    assert body.force_latency_ms < 0.2


def test_a_latency_of_the_device_s_own_is_found_and_written():
    plain, late = (Table("canopen", NOBODY), Table("canopen", NOBODY))
    late.plant.command_delay_ns += 3 * MS
    first, second = (fit_device(table.swing()).latency_s for table in (plain, late))
    assert second - first == pytest.approx(3e-3, abs=0.05e-3)
    fit = fit_device(Table("canopen", NOBODY).swing())
    keys = device_keys(late.rig, device_transport(late.rig), fit)
    assert keys["device", "force_latency_ms"] < 0.2


def test_a_hand_on_the_device_is_noticed():
    with pytest.raises(CalibrationError, match=r"let go|turned \d times|is below 0|from where"):
        fit_device(Table("canopen").swing())


@pytest.mark.parametrize(
    ("kind", "force", "reach", "words"),
    [
        ("canopen", 0.1, 0.005, "turned 0 times in 3 s: raise --force"),
        ("canopen", 60.0, 0.0005, "went .* from where it began: lower --force"),
        ("damiao", 0.9, 0.0003, "the drive reports a force of .*: raise --force"),
    ],
)
def test_a_motion_that_says_nothing_is_refused_and_the_device_is_left_without_power(
    kind, force, reach, words
):
    table = Table(kind, NOBODY)
    with pytest.raises(CalibrationError, match=words):
        fit_device(table.swing(force, reach))
    assert not table.network.drive.powered
    assert table.plant.servo_force == pytest.approx(0.0, abs=0.3)


def test_a_fault_on_the_way_ends_it_without_power():
    table = Table("odrive", NOBODY)
    step = table.wait

    def wait() -> None:
        step()
        if table.now == START_NS + 500 * MS:
            table.network.inject("over_temperature", "drive")

    with pytest.raises(CalibrationError, match="over-temperature"):
        swing(table.device, wait, lambda: table.now, 4.0, 0.005, 3.0)
    assert not table.network.drive.powered
    with pytest.raises(AxisError, match="DRIVE_FAULT"):
        table.device.arm()


def made(mass=0.2, damping=8.0, spring=0.0, latency=2) -> SwingRecord:
    """A motion of an equation that is solved in small steps, n = 3000 cycles of 1 ms."""
    fine, x, v, direction = 50, 0.0, 0.0, 1.0
    rows, pushes = [], [0.0] * latency
    for k in range(3000):
        if x * direction > 0.005:
            direction = -direction
        force = direction * (4.0 if k < 1500 else 2.0)
        rows.append((1e-3 * k, x, force, np.nan))
        pushes.append(force)
        for _ in range(fine):
            v += 1e-3 / fine * (pushes[k] - damping * v - spring * x) / mass
            x += 1e-3 / fine * v
    return SwingRecord(*np.array(rows).T)


def test_an_equation_is_recovered_and_a_spring_is_refused():
    fit = fit_device(made())
    assert fit.mass == pytest.approx(0.2, rel=0.005)
    assert fit.damping == pytest.approx(8.0, rel=0.005)
    assert fit.latency_s == pytest.approx(2e-3, abs=0.05e-3)
    assert fit.coulomb_friction == pytest.approx(0.0, abs=0.01)
    with pytest.raises(CalibrationError, match=r"let go|something drives it"):
        fit_device(made(spring=300.0))


def test_a_device_faster_than_its_bus_is_refused():
    table = Table("odrive", NOBODY)
    with pytest.raises(CalibrationError, match="less than the"):
        device_keys(table.rig, device_transport(table.rig), fit_device(made(latency=1)))


@pytest.mark.parametrize(
    ("rig", "changes", "words"),
    [
        ("simulated_odrive_handle", ["--force", "500"], "--force 500: above 0, at most force_max"),
        ("simulated_odrive_handle", ["--force", "0"], "--force 0: above 0"),
        ("simulated_odrive_handle", ["--reach", "0.1"], "at most an eighth of the travel"),
        ("simulated_odrive", [], "'mixed' is not driven by force"),
    ],
)
def test_a_motion_that_cannot_be_is_refused_before_anything_is_opened(rig, changes, words, call):
    file = CANOPEN.parents[1] / "rigs" / f"{rig}.yaml"
    asked = {"--force": "2", "--reach": "0.005"} | dict(
        zip(changes[::2], changes[1::2], strict=True)
    )
    code, _, err = call(
        "calibrate", "device", file, *(word for pair in asked.items() for word in pair)
    )
    assert code == 2
    assert words in " ".join(err.split())


def test_a_device_is_calibrated_without_hardware_on_what_a_trial_simulates(tmp_path, call):
    file = tmp_path / "rig.yaml"
    text = (CANOPEN.parents[1] / "rigs" / "simulated_odrive_handle.yaml").read_text()
    assert "damping_N_s_per_m: 12.0" in text
    file.write_text(text)
    code, _, err = call(
        "calibrate", "device", file, "--force", "4", "--reach", "0.005",
        "--simulated", "serial_handle", "--write",
    )  # fmt: skip
    assert code == 0, err
    body = load_rig(file, registry.AXIS_SCHEMAS).device
    assert body.mass == pytest.approx(0.2, rel=0.01)
    assert 0.97 * 12.0 < body.damping < 12.0
