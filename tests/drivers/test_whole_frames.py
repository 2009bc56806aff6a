"""Kernels take from a stream, and write into a frame, exactly as the parser and the packer do."""

from __future__ import annotations

import math
import os
import random
import struct
import tty

import pytest

from teleop_rt.axis import AxisFault
from teleop_rt_drivers.framed import taking
from teleop_rt_drivers.framed.binary import BinaryPacker, BinaryParser, binary_fields
from teleop_rt_drivers.framed.checksum import KINDS, checksum
from teleop_rt_drivers.framed.config import SerialPortConfig
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.framed.format import SIZE, BinaryFormat, load_format
from teleop_rt_drivers.framed.remainder import check_of, new_check
from teleop_rt_drivers.framed.serial_port import SerialPort
from teleop_rt_drivers.framed.signal import MeasuredSignal
from teleop_rt_drivers.framed.signal_config import ClockConfig, PositionSignal, StatusConfig
from teleop_rt_drivers.framed.source import Source
from teleop_rt_drivers.framed.stream import DescriptorStream, StreamGoneError
from teleop_rt_drivers.quantity import Plausible, Scale

MS = 1_000_000
TYPES = ("u8", "i8", "u16", "i16", "u24", "i24", "u32", "i32", "f32", "f64")
SCALE, PLAUSIBLE = Scale(2.0, -1, 0.5), Plausible(-1e4, 1e4, 1e9, 1e3)


def every_type(order: str, **more: object) -> BinaryFormat:
    """A format with a field of each type, its count, status and time."""
    fields = tuple({"name": kind, "type": kind} for kind in TYPES)
    whole = {"kind": "binary", "sync": "A5 5A", "byte_order": order, "fields": fields}
    return BinaryFormat.model_validate(whole | {"counter": "u8"} | more)


def with_checksum(kind: str, order: str) -> BinaryFormat:
    return every_type(order, checksum={"kind": kind}, end="0D 0A")


FORMATS = {
    **{
        f"{kind} {order}": with_checksum(kind, order)
        for kind in KINDS
        for order in ("little", "big")
    },
    "no checksum": every_type("big"),
    "no counter": every_type("little", counter=None, checksum={"kind": "crc8", "span": (1, 9)}),
}


class Listener:
    """A parser with a value, by kernels or without, and all its results."""

    def __init__(self, format_: BinaryFormat, *, kernels: bool) -> None:
        source = Source("device", binary_fields(format_))
        self.heard: list[tuple[list[float], int]] = []
        self.counters = FramedCounters()
        config = PositionSignal(
            source="device", field="i16", status=StatusConfig(field="i8", good=0),
            clock=ClockConfig(field="u16", tick_s=1e-6, bits=16),
        )  # fmt: skip
        self.parser = BinaryParser(format_, source, self.counters)
        self.signal = MeasuredSignal("position", config, source, SCALE, PLAUSIBLE, self.counters)
        self.signal.reset(0)
        source.listen(lambda values, now_ns: self.heard.append(([*map(float, values)], now_ns)))
        self.parser.reset()
        # By which way a frame came shows nowhere else: the values are the same.
        assert self.parser._whole is not None
        if not kernels:
            self.parser._whole = self.parser.read = None

    def news(self) -> tuple[object, ...]:
        """Return the frames heard since the last call, and the results of all."""
        signal, heard = self.signal, repr(self.heard)
        self.heard.clear()
        stamps = signal.stamp_ns, signal.device_stamp_ns
        return heard, dict(self.counters), signal.value, *stamps, signal.known


def random_values(rng: random.Random, format_: BinaryFormat) -> list[float]:
    """Values that are mostly good: the status is 0, the time goes on, the count does by itself."""
    values: list[float] = []
    for field in format_.fields:
        bits = 8 * SIZE[field.type]
        if field.type[0] == "f":
            values.append(rng.choice([rng.uniform(-1e9, 1e9), math.inf, -math.inf, 0.1]))
        elif field.type == "i8":
            values.append(rng.choice([0, 0, 0, 3]))
        else:
            low = -(1 << bits - 1) if field.type[0] == "i" else 0
            values.append(rng.randint(low, low + (1 << bits) - 1))
    return values


def spoilt(rng: random.Random, frame: bytes) -> bytes:
    """A frame after its line: mostly as it was, else with a wrong bit, in part, or twice."""
    kind = rng.randrange(12)
    if kind == 0:
        wrong = bytearray(frame)
        wrong[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
        return bytes(wrong)
    if kind == 1:
        return frame[: rng.randrange(len(frame))]
    return {2: frame + frame, 3: b"\xa5" + frame, 4: b""}.get(kind, frame)


@pytest.mark.parametrize("name", FORMATS)
def test_kernels_hear_what_the_parser_hears(name):
    format_ = FORMATS[name]
    rng, packer = random.Random(name), BinaryPacker(format_)  # noqa: S311 - reproducible
    both = [Listener(format_, kernels=True), Listener(format_, kernels=False)]
    left: list[bytes] = []
    find = both[0].parser._find
    both[0].parser._find = lambda data, now_ns: (left.append(data), find(data, now_ns))[1]
    for cycle in range(400):
        data = spoilt(rng, packer.pack(random_values(rng, format_)))
        for one in both:
            one.parser.feed(data, cycle * MS)
            one.signal.settle(cycle * MS)
        assert both[0].news() == both[1].news()
    assert 100 < len(left) < 250  # the rest was taken by kernels
    counts = both[0].counters
    assert counts["bad_status"] > 10
    assert counts["out_of_range"] > 10
    assert not counts["impossible_jump"]


@pytest.mark.parametrize("word", [0x7FC00000, 0x7F800000, 0xFF800000])
def test_a_value_that_is_no_number_is_refused_by_kernels(word):
    format_ = load_format("wrench_crc16")
    source, counters = Source("wrench", binary_fields(format_)), FramedCounters()
    parser = BinaryParser(format_, source, counters)
    config = PositionSignal(source="wrench", field="fz")
    signal = MeasuredSignal("force", config, source, SCALE, PLAUSIBLE, counters)
    parser.reset()
    body = struct.pack("<H6IIf", 0, 0, 0, word, 0, 0, 0, 7, 0.0)
    parser.feed(b"\xaa" + body + struct.pack("<H", checksum("crc16-x25")[0](body)), MS)
    assert not signal.settle(MS)
    assert (counters["frames"], counters["not_a_number"]) == (1, 1)


@pytest.mark.parametrize("kind", KINDS)
def test_kernels_compute_the_same_checksums(kind):
    rng, (check, table) = random.Random(kind), new_check(kind)  # noqa: S311 - reproducible
    for length in range(40):
        data = rng.randbytes(length + 6)
        assert check_of(check, table, data, 3, 3 + length) == checksum(kind)[0](data[3:-3])


@pytest.mark.parametrize("name", FORMATS)
def test_kernels_write_what_the_packer_writes(name):
    format_ = FORMATS[name]
    rng = random.Random(name)  # noqa: S311 - reproducible
    both = [BinaryPacker(format_), BinaryPacker(format_)]
    both[1].writer = None
    for _ in range(300):
        values = [one * rng.choice([1, 1, 1.5, -0.5, 300]) for one in random_values(rng, format_)]
        values[TYPES.index("f32")] = rng.choice([0.1, math.inf, -3e38, math.nan])
        assert both[0].pack(values) == both[1].pack(values)


def test_a_value_without_a_word_is_refused_as_ever():
    packer = BinaryPacker(FORMATS["no checksum"])
    no_number, too_large = [0.0] * len(TYPES), [0.0] * len(TYPES)
    no_number[TYPES.index("i16")], too_large[TYPES.index("f32")] = math.nan, 1e39
    with pytest.raises(ValueError, match="NaN"):
        packer.pack(no_number)
    with pytest.raises(OverflowError):
        packer.pack(too_large)


def test_numbers_of_64_bits_are_left_to_the_parser():
    fields = ({"name": "t", "type": "u64"},)
    format_ = BinaryFormat.model_validate({"kind": "binary", "sync": "A5", "fields": fields})
    heard: list[int] = []
    source = Source("device", binary_fields(format_))
    source.listen(lambda values, _: heard.append(values[0]))
    parser, packer = BinaryParser(format_, source, FramedCounters()), BinaryPacker(format_)
    parser.reset()
    parser.feed(packer.pack([2**64 - 1]), 0)
    assert heard == [2**64 - 1]


def received(parser: BinaryParser, descriptor: int, empty_ns: int = 0, now_ns: int = MS) -> int:
    """Return how many bytes a parser reads and takes."""
    assert parser.read is not None
    return parser.take_read(parser.read(descriptor, False, empty_ns, now_ns))  # noqa: FBT003


def test_a_line_is_read_until_it_is_gone():
    format_ = FORMATS["crc8 big"]
    listener, packer = Listener(format_, kernels=True), BinaryPacker(format_)
    near, far = os.pipe()
    os.set_blocking(near, False)
    try:
        frames = [packer.pack([0.0] * len(TYPES)) for _ in range(3)]
        assert received(listener.parser, near) == 0
        os.write(far, frames[0])
        assert received(listener.parser, near) == len(frames[0])
        os.write(far, frames[1] + frames[2][:5])
        assert received(listener.parser, near) == len(frames[0]) + 5
        assert listener.parser.read is None  # the parser holds the frame that has begun
        listener.parser.feed(frames[2][5:], MS)
        assert listener.counters["frames"] == 3
        assert listener.counters["gaps"] == 0
    finally:
        os.close(far)
    with pytest.raises(StreamGoneError, match="Broken pipe"):
        received(listener.parser, near)
    os.close(near)
    with pytest.raises(StreamGoneError, match="Bad file descriptor"):
        received(listener.parser, near)


@pytest.mark.parametrize("empty_ns", [0, 3 * MS])
def test_what_is_read_arrived_half_way_since_the_line_was_empty_if_it_is_watched(empty_ns):
    format_ = FORMATS["crc8 big"]
    listener, packer = Listener(format_, kernels=True), BinaryPacker(format_)
    near, far = os.pipe()
    os.set_blocking(near, False)
    os.write(far, packer.pack([0.0] * len(TYPES)))
    received(listener.parser, near, empty_ns, 5 * MS)
    assert [arrived_ns for _, arrived_ns in listener.heard] == [4 * MS if empty_ns else 5 * MS]
    listener.signal.settle(5 * MS)
    assert listener.signal.stamp_ns == listener.heard[0][1]
    os.close(near)
    os.close(far)


@pytest.mark.parametrize("held", [0, 3])
def test_a_value_is_too_old_beyond_its_hold_time_and_silent_beyond_its_timeout(held):
    values = taking.new_values(1)
    value = values[0]
    value.candidate = math.nan
    value.held_ns, value.timeout_ns, value.slack = held, 5, math.inf
    assert taking.settle(values, 0) == taking.TOO_OLD, "never known"
    value.candidate, value.candidate_ns = 1.0, 10
    assert taking.settle(values, 10) == taking.NEW
    assert not taking.settle(values, 10 + held) & taking.TOO_OLD
    assert taking.settle(values, 11 + held) & taking.TOO_OLD
    assert not taking.settle(values, 15) & taking.SILENT
    assert taking.settle(values, 16) & taking.SILENT
    value.watched_ns = 11
    assert not taking.settle(values, 16) & taking.SILENT, "counted from the beginning of the watch"


def test_a_command_goes_to_its_line_until_that_is_full_or_gone():
    config = SerialPortConfig(
        device="drive", baud=921600, format="position_drive_answer",
        command_format="position_drive_command",
    )  # fmt: skip
    far, near = os.openpty()
    tty.setraw(near)
    os.set_blocking(near, False)
    counters = FramedCounters()
    port = SerialPort("drive", config, lambda: DescriptorStream(near), counters)
    packer = BinaryPacker(load_format("position_drive_command"))
    port.open()
    for target in (3.0, -7.6):
        port.send("drive", [0.0, 1.0, target])
        wanted = packer.pack([0.0, 1.0, target])
        assert os.read(far, 64) == wanted
    with pytest.raises(ValueError, match="NaN"):
        port.send("drive", [0.0, 1.0, math.nan])
    assert counters["send_failed"] == 0
    for _ in range(100_000):
        port.send("drive", [0.0, 1.0, 0.0])
        if counters["send_failed"]:
            break
    assert counters["send_failed"] == 1
    assert port.fault is AxisFault.NONE
    os.close(far)
    port.send("drive", [0.0, 1.0, 0.0])
    assert port.fault is AxisFault.UNPLUGGED
    port.close()
