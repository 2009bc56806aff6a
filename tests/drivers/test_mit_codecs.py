"""Motors in MIT mode byte by byte, against the bits of their manuals."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from makers_codecs import damiao, robstride

from teleop_rt_drivers.actuators.codec import DriveState, Frame, Report, Taken


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
