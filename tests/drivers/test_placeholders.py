"""A rig's file lists the values that are still an example's, until they are its devices' own."""

from __future__ import annotations

import json

import pytest

from teleop_rt.config.loader import load_rig
from teleop_rt_drivers import registry
from teleop_rt_drivers.calibration.rig_file import rewrite
from teleop_rt_drivers.new_rig import with_found, write_rig
from teleop_rt_drivers.placeholders import with_placeholders
from teleop_rt_drivers.rig_text import rig_text
from teleop_rt_drivers.scanning.found import Found

CELL = ("axis", "parts", "sensor", "force", "scale_N_per_unit")


def of(text, tmp_path, name="rig.yaml"):
    write_rig(tmp_path / name, text)
    return load_rig(tmp_path / name, registry.AXIS_SCHEMAS).placeholders


@pytest.mark.parametrize(
    ("drive", "keys"),
    [
        ("odrive", ("node_id", "scale_m_per_unit", "torque_constant_Nm_per_A", "current_max_A")),
        ("damiao", ("motor", "motor_id", "host_id", "scale_m_per_unit", "torque_max_Nm")),
        ("moteus", ("servo_id", "scale_m_per_unit", "torque_max_Nm")),
    ],
)
def test_ids_scales_sensors_and_limits_of_an_example_are_listed(drive, keys, tmp_path):
    found = of(with_placeholders(rig_text(drive, "socketcan", "load-cell", None)), tmp_path)
    assert {f"axis.parts.drive.{key}" for key in keys} <= set(found)
    assert {"sensors.force_noise_N", "limits.force_max_N", ".".join(CELL)} <= set(found)
    assert not any(key.endswith(("bitrate", "channel", "interface", "baud")) for key in found)


PORT = "axis.parts.sensor.ports.cell.device"


def test_the_port_of_a_sensor_is_a_placeholder_until_it_is_given(tmp_path, call):
    options = ("--drive", "odrive", "--adapter", "socketcan", "--sensor", "load-cell")
    assert call("new-rig", tmp_path / "left.yaml", *options)[0] == 0
    assert PORT in load_rig(tmp_path / "left.yaml", registry.AXIS_SCHEMAS).placeholders
    given = ("--sensor-port", "/dev/ttyACM1")
    assert call("new-rig", tmp_path / "given.yaml", *options, *given)[0] == 0
    rig = load_rig(tmp_path / "given.yaml", registry.AXIS_SCHEMAS)
    assert PORT not in rig.placeholders
    assert registry.parts_of(rig.axis)["sensor"].ports["cell"].device == "ttyACM1"


def test_a_sensor_without_a_port_of_its_own_takes_none(tmp_path, call):
    options = ("--drive", "odrive", "--adapter", "socketcan", "--sensor", "drive")
    code, _, err = call("new-rig", tmp_path / "rig.yaml", *options, "--sensor-port", "ttyUSB1")
    assert code == 2
    assert "only --sensor wrench or load-cell on hardware has a port" in err


def test_new_rig_lists_them_and_check_warns_of_each(tmp_path, call):
    file = tmp_path / "rig.yaml"
    options = ("--drive", "vesc", "--adapter", "slcan", "--sensor", "wrench")
    assert call("new-rig", file, *options)[0] == 0
    code, out, _ = call("check", file, "--json")
    assert code == 0
    (warned,) = [one for one in json.loads(out)["findings"] if one["where"] == "placeholders"]
    assert warned["severity"] == "warning"
    assert "axis.parts.drive.scale_m_per_unit" in warned["what"]
    assert "limits.position_max_m" in warned["what"]


def test_the_simulated_rig_has_its_devices_own_values(tmp_path, call):
    file = tmp_path / "rig.yaml"
    options = ("--drive", "vesc", "--adapter", "unix", "--sensor", "wrench")
    assert call("new-rig", file, *options)[0] == 0
    assert load_rig(file, registry.AXIS_SCHEMAS).placeholders == ()


def test_what_a_device_said_itself_is_no_placeholder(tmp_path):
    text = with_placeholders(rig_text("odrive", "socketcan", "wrench", None))
    before = of(text, tmp_path, "before.yaml")
    said = Found(3, {("node_id",): 3}, "an ODrive")
    after = of(with_found(text, "odrive", [said], None), tmp_path)
    assert set(before) - set(after) == {"axis.parts.drive.node_id"}


def test_a_calibration_takes_what_it_writes_off_the_list_which_ends_with_its_last_key(tmp_path):
    file = tmp_path / "rig.yaml"
    left = of(with_placeholders(rig_text("odrive", "socketcan", "load-cell", None)), tmp_path)
    rewrite(file, {CELL: 3.0e-4})
    rig = load_rig(file, registry.AXIS_SCHEMAS)
    assert set(left) - set(rig.placeholders) == {".".join(CELL)}
    assert registry.parts_of(rig.axis)["sensor"].force.scale == 3.0e-4
    text = file.read_text()
    for key in rig.placeholders[1:]:
        text = text.replace(f"  - {key}\n", "")
    file.write_text(text)
    (last,) = load_rig(file, registry.AXIS_SCHEMAS).placeholders
    rewrite(file, {tuple(last.split(".")): 0.5})
    assert load_rig(file, registry.AXIS_SCHEMAS).placeholders == ()
    assert "placeholders" not in file.read_text()
