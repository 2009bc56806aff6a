"""Makers' protocols byte by byte, against encoders that share nothing with ours."""

from __future__ import annotations

import math
import struct

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teleop_rt_drivers.actuators.codec import DriveState, Frame, Report, Taken
from teleop_rt_drivers.actuators.mit import (
    DAMIAO_RANGES,
    TYPED_RANGES,
    DamiaoCodec,
    Gains,
    MotorLimits,
    TypedCodec,
)
from teleop_rt_drivers.actuators.moteus import MoteusCodec, registers
from teleop_rt_drivers.actuators.odrive import OdriveCodec
from teleop_rt_drivers.actuators.vesc import VescCodec, VescMotor

NODE = 5
# Command, name, signals: name, start bit, bits, "f" float, "s" signed, "u" unsigned, factor. From
# the table of messages in ODrive's documentation.
TABLE = [
    (0x01, "Heartbeat", [("Error", 0, 32, "u", 1), ("State", 32, 8, "u", 1),
                         ("Motor", 40, 1, "u", 1), ("Encoder", 48, 1, "u", 1),
                         ("Controller", 56, 1, "u", 1), ("Done", 63, 1, "u", 1)]),
    (0x07, "Set_State", [("State", 0, 32, "u", 1)]),
    (0x09, "Estimates", [("Pos", 0, 32, "f", 1), ("Vel", 32, 32, "f", 1)]),
    (0x0B, "Modes", [("Control", 0, 32, "s", 1), ("Input", 32, 32, "s", 1)]),
    (0x0C, "Input_Pos", [("Pos", 0, 32, "f", 1), ("Vel", 32, 16, "s", 0.001),
                         ("Torque", 48, 16, "s", 0.001)]),
    (0x0E, "Input_Torque", [("Torque", 0, 32, "f", 1)]),
    (0x0F, "Limits", [("Vel", 0, 32, "f", 1), ("Current", 32, 32, "f", 1)]),
    (0x14, "Iq", [("Setpoint", 0, 32, "f", 1), ("Measured", 32, 32, "f", 1)]),
]  # fmt: skip


def odrive_database():
    """A DBC of our own from the table, read by cantools."""
    lines, types = ['VERSION ""', "NS_ :", "BS_:", "BU_: M D"], []
    for command, name, signals in TABLE:
        frame_id = NODE * 32 + command
        lines.append(f"BO_ {frame_id} {name}: 8 M")  # all, says the maker's DBC
        for signal, start, bits, kind, factor in signals:
            sign = "+" if kind == "u" else "-"
            lines.append(f' SG_ {signal} : {start}|{bits}@1{sign} ({factor},0) [0|0] "" D')
            types += [f"SIG_VALTYPE_ {frame_id} {signal} : 1;"] if kind == "f" else []
        lines.append("")
    return cantools.database.load_string("\n".join([*lines, *types]), "dbc")


DATABASE = odrive_database()
FLOATS = st.floats(-1e4, 1e4, width=32)


def odrive():
    return OdriveCodec(NODE, 0.05, 50.0, 40.0)


def said(name: str, **values: float) -> Frame:
    message = DATABASE.get_message_by_name(name)
    return Frame(message.frame_id, message.encode(values))


def understood(frame: Frame) -> tuple[str, dict[str, float]]:
    message = DATABASE.get_message_by_frame_id(frame.can_id)
    return message.name, message.decode(frame.data)


@given(FLOATS, st.floats(-30, 30))
def test_odrive_commands_are_what_cantools_reads(position, velocity):
    (frame,) = odrive().follow(position, velocity)
    name, values = understood(frame)
    assert name == "Input_Pos"
    assert values["Pos"] == position
    assert values["Vel"] == pytest.approx(velocity, abs=0.5e-3 + 1e-9)
    assert values["Torque"] == 0


def test_odrive_is_given_power_by_mode_position_and_state_and_its_limits_are_written():
    codec = odrive()
    assert [understood(frame) for frame in codec.enable(1.25)] == [
        ("Modes", {"Control": 3, "Input": 1}),
        ("Input_Pos", {"Pos": 1.25, "Vel": 0, "Torque": 0}),
        ("Set_State", {"State": 8}),
    ]
    idle, clear, limits = codec.opening()
    assert understood(idle) == ("Set_State", {"State": 1})
    assert clear == Frame(NODE * 32 + 0x18, b"")
    assert understood(limits) == ("Limits", {"Vel": 50.0, "Current": 40.0})
    mode, torque = codec.push(0.75)
    assert understood(mode) == ("Modes", {"Control": 1, "Input": 1})
    assert understood(torque) == ("Input_Torque", {"Torque": 0.75})


@given(FLOATS, FLOATS, FLOATS)
def test_odrive_reports_are_read_as_cantools_writes_them(position, velocity, current):
    codec, report = odrive(), Report()
    assert codec.take(said("Iq", Setpoint=0, Measured=current), report) is Taken.NOTED
    assert codec.take(said("Estimates", Pos=position, Vel=velocity), report) is Taken.MEASURED
    assert (report.position, report.velocity) == (position, velocity)
    assert report.torque == pytest.approx(0.05 * current)


@pytest.mark.parametrize(
    ("fields", "state", "words"),
    [
        ({"State": 1}, DriveState.OFF, ""),
        ({"State": 8}, DriveState.FOLLOWING, ""),
        ({"State": 3}, DriveState.BUSY, ""),
        ({"State": 8, "Error": 0x800}, DriveState.FAULT, "watchdog timer expired"),
        ({"State": 1, "Error": 0x40040}, DriveState.FAULT, "over-temperature"),
        ({"State": 8, "Motor": 1}, DriveState.FAULT, "dump_errors"),
        ({"State": 8, "Encoder": 1}, DriveState.FAULT, "dump_errors"),
        ({"State": 8, "Controller": 1}, DriveState.FAULT, "dump_errors"),
        ({"State": 8, "Done": 1}, DriveState.FOLLOWING, ""),
    ],
)
def test_odrive_heartbeats_contain_state_and_errors(fields, state, words):
    report = Report()
    values = dict.fromkeys(("Error", "Motor", "Encoder", "Controller", "Done"), 0) | fields
    assert odrive().take(said("Heartbeat", **values), report) is Taken.STATE
    assert report.state is state
    assert words in report.complaint


def beat(codec: OdriveCodec, state: int, error: int) -> DriveState:
    report = Report()
    values = {"State": state, "Error": error, "Motor": 0, "Encoder": 0, "Controller": 0, "Done": 0}
    codec.take(said("Heartbeat", **values), report)
    return report.state


def test_an_odrive_s_watchdog_that_expires_without_power_is_cleared_and_with_power_is_a_fault():
    codec, clear = odrive(), Frame(NODE * 32 + 0x18, b"")
    codec.opening()
    assert clear not in codec.enable(0.0)
    codec.opening()
    assert beat(codec, 1, 0x800) is DriveState.OFF
    assert beat(codec, 1, 0x801) is DriveState.FAULT, "no other error is forgiven"
    assert beat(codec, 1, 0x800) is DriveState.OFF
    assert codec.enable(0.0)[0] == clear
    assert beat(codec, 8, 0) is DriveState.FOLLOWING
    codec.disable()
    assert beat(codec, 1, 0x800) is DriveState.FAULT, "it expired under power"
    codec.disable()
    assert beat(codec, 1, 0x800) is DriveState.FAULT, "until the axis is opened again"
    codec.opening()
    beat(codec, 8, 0)  # of a daemon before this one
    assert beat(codec, 1, 0x800) is DriveState.OFF
    codec.enable(0.0)
    assert beat(codec, 1, 0x800) is DriveState.OFF, "it was sent before the order was obeyed"
    assert codec.disable()[0] == clear
    assert beat(codec, 1, 0) is DriveState.OFF
    assert clear not in codec.disable()
    assert beat(codec, 1, 0x800) is DriveState.OFF, "a watchdog that expires later is none"


def bits(number: int, width: int) -> str:
    return f"{number:0{width}b}"


def nearest(value: float, top: float, width: int, low: float | None = None) -> int:
    """The whole number of a value, by search rather than by formula."""
    low, most = -top if low is None else low, 2**width - 1
    guess = int((value - low) / (top - low) * most)
    return min(
        (n for n in range(guess - 1, guess + 3) if 0 <= n <= most),
        key=lambda n: abs(low + n * (top - low) / most - value),
    )


DM = DAMIAO_RANGES["DM4310"]


def damiao():
    return DamiaoCodec(0x01, 0x11, DM, Gains(80.0, 1.0))


@given(st.floats(-12.5, 12.5), st.floats(-30, 30), st.floats(-10, 10))
def test_damiao_commands_are_64_bits_in_the_manual_s_order(position, velocity, torque):
    frame = damiao().impedance(position, velocity, 80.0, 1.0, torque)
    text = bits(nearest(position, 12.5, 16), 16) + bits(nearest(velocity, 30.0, 12), 12)
    text += bits(nearest(80.0, 500.0, 12, 0.0), 12) + bits(nearest(1.0, 5.0, 12, 0.0), 12)
    text += bits(nearest(torque, 10.0, 12), 12)
    assert frame.can_id == 1
    sent = bits(int.from_bytes(frame.data, "big"), 64)
    for begin, end in ((0, 16), (16, 28), (28, 40), (40, 52), (52, 64)):
        # A value midway between two numbers may be either.
        assert abs(int(sent[begin:end], 2) - int(text[begin:end], 2)) <= 1


@pytest.mark.parametrize("torque", [0.0, 1e-3, -0.7133, 9.999])
def test_a_torque_between_two_codes_is_pushed_in_the_mean(torque):
    """No code of 12 bits is 0: rounded alone, a hand was pushed by 0.24 N for ever."""
    codec, step = damiao(), 20.0 / 4095
    sent = []
    for _ in range(1000):
        (frame,) = codec.push(torque)
        sent.append(-10.0 + (int.from_bytes(frame.data, "big") & 0xFFF) * step)
    assert abs(sum(sent) / 1000 - torque) < 1e-3 * step
    assert max(abs(one - torque) for one in sent) <= step


def test_a_torque_beyond_the_range_leaves_nothing_to_be_pushed_later():
    codec = damiao()
    for _ in range(50):
        codec.push(30.0)
    (frame,) = codec.push(0.0)
    assert abs((int.from_bytes(frame.data, "big") & 0xFFF) - 2047.5) < 2


@given(st.integers(0, 65535), st.integers(0, 4095), st.integers(0, 4095), st.integers(0, 15))
def test_damiao_answers_are_read_bit_by_bit(p, v, t, error):
    text = bits(error, 4) + bits(1, 4) + bits(p, 16) + bits(v, 12) + bits(t, 12) + bits(0, 16)
    report = Report()
    frame = Frame(0x11, int(text, 2).to_bytes(8, "big"))
    assert damiao().take(frame, report) is Taken.MEASURED
    assert report.position == pytest.approx(-12.5 + p * 25.0 / 65535)
    assert report.velocity == pytest.approx(-30.0 + v * 60.0 / 4095)
    assert report.torque == pytest.approx(-10.0 + t * 20.0 / 4095)
    expected = {0: DriveState.OFF, 1: DriveState.FOLLOWING}.get(error, DriveState.FAULT)
    assert report.state is expected
    assert bool(report.complaint) is (expected is DriveState.FAULT)


def test_damiao_orders_are_seven_ff_and_a_code():
    codec = damiao()
    assert [frame.data.hex() for frame in codec.opening()] == ["ff" * 7 + "fd", "ff" * 7 + "fb"]
    enable, nothing = codec.enable(3.0)
    assert enable.data.hex() == "ff" * 7 + "fc"
    # p, v and t at the middle of their ranges, no gains: nothing moves.
    assert nothing.data.hex() in {"80008000000007ff", "7fff7ff0000007ff", "8000800000000800"}


RS = TYPED_RANGES["robstride02"]


def robstride():
    return TypedCodec(0x7F, 0xFD, RS, Gains(80.0, 1.0), MotorLimits(17.0, 50))


@given(st.floats(-12.5, 12.5), st.floats(-44, 44), st.floats(-17, 17))
def test_typed_commands_carry_the_torque_in_their_id(position, velocity, torque):
    frame = robstride().impedance(position, velocity, 80.0, 1.0, torque)
    assert frame.extended
    text = bits(frame.can_id, 29)
    assert int(text[:5], 2) == 1
    assert int(text[21:], 2) == 0x7F
    assert abs(int(text[5:21], 2) - nearest(torque, 17.0, 16)) <= 1
    sent = [int.from_bytes(frame.data[at : at + 2], "big") for at in (0, 2, 4, 6)]
    expected = [
        nearest(position, 4 * math.pi, 16),
        nearest(velocity, 44.0, 16),
        nearest(80.0, 500.0, 16, 0.0),
        nearest(1.0, 5.0, 16, 0.0),
    ]
    assert all(abs(one - other) <= 1 for one, other in zip(sent, expected, strict=True))


@given(
    st.lists(st.integers(0, 65535), min_size=4, max_size=4), st.integers(0, 63), st.integers(0, 3)
)
def test_typed_answers_contain_faults_and_mode_in_their_id(numbers, faults, mode):
    text = bits(2, 5) + bits(mode, 2) + bits(faults, 6) + bits(0x7F, 8) + bits(0xFD, 8)
    data = b"".join(number.to_bytes(2, "big") for number in numbers)
    report = Report()
    taken = robstride().take(Frame(int(text, 2), data, extended=True), report)
    assert taken is Taken.MEASURED
    tops = (4 * math.pi, 44.0, 17.0)
    read = (report.position, report.velocity, report.torque)
    for value, number, top in zip(read, numbers, tops, strict=False):
        assert value == pytest.approx(-top + number * 2 * top / 65535)
    healthy = {0: DriveState.OFF, 2: DriveState.FOLLOWING}.get(mode, DriveState.BUSY)
    assert report.state is (DriveState.FAULT if faults else healthy)


def test_typed_motors_are_opened_with_mode_torque_and_time_out():
    stop, mode, torque, timeout = robstride().opening()
    assert stop == Frame(0x0400FD7F, b"\x01" + bytes(7), extended=True)
    assert mode.data == bytes.fromhex("0570 0000 00000000")
    assert torque.data == bytes.fromhex("0B70 0000") + struct.pack("<f", 17.0)
    assert timeout.data == bytes.fromhex("2870 0000 E8030000")  # 1000 counts of 50 us
    assert {frame.can_id for frame in (mode, torque, timeout)} == {0x1200FD7F}


# The manual of the CyberGear, 4.1.10: type 21, bits 15 to 8 host, bits 7 to 0 motor; bytes 0 to 3
# the fault value, bytes 4 to 7 warnings. Other makers' drivers read motor and host swapped.
@pytest.mark.parametrize("can_id", [0x1500FD7F, 0x15007FFD])
@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("01000000", "over-temperature of the motor"),
        ("08000000", "over-voltage"),
        ("00000100", "over-current of phase A"),
        ("00400000", "overload"),
    ],
)
def test_a_typed_motor_s_fault_message_is_taken_and_stays_until_faults_are_cleared(
    can_id, value, words
):
    codec, report = robstride(), Report()
    fault = Frame(can_id, bytes.fromhex(value + "00000000"), extended=True)
    stopped = Frame(0x02007FFD, bytes.fromhex("7FFF7FFF7FFF0138"), extended=True)
    assert codec.take(stopped, report) is Taken.MEASURED
    assert report.state is DriveState.OFF
    assert codec.take(fault, report) is Taken.STATE
    assert report.state is DriveState.FAULT
    assert codec.take(stopped, report) is Taken.MEASURED
    assert report.state is DriveState.FAULT, "an answer has no bit for this fault"
    assert words in report.complaint
    codec.opening()
    codec.take(stopped, report)
    assert (report.state, report.complaint) == (DriveState.OFF, "")


def test_a_typed_motor_s_warning_is_no_fault_and_half_a_fault_message_is_refused():
    codec, report = robstride(), Report()
    warning = Frame(0x1500FD7F, bytes.fromhex("0000000001000000"), extended=True)
    assert codec.take(warning, report) is Taken.STATE
    assert report.complaint == ""
    half = Frame(0x1500FD7F, bytes.fromhex("01000000"), extended=True)
    assert codec.take(half, report) is Taken.REFUSED
    assert report.refusal == "wrong_length"
    other = Frame(0x1500FD7E, bytes.fromhex("0100000000000000"), extended=True)
    assert codec.take(other, report) is Taken.OTHER


def test_moteus_reads_the_example_of_its_documentation():
    found = registers(bytes.fromhex("2404000a005000000170ff230d181400"))
    assert found == {0: 10, 1: 80, 2: 256, 3: -144, 0xD: 24, 0xE: 20, 0xF: 0}


def moteus():
    return MoteusCodec(1, 2.0, 50.0, 0.05)


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


VESC = 23


def vesc():
    return VescCodec(VESC, VescMotor(7, 4.0, 0.06, 60.0, 85.0))


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
