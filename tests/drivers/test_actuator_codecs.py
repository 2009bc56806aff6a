"""Makers' protocols byte by byte, against encoders that share nothing with ours."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from makers_codecs import FLOATS, NODE, VESC, damiao, moteus, odrive, robstride, vesc

from teleop_rt_drivers.actuators.codec import DriveState, Frame, Report, Taken
from teleop_rt_drivers.actuators.moteus import registers


def test_moteus_reads_the_example_of_its_documentation():
    found = registers(bytes.fromhex("2404000a005000000170ff230d181400"))
    assert found == {0: 10, 1: 80, 2: 256, 3: -144, 0xD: 24, 0xE: 20, 0xF: 0}


def subframes(data: bytes) -> list[tuple[str, int, tuple[float, ...]]]:
    """Read a command as its documentation says, by a table of our own."""
    sizes, rows, rest = {0: "b", 4: "h", 8: "i", 12: "f"}, [], list(data)
    while rest and rest[0] != 0x50:
        head = rest.pop(0)
        count = head & 3 or rest.pop(0)
        start, code = rest.pop(0), sizes[head & 0x0C]
        if head >= 0x10:
            rows.append(("read", start, (float(count),)))
            continue
        size = struct.calcsize(code) * count
        rows.append(("write", start, struct.unpack(f"<{count}{code}", bytes(rest[:size]))))
        rest = rest[size:]
    return rows


@given(FLOATS, FLOATS)
def test_moteus_commands_hold_limits_and_watchdog_and_ask_for_the_state(position, velocity):
    (frame,) = moteus().follow(position, velocity)
    assert frame.can_id == 0x8001
    assert frame.fd
    assert len(frame.data) in {8, 12, 16, 20, 24, 32, 48, 64}
    mode, command, state, fault = subframes(frame.data)
    assert mode == ("write", 0, (10,))
    kind, start, values = command
    assert (kind, start) == ("write", 0x20)
    assert values[:5] == (position, velocity, 0.0, 1.0, 1.0)
    assert values[5] == 2.0
    assert math.isnan(values[6])
    assert values[7] == pytest.approx(0.05)
    assert values[8] == 50.0
    assert (state, fault) == (("read", 0, (4.0,)), ("read", 0xF, (1.0,)))


def test_a_moteus_brakes_by_standing_for_it_has_no_damping_without_stiffness():
    """registers.md, 0x024: the scale of kd is limited to be no more than that of kp."""
    (frame,) = moteus().brake()
    _, (_, start, values), *_ = subframes(frame.data)
    assert start == 0x20
    assert math.isnan(values[0])
    assert values[1:5] == (0.0, 0.0, 1.0, 1.0)


@given(FLOATS, FLOATS, FLOATS, st.sampled_from([0, 1, 5, 10, 11]), st.integers(0, 48))
def test_moteus_answers_are_read_with_their_padding(position, velocity, torque, mode, fault):
    body = b"\x2c\x04\x00" + struct.pack("<ffff", mode, position, velocity, torque)
    body += bytes((0x21, 0x0F, fault))
    report = Report()
    taken = moteus().take(Frame(0x100, body.ljust(24, b"\x50"), fd=True), report)
    assert taken is Taken.MEASURED
    assert (report.position, report.velocity, report.torque) == (position, velocity, torque)
    expected = {
        0: DriveState.OFF,
        1: DriveState.FAULT,
        5: DriveState.BUSY,
        10: DriveState.FOLLOWING,
        11: DriveState.FAULT,
    }
    assert report.state is expected[mode]


def vesc_frame(command: int, *fields: tuple[float, int, int]) -> Frame:
    """A frame of signed numbers, the highest byte first: value, bytes and scaling of each."""
    data = b"".join(
        round(value * scaling).to_bytes(size, "big", signed=True) for value, size, scaling in fields
    )
    return Frame(command * 256 + VESC, data, extended=True)


def test_a_vesc_is_asked_for_the_current_of_its_documentation():
    # 51 A for VESC 23; 4 turns of the motor make 4 times its torque.
    (frame,) = vesc().push(51 * 0.06 * 4)
    assert frame == Frame(0x0117, bytes.fromhex("0000C738"), extended=True)
    (frame,) = vesc().push(-1e9)
    assert frame == vesc_frame(1, (-60, 4, 1000))


@given(st.floats(-0.7, 0.7))
def test_vesc_positions_are_degrees_about_the_middle_of_a_turn(position):
    (frame,) = vesc().follow(position, 3.0)
    within = max(-0.49, min(0.49, position))
    assert frame.can_id == 4 * 256 + VESC
    degrees = int.from_bytes(frame.data, "big", signed=True) / 1e6
    assert degrees == pytest.approx(180 + 360 * within, abs=1e-6)
    assert 0 < degrees < 360


INT16 = st.integers(-(2**15), 2**15 - 1)


@given(st.integers(-(2**31), 2**31 - 1), INT16, st.integers(0, 18000), INT16)
def test_vesc_status_messages_are_read_by_their_scalings(erpm, deciamperes, fiftieths, duty):
    codec, report = vesc(), Report()
    frame = vesc_frame(9, (erpm, 4, 1), (deciamperes, 2, 1), (duty, 2, 1))
    assert codec.take(frame, report) is Taken.STATE
    assert report.velocity == pytest.approx(erpm / 7 / 60 / 4)
    assert report.torque == pytest.approx(deciamperes / 10 * 0.06 * 4)
    frame = vesc_frame(16, (25, 2, 10), (30, 2, 10), (0, 2, 10), (fiftieths, 2, 1))
    assert codec.take(frame, report) is Taken.MEASURED
    assert report.position == pytest.approx((fiftieths / 50 - 180) / 360)


def test_a_vesc_follows_after_a_command_and_is_at_fault_when_hot_and_refuses_no_turn():
    codec, report = vesc(), Report()

    def answered(bridge=25.0, motor=30.0, degrees=180.0):
        fields = ((bridge, 2, 10), (motor, 2, 10), (1, 2, 10), (degrees, 2, 50))
        return codec.take(vesc_frame(16, *fields), report)

    assert (answered(), report.state) == (Taken.MEASURED, DriveState.OFF)
    (frame,) = codec.enable(0.1)
    assert frame == vesc_frame(4, (216, 4, 10**6))
    assert (answered(), report.state) == (Taken.MEASURED, DriveState.FOLLOWING)
    for hot in ({"bridge": 85.2}, {"motor": 120.0}):
        answered(**hot)
        assert report.state is DriveState.FAULT
        assert "over-temperature" in report.complaint
    assert answered(degrees=361.0) is Taken.REFUSED
    assert report.refusal == "out_of_range"
    assert codec.disable() == (vesc_frame(1, (0, 4, 1000)),)
    answered()
    assert report.state is DriveState.OFF
    for command in (0, 1, 2, 3, 4, 10, 11, 12, 13):
        assert codec.take(vesc_frame(command, (1, 4, 1)), report) is Taken.FOREIGN
    assert codec.take(vesc_frame(27, (1, 4, 6), (24, 2, 10)), report) is Taken.NOTED


CODECS = [odrive, damiao, robstride, moteus, vesc]


@settings(max_examples=200)
@given(
    st.sampled_from(CODECS),
    st.integers(0, 2**29 - 1),
    st.binary(max_size=64),
    st.booleans(),
)
def test_no_bytes_raise_and_what_is_refused_changes_nothing(make, can_id, data, extended):
    codec, report = make(), Report()
    before = (report.position, report.velocity, report.torque, report.state)
    ours = {odrive: NODE * 32 + 9, damiao: 0x11, robstride: 0x02807FFD, moteus: 0x100,
            vesc: 16 * 256 + VESC}[make]  # fmt: skip
    for one in (can_id, ours):
        taken = codec.take(Frame(one, data, extended or make in {robstride, vesc}), report)
        if taken not in {Taken.MEASURED, Taken.STATE, Taken.NOTED}:
            assert (report.position, report.velocity, report.torque, report.state) == before
        assert all(math.isfinite(v) for v in (report.position, report.velocity, report.torque))
        before = (report.position, report.velocity, report.torque, report.state)
