"""Keys of makers' drives in a rig file: the change of each on the wire, or in the values read."""

from __future__ import annotations

import struct

import pytest

from teleop_rt.config.loader import load_rig
from teleop_rt_dev.paths import RIGS
from teleop_rt_drivers import registry
from teleop_rt_drivers.actuators.codec import DriveState, Frame, Report, Taken


@pytest.fixture
def codec_of(tmp_path):
    """Give the codec of a rig that ships, with one key of its drive changed."""

    def made(maker, key="", value=0.0):
        text = (RIGS / f"simulated_{maker}.yaml").read_text()
        if key:
            (line,) = [line for line in text.splitlines() if line.strip().startswith(f"{key}:")]
            text = text.replace(line, line[: line.index(":")] + f": {value}")
        path = tmp_path / f"{maker}-{key}.yaml"
        path.write_text(text)
        rig = load_rig(path, registry.AXIS_SCHEMAS)
        return registry.parts_of(rig.axis)["drive"].codec(rig)

    return made


def read(codec, frame):
    report = Report()
    assert codec.take(frame, report) in {Taken.STATE, Taken.MEASURED, Taken.NOTED}
    return report


def test_an_odrives_torque_constant_and_limit_of_current(codec_of):
    currents = Frame(3 << 5 | 0x14, struct.pack("<ff", 0.0, 2.0))
    assert read(codec_of("odrive"), currents).torque == pytest.approx(2.0 * 0.05)
    changed = codec_of("odrive", "torque_constant_Nm_per_A", 0.08)
    assert read(changed, currents).torque == pytest.approx(2.0 * 0.08)
    limits = {
        one.can_id & 0x1F: one.data for one in codec_of("odrive", "current_max_A", 25).opening()
    }
    assert struct.unpack("<ff", limits[0x0F])[1] == 25.0


def vesc_status(erpm, tenths_of_A):
    return Frame(9 << 8 | 23, struct.pack(">ihh", erpm, tenths_of_A, 0), extended=True)


def vesc_temperatures(motor_C):
    return Frame(
        16 << 8 | 23, struct.pack(">hhhh", 200, round(10 * motor_C), 0, 9000), extended=True
    )


def test_a_vescs_pole_pairs_and_torque_constant(codec_of):
    status = vesc_status(8400, 50)  # 5 A; 7 pole pairs and 4 turns: 5 turns a second
    ours = read(codec_of("vesc"), status)
    assert (ours.velocity, ours.torque) == (pytest.approx(5.0), pytest.approx(5 * 0.06 * 4))
    assert read(codec_of("vesc", "pole_pairs", 14), status).velocity == pytest.approx(2.5)
    changed = codec_of("vesc", "torque_constant_Nm_per_A", 0.03)
    assert read(changed, status).torque == pytest.approx(5 * 0.03 * 4)


def test_a_vescs_limits_of_current_and_temperature(codec_of):
    (frame,) = codec_of("vesc", "current_max_A", 12).push(1e9)
    assert struct.unpack(">i", frame.data) == (12_000,)
    hot = vesc_temperatures(70)
    assert read(codec_of("vesc"), hot).state is not DriveState.FAULT
    strict = codec_of("vesc", "current_max_A", "60\n      temperature_max_C: 65")
    assert read(strict, hot).state is DriveState.FAULT


@pytest.mark.parametrize(("kp", "whole"), [(79, 647), (158, 1294)])
def test_a_damiaos_stiffness_is_the_gain_of_every_command(codec_of, kp, whole):
    (frame,) = codec_of("damiao", "kp_Nm_per_rad", kp).follow(0.0, 0.0)
    packed = int.from_bytes(frame.data, "big")
    assert packed >> 24 & 0xFFF == whole, "of 500 Nm/rad over 12 bits"


def test_a_dynamixels_limit_of_current_is_written_as_its_goal(codec_of):
    opening = codec_of("dynamixel", "current_max_A", 1.345).opening()
    (goal,) = [f.data for f in opening if f.data[8:10] == struct.pack("<H", 102)]
    assert struct.unpack("<h", goal[13:15]) == (500,), "counts of 2.69 mA"
