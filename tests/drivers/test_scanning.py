"""`new-rig --scan`: who answers on a bus or line, and a rig with the values read."""

from __future__ import annotations

import pytest
from framed_bench import FramedBench, load
from rig_bench import Bench

from teleop_rt.config.loader import load_rig
from teleop_rt_drivers import registry
from teleop_rt_drivers.calibration.rig_file import with_values
from teleop_rt_drivers.new_rig import on_bus, with_found, write_rig
from teleop_rt_drivers.rig_text import DRIVES, ON_LINES, NewRigError, rig_text
from teleop_rt_drivers.scanning import servos
from teleop_rt_drivers.scanning.found import Found

IDS = {
    "odrive": ("node_id", 9), "damiao": ("motor_id", 5), "robstride": ("motor_id", 0x21),
    "moteus": ("servo_id", 17), "vesc": ("controller_id", 44), "dynamixel": ("servo_id", 12),
    "feetech": ("servo_id", 31),
}  # fmt: skip
"""Another id than the preset's, for a device to be found by."""


def bench_with(drive: str) -> FramedBench:
    """A simulated drive under another id."""
    rig = load(drive)
    key, number = IDS[drive]
    part = rig.axis.parts["drive"].model_copy(update={key: number})
    axis = rig.axis.model_copy(update={"parts": {**rig.axis.parts, "drive": part}})
    return FramedBench(rig.model_copy(update={"axis": axis}))


def found_on(bench: FramedBench, drive: str) -> list[Found]:
    if drive in ON_LINES:
        line = bench.ends.line_pair("drive")[0]
        line.close = lambda: None  # the scan closes its own end of a port at each baud rate
        return servos.SCANS[drive](lambda _: line)
    bench.silence(120)
    return on_bus(bench.ends.bus_pair("drive")[0], lambda: bench.now, drive)


@pytest.mark.parametrize("drive", IDS)
def test_the_drive_is_found_and_the_rig_holds_its_id(drive, tmp_path):
    found = found_on(bench_with(drive), drive)
    key, number = IDS[drive]
    assert [one.number for one in found] == [number]
    text = with_found(rig_text(drive, "unix", "wrench", None), drive, found, None)
    write_rig(tmp_path / "rig.yaml", text)
    part = load_rig(tmp_path / "rig.yaml", registry.AXIS_SCHEMAS).axis.parts["drive"]
    assert getattr(part, key) == number


@pytest.mark.parametrize("drive", IDS)
def test_a_scan_gives_no_power_and_moves_nothing(drive):
    bench = bench_with(drive)
    before = bench.simulated.plant.position
    found_on(bench, drive)
    assert not bench.simulated.drive.powered
    assert bench.simulated.plant.position == before


def test_what_else_a_drive_says_is_written_or_shown():
    (damiao,) = found_on(bench_with("damiao"), "damiao")
    assert damiao.values == {("motor_id",): 5, ("host_id",): 0x11, ("motor",): "DM4310"}
    (servo,) = found_on(bench_with("moteus"), "moteus")
    assert servo.words == "moteus 17, model 261, firmware 1.3.4"
    (dynamixel,) = found_on(bench_with("dynamixel"), "dynamixel")
    assert dynamixel.words == "Dynamixel 12 at 3000000 baud, model 1030, firmware 48"


def test_the_baud_rate_is_that_at_which_something_answers(tmp_path):
    bench, tried = bench_with("dynamixel"), []
    line = bench.ends.line_pair("drive")[0]
    line.close = lambda: None
    nothing = FramedBench(load("serial")).ends.line_pair("other")[0]
    nothing.close = lambda: None

    def open_line(baud: int):
        tried.append(baud)
        return line if baud == 57_600 else nothing

    (found,) = servos.dynamixels(open_line)
    assert tried == [3_000_000, 1_000_000, 57_600]
    assert found.values["baud",] == 57_600


def test_canopen_nodes_are_distinguished_by_profile_and_identity(tmp_path):
    bench = Bench()
    found = on_bus(bench.daemon_end, lambda: bench.now, "canopen")
    assert [one.number for one in found] == [0x10, 0x20, 0x30]
    assert found[2].words == "node 48, CiA 402, vendor 0x543, product 0x402"
    text = rig_text("canopen", "unix", "drive", None)
    moved = with_values(text, {("axis", "drive", "node_id"): 3})
    write_rig(tmp_path / "rig.yaml", with_found(moved, "canopen", found, None))
    axis = load_rig(tmp_path / "rig.yaml", registry.AXIS_SCHEMAS).axis
    assert (axis.drive.node_id, axis.drive.identity.product) == (0x30, 0x402)
    both = with_found(rig_text("canopen", "unix", "wrench", None), "canopen", found, None)
    write_rig(tmp_path / "both.yaml", both)


def test_a_node_of_another_maker_is_named_with_what_to_write():
    values = {("drive", "node_id"): 1, ("drive", "identity", "vendor"): 0xFB}
    epos = Found(1, values, "node 1, CiA 402, vendor 0xfb, product 0x63220000")
    with pytest.raises(NewRigError, match=r"vendor 0xfb.*eds: the file of its maker"):
        with_found(rig_text("canopen", "unix", "drive", None), "canopen", [epos], None)
    force = Found(2, {("force", "node_id"): 2}, "node 2, CiA 404")
    with pytest.raises(NewRigError, match="no node has the profile of the drive: node 2, CiA 404"):
        with_found(rig_text("canopen", "unix", "drive", None), "canopen", [force], None)


def test_where_several_answer_one_must_be_named():
    text = rig_text("moteus", "unix", "wrench", None)
    two = [Found(n, {("servo_id",): n}, f"moteus {n}") for n in (1, 2)]
    with pytest.raises(NewRigError, match="2 answer: moteus 1; moteus 2: say which by --id"):
        with_found(text, "moteus", two, None)
    assert "servo_id: 2\n" in with_found(text, "moteus", two, 2)


@pytest.mark.parametrize("drive", DRIVES)
def test_nothing_is_written_where_nobody_answers(drive, tmp_path, call):
    file = tmp_path / "rig.yaml"
    adapter, channel = ("serial", str(tmp_path / "tty")) if drive in ON_LINES else ("unix", "empty")
    code, _, err = call(
        "new-rig", file, "--drive", drive, "--adapter", adapter, "--sensor", "wrench",
        "--channel", channel, "--scan",
    )  # fmt: skip
    assert code == 2
    assert not file.exists()
    words = "cannot open the serial port" if drive in ON_LINES else f"no {drive} answers"
    assert words in err


def test_whole_numbers_are_written_whole():
    text = "axis:\n  drive:\n    product: 1 # here\n    scale: 1.0\n"
    values = {("axis", "drive", "product"): 0xFFFFFFFF, ("axis", "drive", "scale"): 1 / 3}
    assert with_values(text, values) == (
        "axis:\n  drive:\n    product: 4294967295 # here\n    scale: 0.333333\n"
    )
