"""A CyberGear by its manual, chapter 4: the daemon's frames, and the simulated motor's answers.

No codec of ours writes or reads a byte here. Each number is worked out from the manual's tables: an
id is type << 24 | data << 8 | target, 16 bits span a range, and the highest byte comes first.
"""

from __future__ import annotations

import math
import struct

import pytest
from framed_bench import edited
from rig_bench import MS
from test_simulated_makers import EXTENDED, LATE_NS, Bench

from teleop_rt_drivers.actuators.codec import DriveState, Frame, Report, Taken

MOTOR, HOST = 0x7F, 0xFD
TOP = 4.0 * math.pi
SCALE = 0.01
FAULTS = {
    16: "under-voltage", 17: "over-current", 18: "over-temperature", 19: "magnetic encoder",
    20: "hall encoder", 21: "not calibrated",
}  # fmt: skip


@pytest.fixture
def rig(tmp_path):
    return edited(
        "robstride",
        tmp_path,
        ("motor: robstride02", "motor: cybergear"),
        ("torque_max_Nm: 17", "torque_max_Nm: 12"),
        ("watchdog_ms: 50", "watchdog_ms: null"),
        ("unsafe_i_know: [", "unsafe_i_know: [watchdog, "),
    )


@pytest.fixture
def codec(rig):
    return rig.axis.parts["drive"].codec(rig)


@pytest.fixture
def motor(rig):
    return lambda **state: Bench(rig, **state)


def word(value, top):
    """The 16 bits of a value in a range of both signs."""
    return math.floor((value + top) / (2.0 * top) * 65535.0)


def near(data, *words):
    """Whether 16-bit words, the highest byte first, are these, or beside them by rounding."""
    return all(
        abs(a - b) <= 1 for a, b in zip(struct.unpack(f">{len(words)}H", data), words, strict=True)
    )


def test_a_cybergear_is_stopped_cleared_and_limited_and_no_time_out_is_written(codec):
    frames = [(frame.can_id, frame.data.hex()) for frame in codec.opening()]
    assert frames == [
        (0x0400FD7F, "0100000000000000"),  # 4.1.5: stop, and clear the fault
        (0x1200FD7F, "0570000000000000"),  # 4.1.9: 0x7005 run_mode, 0 operation control
        (0x1200FD7F, "0b70000000004041"),  # 0x700B limit_torque, a float of 12 Nm
    ]
    assert all(frame.extended for frame in codec.opening())


def test_a_cybergear_is_enabled_and_moved_by_types_3_and_1(codec):
    enable, nothing = codec.enable(1.0)
    assert (enable.can_id, len(enable.data)) == (0x0300FD7F, 8)  # 4.1.4
    assert nothing.can_id >> 24 == 1
    (follow,) = codec.follow(1.25, -3.0)
    assert follow.can_id & 0xFF == MOTOR
    assert follow.can_id >> 24 == 1
    assert abs((follow.can_id >> 8 & 0xFFFF) - word(0.0, 12.0)) <= 1, "no torque fed forward"
    stiffness, damping = round(79 / 500 * 65535), round(0.25 / 5 * 65535)
    assert near(follow.data, word(1.25, TOP), word(-3.0, 30.0), stiffness, damping)
    (push,) = codec.push(-6.0)
    assert abs((push.can_id >> 8 & 0xFFFF) - word(-6.0, 12.0)) <= 1
    assert push.data[4:].hex() == "00000000", "without gains nothing but the torque counts"
    (stop,) = codec.disable()
    assert (stop.can_id, stop.data.hex()) == (0x0400FD7F, "0000000000000000")


def answer(mode=2, faults=0, words=(0xFFFF, 0x0000, 0x8000), motor=MOTOR, host=HOST):
    """4.1.3: type 2, mode in bits 22 and 23, faults in 16 to 21, motor in 8 to 15, host below."""
    can_id = 2 << 24 | mode << 22 | faults << 16 | motor << 8 | host
    return Frame(can_id, struct.pack(">4H", *words, 253), extended=True)


def test_a_cybergear_s_feedback_is_read_by_its_table(codec):
    report = Report()
    assert codec.take(answer(), report) is Taken.MEASURED
    assert report.state is DriveState.FOLLOWING
    assert (report.position, report.velocity) == (pytest.approx(TOP), pytest.approx(-30.0))
    assert report.torque == pytest.approx(0.0, abs=24.0 / 65535.0)
    assert codec.take(answer(mode=0), report) is Taken.MEASURED
    assert report.state is DriveState.OFF
    assert codec.take(answer(mode=1), report) is Taken.MEASURED
    assert report.state is DriveState.BUSY, "it calibrates"
    assert codec.take(answer(motor=MOTOR - 1), report) is Taken.OTHER
    assert codec.take(answer(host=HOST - 1), report) is Taken.OTHER


@pytest.mark.parametrize(("bit", "words"), FAULTS.items())
def test_each_fault_of_a_cybergear_s_feedback_has_its_name(codec, bit, words):
    report = Report()
    codec.take(answer(faults=1 << bit - 16), report)
    assert report.state is DriveState.FAULT
    assert words in report.complaint.lower()


def test_a_simulated_cybergear_obeys_the_manual_s_frames(motor):
    bench = motor(position=TOP * SCALE, velocity=-30.0 * SCALE, force=12.0 / SCALE)
    ((whom, data),) = bench.hears(0x0300FD7F, "0000000000000000")
    assert whom == EXTENDED | 0x02 << 24 | 2 << 22 | MOTOR << 8 | HOST
    assert data.hex()[:12] == "ffff0000ffff"
    bench.hears(0x01 << 24 | 0xFFFF << 8 | MOTOR, "ffff 0000 3333 cccc")
    name, x, v, kp, kd, _ = bench.table.done[-1]
    assert (name, x, v) == ("impede", pytest.approx(TOP * SCALE), pytest.approx(-30.0 * SCALE))
    assert (kp * SCALE**2, kd * SCALE**2) == (pytest.approx(100.0), pytest.approx(4.0))
    bench.hears(0x01 << 24 | 0x0000 << 8 | MOTOR, "8000 8000 0000 0000")
    assert bench.table.done[-1] == ("push", pytest.approx(-12.0 / SCALE))
    ((whom, _),) = bench.hears(0x0400FD7F, "0000000000000000")
    assert whom >> 22 & 3 == 0, "reset mode"
    ((whom, data),) = bench.hears(0x0000FD7F, "0000000000000000")  # 4.1.1: who are you
    assert (whom, len(data)) == (EXTENDED | MOTOR << 8 | 0xFE, 8)


def test_a_simulated_cybergear_goes_on_without_commands_for_it_knows_no_time_out(motor):
    bench = motor()
    bench.hears(0x0300FD7F, "0000000000000000")
    bench.hears(0x1200FD7F, "2870 0000 e8030000")  # RobStride's CAN_TIMEOUT is no parameter of it
    bench.drive.run(LATE_NS + 10_000 * MS)
    assert bench.drive.enabled
