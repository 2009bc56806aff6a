"""Packets of servos on serial lines, against encoders that share nothing with ours."""

from __future__ import annotations

import random
import struct

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from teleop_rt_drivers.actuators.codec import DriveState, Frame, Report, Taken
from teleop_rt_drivers.actuators.dynamixel import DynamixelCodec, ServoLimits, packet
from teleop_rt_drivers.actuators.feetech import FeetechCodec
from teleop_rt_drivers.actuators.feetech import packet as feetech_packet
from teleop_rt_drivers.actuators.wire import LineWire
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.simulated.pipes import pipe

ID = 7


def division(data: bytes) -> bytes:
    """The CRC of protocol 2 as the remainder of a division of polynomials, low byte first."""
    number, divisor = int.from_bytes(data, "big") << 16, 0b1_1000_0000_0000_0101
    while number.bit_length() > 16:
        number ^= divisor << number.bit_length() - 17
    return number.to_bytes(2, "little")


def dynamixel_said(whom: int, body: list[int]) -> bytes:
    """A packet of protocol 2, stuffed byte by byte as its manual describes."""
    stuffed: list[int] = []
    for byte in body:
        stuffed.append(byte)
        if stuffed[-3:] == [0xFF, 0xFF, 0xFD]:
            stuffed.append(0xFD)
    size = len(stuffed) + 2
    head = bytes([0xFF, 0xFF, 0xFD, 0x00, whom, size % 256, size // 256, *stuffed])
    return head + division(head)


def feetech_said(whom: int, body: list[int]) -> bytes:
    """A packet of Feetech's protocol: the sum of all but the header, and it, is 255."""
    content = [whom, len(body) + 1, *body]
    return bytes([0xFF, 0xFF, *content, (255 - sum(content)) % 256])


def dynamixel() -> DynamixelCodec:
    return DynamixelCodec(ID, 2.0, ServoLimits(2.0, 3.0, 0.00269, 60))


def feetech() -> FeetechCodec:
    return FeetechCodec(ID, 2.0, 2.0, 0.8)


@pytest.mark.parametrize(
    ("whom", "instruction", "parameters", "printed"),
    [
        (1, 0x01, "", "FFFFFD00 01 0300 01 194E"),
        (1, 0x02, "84000400", "FFFFFD00 01 0700 02 84000400 1D15"),
        (1, 0x03, "740000020000", "FFFFFD00 01 0900 03 740000020000 CA89"),
        (0xFE, 0x82, "840004000102", "FFFFFD00 FE 0900 82 840004000102 CEFA"),
        (0xFE, 0x83, "74000400019600000002AA000000",
         "FFFFFD00 FE 1100 83 74000400 0196000000 02AA000000 8287"),
    ],
)  # fmt: skip
def test_packets_are_those_that_the_manual_of_protocol_2_prints(
    whom, instruction, parameters, printed
):
    expected = bytes.fromhex(printed)
    assert packet(whom, instruction, bytes.fromhex(parameters)) == expected
    assert dynamixel_said(whom, [instruction, *bytes.fromhex(parameters)]) == expected


def test_a_packet_is_that_which_the_manual_of_feetech_prints():
    # Read two bytes from 38h of servo 1.
    assert feetech_packet(1, 2, b"\x38\x02") == bytes.fromhex("FFFF 01 04 02 38 02 BE")


@given(st.floats(-300, 300))
def test_dynamixel_goals_are_sync_writes_of_counts_and_the_question_follows(position):
    goal, ask = dynamixel().follow(position, 0.0)
    counts = max(-1_048_575, min(1_048_575, round(position * 4096)))
    written = list(counts.to_bytes(4, "little", signed=True))
    assert goal.data == dynamixel_said(0xFE, [0x83, 116, 0, 4, 0, ID, *written])
    assert ask.data == dynamixel_said(0xFE, [0x82, 224, 0, 14, 0, ID])


def test_a_dynamixel_is_set_up_by_its_control_table():
    def written(register, *content):
        return dynamixel_said(0xFE, [0x83, register, 0, len(content), 0, ID, *content])

    side_by_side = [11, 64, 70, 98, 126, 127, *range(128, 136)]
    words = [byte for address in side_by_side for byte in (address, 0)]
    rpm = round(2.0 * 60 / 0.229)
    assert [frame.data for frame in dynamixel().opening()] == [
        written(64, 0),
        written(98, 0),
        written(68, 1),
        written(11, 5),
        written(102, *divmod(round(3.0 / 0.00269), 256)[::-1]),
        written(108, 0, 0, 0, 0, rpm % 256, rpm // 256, 0, 0),
        written(168, *words),
        written(98, 3),
    ]
    goal, torque, _ = dynamixel().enable(0.25)
    assert goal.data == written(116, 0, 4, 0, 0)
    assert torque.data == written(64, 1)
    assert dynamixel().disable()[0].data == written(64, 0)


def answer(position=0, velocity=0, current=0, *, mode=5, torque=1, error=0, watchdog=3, alert=0):
    registers = struct.pack("<BBBbhii", mode, torque, error, watchdog, current, velocity, position)
    return dynamixel_said(ID, [0x55, alert, *registers])


COUNTS = st.integers(-(2**31), 2**31 - 1)


@given(COUNTS, COUNTS, st.integers(-(2**15), 2**15 - 1))
@example(0, -3, -1)  # FFh FFh FDh in the middle: stuffed
@example(-3, -1, -1)
def test_dynamixel_answers_are_read_stuffed_or_not(position, velocity, current):
    codec, report = dynamixel(), Report()
    said = answer(position, velocity, current)
    assert codec.sound(said)
    assert codec.size(bytearray(said)) == len(said) <= codec.longest
    assert codec.take(Frame(0, said), report) is Taken.MEASURED
    assert report.position == position / 4096
    assert report.velocity == pytest.approx(velocity * 0.229 / 60)
    assert report.torque == pytest.approx(2.0 * 0.00269 * current)


@pytest.mark.parametrize(
    ("fields", "state", "words"),
    [
        ({"torque": 0}, DriveState.OFF, ""),
        ({}, DriveState.FOLLOWING, ""),
        ({"torque": 0, "error": 4, "alert": 0x80}, DriveState.FAULT, "over-temperature"),
        ({"error": 0x21}, DriveState.FAULT, "input voltage, overload"),
        ({"watchdog": -1}, DriveState.FAULT, "bus watchdog"),
        ({"watchdog": 0}, DriveState.FAULT, "not set up"),
        ({"mode": 3}, DriveState.FAULT, "not set up"),
        ({"alert": 0x80}, DriveState.FAULT, "without a cause"),
    ],
)
def test_dynamixel_answers_contain_state_and_errors(fields, state, words):
    report = Report()
    assert dynamixel().take(Frame(0, answer(**fields)), report) is Taken.MEASURED
    assert report.state is state
    assert words in report.complaint
    assert bool(report.complaint) is (state is DriveState.FAULT)


def test_a_dynamixel_that_refuses_an_instruction_gives_no_position():
    report = Report()
    assert dynamixel().take(Frame(0, answer(100, alert=4)), report) is Taken.REFUSED
    assert (report.refusal, report.position) == ("bad_status", 0.0)


@given(st.floats(-10, 10))
def test_feetech_goals_carry_sign_and_largest_speed(position):
    goal, ask = feetech().follow(position, 0.0)
    counts = max(-32767, min(32767, round(position * 4096)))
    low, high = abs(counts) % 256, abs(counts) // 256 + (128 if counts < 0 else 0)
    speed = 2 * 4096
    body = [0x83, 41, 7, ID, 0, low, high, 0, 0, speed % 256, speed // 256]
    assert goal.data == feetech_said(0xFE, body)
    assert ask.data == feetech_said(0xFE, [0x82, 40, 31, ID])
    off, limit = feetech().opening()
    assert off.data == feetech_said(0xFE, [0x83, 40, 1, ID, 0])
    assert limit.data == feetech_said(0xFE, [0x83, 48, 2, ID, 800 % 256, 800 // 256])


def table(torque=1, position=0, speed=0, load=0, status=0, current=0) -> list[int]:
    """Registers 40 to 70 by the places that the memory table gives them."""
    registers = dict.fromkeys(range(40, 71), 0) | {40: torque, 65: status}
    for place, value in ((56, position), (58, speed), (60, load), (69, current)):
        registers[place], registers[place + 1] = value % 256, value // 256
    return list(registers.values())


def with_sign(value: int, bit: int) -> int:
    return abs(value) + (2**bit if value < 0 else 0)


SMALL = st.integers(-32767, 32767)


@given(SMALL, SMALL, st.integers(0, 2047), st.booleans(), st.integers(0, 1))
def test_feetech_answers_are_read_with_their_signs(position, speed, current, back, torque):
    codec, report = feetech(), Report()
    registers = table(
        torque, with_sign(position, 15), with_sign(speed, 15), 1024 * back, 0, current
    )
    said = feetech_said(ID, [0, *registers])
    assert codec.sound(said)
    assert codec.size(bytearray(said)) == len(said)
    assert codec.take(Frame(0, said), report) is Taken.MEASURED
    assert (report.position, report.velocity) == (position / 4096, speed / 4096)
    assert report.torque == pytest.approx((-1 if back else 1) * 2.0 * 0.0065 * current)
    assert report.state is (DriveState.FOLLOWING if torque else DriveState.OFF)


@pytest.mark.parametrize(("error", "status"), [(4, 0), (0, 4), (0x24, 0)])
def test_feetech_errors_stand_in_the_packet_or_in_the_table(error, status):
    report = Report()
    said = feetech_said(ID, [error, *table(status=status)])
    assert feetech().take(Frame(0, said), report) is Taken.MEASURED
    assert report.state is DriveState.FAULT
    assert "over-temperature" in report.complaint


KINDS = {
    "dynamixel": (dynamixel, answer(-3, -3, -1), lambda p: division(p[:-2]) == p[-2:]),
    "feetech": (feetech, feetech_said(ID, [0, *table(position=255)]),
                lambda p: sum(p[2:]) % 256 == 255),
}  # fmt: skip


def heard(kind: str, data: bytes, chunks: int = 1) -> tuple[list[bytes], dict[str, int]]:
    """The frames that a line passes on of bytes that arrive in so many pieces."""
    counters, ends = FramedCounters(), pipe()
    wire = LineWire(KINDS[kind][0](), lambda: ends[0], counters, 10**6)
    found: list[bytes] = []
    wire.open(lambda frame, _: found.append(frame.data))
    for place in range(chunks):
        begin, end = len(data) * place // chunks, len(data) * (place + 1) // chunks
        ends[1].write(data[begin:end])
        wire.drain(place)
    return found, counters


@settings(max_examples=60)
@given(st.sampled_from(list(KINDS)), st.binary(max_size=40), st.integers(1, 9))
def test_packets_are_found_in_any_pieces_behind_anything(kind, garbage, chunks):
    said = KINDS[kind][1]
    found, _ = heard(kind, garbage + said * 4, chunks)
    # The garbage before may pass for the beginning of a packet and swallow a few.
    assert found[-1:] == [said]
    assert set(found) == {said}


@pytest.mark.parametrize("kind", list(KINDS))
def test_every_mutated_packet_is_refused_unless_another_checksum_says_that_it_is_whole(kind):
    rng = random.Random(11)  # noqa: S311 - reproducible
    _, said, is_whole = KINDS[kind]
    passed = 0
    for _ in range(3000):
        spoilt = bytearray(said)
        for _ in range(rng.randint(1, 3)):
            spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
        found, _ = heard(kind, bytes(spoilt))
        if bytes(spoilt) == said:
            continue
        assert all(is_whole(one) for one in found)
        passed += bool(found)
    # A CRC of 16 bits finds any three flipped bits; of a sum of 8 bits two may cancel.
    assert passed == 0 if kind == "dynamixel" else passed < 3000 / 20


@settings(max_examples=100)
@given(st.sampled_from(list(KINDS)), st.binary(max_size=60))
def test_no_content_raises_and_what_is_refused_changes_nothing(kind, content):
    made = {"dynamixel": dynamixel_said, "feetech": feetech_said}[kind]
    codec, report = KINDS[kind][0](), Report()
    for whom in (ID, ID + 1, 0xFE):
        for body in ([0x55, *content], [0, *content]):
            before = (report.position, report.velocity, report.torque, report.state)
            taken = codec.take(Frame(0, made(whom, body)), report)
            after = (report.position, report.velocity, report.torque, report.state)
            assert taken is Taken.MEASURED or after == before


@pytest.mark.parametrize("kind", list(KINDS))
def test_an_echo_of_our_own_is_no_answer_and_another_s_order_is_a_second_master(kind):
    codec, ends = KINDS[kind][0](), pipe()
    wire, report = LineWire(codec, lambda: ends[0], FramedCounters(), 10**6), Report()
    taken: list[Taken] = []
    wire.open(lambda frame, _: taken.append(codec.take(frame, report)))
    assert wire.order(codec.follow(0.1, 0.0), 0)
    echo = ends[1].read()
    ends[1].write(echo)
    wire.drain(10)
    assert taken == []
    assert not wire.order(codec.follow(0.2, 0.0), 900_000), "the drive may be answering"
    ends[1].write(KINDS[kind][1])
    wire.drain(20)
    assert taken == [Taken.MEASURED]
    assert wire.order(codec.follow(0.2, 0.0), 900_000)
    ends[1].write(codec.follow(0.3, 0.0)[0].data)
    wire.drain(30)
    assert taken[1:] == [Taken.FOREIGN]


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_line_that_was_not_answered_is_free_again_after_its_turn(kind):
    codec, ends = KINDS[kind][0](), pipe()
    counters = FramedCounters()
    wire = LineWire(codec, lambda: ends[0], counters, 1_000_000)
    wire.open(lambda frame, _: None)
    sent = [wire.order(codec.disable(), now_ns) for now_ns in (0, 500_000, 1_000_000, 1_900_000)]
    assert sent == [True, False, True, False]
    assert counters["line_busy"] == 2
