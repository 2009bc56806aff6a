"""A rig's file from the devices on the table: `check` accepts it, and it runs simulated."""

from __future__ import annotations

import re
from importlib import resources
from itertools import chain
from pathlib import Path

import pytest
from framed_bench import FramedBench

from teleop_rt.config.loader import load_rig
from teleop_rt.shipped import EXAMPLES
from teleop_rt_drivers import registry
from teleop_rt_drivers.new_rig import write_rig
from teleop_rt_drivers.rig_text import (
    CHANNELS,
    DRIVES,
    HANDLES,
    ON_LINES,
    SENSORS,
    WITH_FD,
    NewRigError,
    handle_text,
    rig_text,
)

PORTS = "/tmp/teleop-rt-ports"  # noqa: S108 - where simulated rigs offer theirs
DRIVE_EDS = resources.files("teleop_rt_drivers") / "eds" / "drive_cia402.eds"
POSSIBLE = [
    (drive, adapter, sensor)
    for drive in DRIVES
    for adapter in CHANNELS
    for sensor in SENSORS
    if (drive in ON_LINES) == (adapter == "serial") or adapter == "unix"
    if drive != "moteus" or adapter in WITH_FD
    if sensor != "drive-input" or drive == "canopen"
]


@pytest.mark.parametrize(("drive", "adapter", "sensor"), POSSIBLE)
def test_every_combination_is_accepted_by_check(drive, adapter, sensor, tmp_path):
    file = tmp_path / "rig.yaml"
    write_rig(file, rig_text(drive, adapter, sensor, None))
    rig = load_rig(file, registry.AXIS_SCHEMAS)
    parts = registry.parts_of(rig.axis)
    if drive in ON_LINES:
        assert parts["drive"].path == {"serial": "/dev/ttyUSB0"}.get(adapter, f"{PORTS}/servo")
    else:
        (bus,) = (part.bus for part in parts.values() if hasattr(part, "bus"))
        assert (bus.interface, str(bus.channel)) == (adapter, CHANNELS[adapter])
    assert rig.rate_hz == (500 if sensor == "load-cell" or drive in ON_LINES else 1000)
    if sensor == "drive":
        (part,) = parts.values()
        assert (part.position, part.force) == ("from drive", "from drive")
        assert part.drivetrain is not None
        assert "force_comparison" in rig.unsafe_i_know
    elif sensor == "drive-input":
        (part,) = parts.values()
        assert (part.position, part.force) == ("from drive", "from drive input")
        assert rig.unsafe_i_know == ("position_comparison",)
    else:
        assert parts["sensor"].folder == (PORTS if adapter == "unix" else "/dev")
    if adapter != "unix":
        assert rig.realtime.late.stop_ms == 20


@pytest.mark.parametrize("sensor", ["wrench", "drive"])
@pytest.mark.parametrize("drive", DRIVES)
def test_the_rig_on_our_own_bus_runs(drive, sensor, tmp_path):
    file = tmp_path / "rig.yaml"
    write_rig(file, rig_text(drive, "unix", sensor, "mine"))
    bench = FramedBench(load_rig(file, registry.AXIS_SCHEMAS))
    bench.axis.configure()
    bench.axis.arm()
    for _ in range(60):
        bench.cycle(0.0)
    assert bench.sample.valid
    assert bench.sample.enabled


@pytest.mark.parametrize("drive", HANDLES)
def test_an_operator_s_device_is_written_for_each_drive_that_takes_torques(drive, tmp_path):
    for adapter in ("unix", "socketcan"):
        file = tmp_path / f"{adapter}.yaml"
        write_rig(file, handle_text(drive, adapter, None))
        rig = load_rig(file, registry.AXIS_SCHEMAS)
        assert rig.axis.driver == "actuator_device"
        at = {"unix": "handle", "socketcan": "can0"}[adapter]
        assert (rig.axis.bus.interface, rig.axis.bus.channel) == (adapter, at)
    with pytest.raises(NewRigError, match="--handle with --drive vesc: is not one of odrive"):
        handle_text("vesc", "unix", None)


@pytest.mark.parametrize("sensor", ["wrench", "load-cell"])
def test_a_canopen_drive_s_own_encoder_is_the_rig_s_where_it_is_asked_for(sensor, tmp_path):
    file = tmp_path / "rig.yaml"
    write_rig(file, rig_text("canopen", "unix", sensor, "mine", "drive"))
    rig = load_rig(file, registry.AXIS_SCHEMAS)
    part = registry.parts_of(rig.axis)["bus"]
    assert (part.position, part.encoder) == ("from drive", None)
    assert rig.unsafe_i_know == ("position_comparison",)
    FramedBench(rig).armed(60)
    with pytest.raises(NewRigError, match="--position encoder: only --drive canopen"):
        rig_text("odrive", "unix", sensor, None, "encoder")


def test_a_cybergear_has_its_own_limits_and_no_watchdog(tmp_path):
    file = tmp_path / "rig.yaml"
    write_rig(file, rig_text("cybergear", "socketcan", "wrench", None))
    rig = load_rig(file, registry.AXIS_SCHEMAS)
    drive = registry.parts_of(rig.axis)["drive"]
    assert (drive.motor, drive.torque_max_Nm, drive.watchdog_ms) == ("cybergear", 12, None)
    assert rig.unsafe_i_know == ("watchdog", "position_comparison")
    assert "RobStride" not in file.read_text()


@pytest.mark.parametrize(
    ("drive", "adapter", "sensor", "words"),
    [
        ("servo", "unix", "wrench", "--drive servo: is not one of odrive"),
        ("odrive", "usb", "wrench", "--adapter usb: is not one of socketcan"),
        ("odrive", "unix", "scale", "--sensor scale: is not one of wrench"),
        ("odrive", "unix", "drive-input", "only --drive canopen sends its analog input"),
        ("moteus", "slcan", "wrench", "moteus needs CAN FD"),
        ("moteus", "serial", "wrench", "moteus is on a CAN bus"),
        ("feetech", "slcan", "wrench", "feetech is on a serial line"),
    ],
)
def test_what_cannot_be_is_refused(drive, adapter, sensor, words):
    with pytest.raises(NewRigError, match=words):
        rig_text(drive, adapter, sensor, None)


def test_a_file_that_is_there_is_left_as_it_is(tmp_path, call):
    file = tmp_path / "rig.yaml"
    file.write_text("mine")
    odrive = ("--drive", "odrive", "--adapter", "slcan", "--sensor", "wrench")
    code, _, err = call("new-rig", file, *odrive)
    assert code == 2
    assert "already exists: name another file" in err
    assert file.read_text() == "mine"
    code, out, _ = call("new-rig", tmp_path / "other.yaml", *odrive)
    assert code == 0
    assert str(tmp_path / "other.yaml") in out


@pytest.mark.parametrize(
    ("options", "step"),
    [
        (("unix", "--sensor", "wrench"), "teleop-rt run silicone_cube --set rig={}"),
        (("unix", "--handle"), "teleop-rt run serial_handle --set operator.rig={}"),
        (("slcan", "--handle"), "put in your own values for its placeholders, then teleop-rt ch"),
    ],
)
def test_the_next_step_with_a_new_rig_is_printed(options, step, tmp_path, call):
    file = tmp_path / "rig.yaml"
    code, out, _ = call("new-rig", file, "--drive", "odrive", "--adapter", *options)
    assert code == 0
    assert out.splitlines()[-1].startswith(f"next: {step.format(file)}")


def test_an_option_that_nobody_can_be_asked_for_is_named_and_nothing_is_written(tmp_path, call):
    file = tmp_path / "rig.yaml"
    code, _, err = call("new-rig", file, "--drive", "odrive")
    assert code == 2
    assert "give --adapter (socketcan, slcan" in err
    assert "--sensor (wrench" in err
    assert "--drive" not in err
    assert not file.exists()


@pytest.mark.parametrize(
    ("option", "given", "known"),
    [
        ("--drive", "odrve", "odrive, damiao"),
        ("--adapter", "can0", "socketcan"),
        ("--sensor", "none", "wrench"),
    ],
)
def test_an_unknown_kind_is_refused_before_missing_options_are_asked_for(
    option, given, known, tmp_path, call
):
    code, _, errors = call("new-rig", str(tmp_path / "rig.yaml"), option, given)
    assert code == 2
    assert errors.startswith(f"{option} {given}: is not one of ")
    assert known in errors


def test_the_schema_that_a_rig_names_for_editors_is_beside_it(tmp_path):
    file = tmp_path / "rig.yaml"
    write_rig(file, rig_text("odrive", "unix", "wrench", None))
    named = file.read_text().splitlines()[0].partition("$schema=")[2]
    assert (tmp_path / named).read_text() == (EXAMPLES / "schema" / "rig.schema.json").read_text()


def commands_of_the_how_tos() -> list[str]:
    pages = sorted((Path(__file__).parents[2] / "docs" / "howto").glob("*.md"))
    found = (re.findall(r"`teleop-rt (new-rig .+?)`", page.read_text()) for page in pages)
    return list(chain.from_iterable(found))


@pytest.mark.parametrize("command", commands_of_the_how_tos())
def test_every_command_of_a_how_to_is_complete(command, call, tmp_path):
    """Without its scan, which needs a bus, and with the shipped description for a maker's."""
    words = command.replace("--eds FILE", f"--eds {DRIVE_EDS}").split()
    words[1] = str(tmp_path / words[1])
    code, _, errors = call(*(word for word in words if word != "--scan"))
    assert code == 0, errors
    load_rig(Path(words[1]), registry.AXIS_SCHEMAS)
