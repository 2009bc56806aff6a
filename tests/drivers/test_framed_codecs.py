from __future__ import annotations

import math
import struct
from pathlib import Path

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teleop_rt.axis import AxisError
from teleop_rt_drivers.framed.binary import BinaryPacker, BinaryParser, binary_fields
from teleop_rt_drivers.framed.checksum import KINDS, checksum
from teleop_rt_drivers.framed.config import MessageChecks, MessageChecksum
from teleop_rt_drivers.framed.counters import EVENTS, REASONS, FramedCounters
from teleop_rt_drivers.framed.dbc import DbcMessage, load_dbc
from teleop_rt_drivers.framed.format import BinaryFormat, load_format
from teleop_rt_drivers.framed.source import Source
from teleop_rt_drivers.framed.text import TextParser, text_fields
from teleop_rt_drivers.simulated import frame_devices

CHECK_VALUES = {
    "sum8": 0xDD,
    "xor8": 0x31,
    "crc8": 0xF4,
    "crc8-j1850": 0x4B,
    "crc16-x25": 0x906E,
    "crc16-ccitt": 0x29B1,
    "crc16-modbus": 0x4B37,
    "crc32": 0xCBF43926,
}


@pytest.mark.parametrize("kind", KINDS)
def test_checksums_have_the_published_check_values(kind):
    function, size = checksum(kind)
    assert function(b"123456789") == CHECK_VALUES[kind]
    assert size == {"crc16": 2, "crc32": 4}.get(kind.split("-")[0], 1)


@given(st.binary(max_size=64))
def test_the_fast_crc_is_that_of_the_definition(data):
    assert checksum("crc16-x25")[0](data) == frame_devices.crc16_x25(data)
    assert checksum("crc8")[0](data) == frame_devices.crc8(data)


class Heard:
    """A parser of a shipped format, and its values."""

    def __init__(self, name: str) -> None:
        frame = load_format(name)
        self.counters = FramedCounters()
        self.values: list[tuple[float, ...]] = []
        if isinstance(frame, BinaryFormat):
            source = Source(name, binary_fields(frame))
            self.parser = BinaryParser(frame, source, self.counters)
        else:
            source = Source(name, text_fields(frame))
            self.parser = TextParser(frame, source, self.counters)
        source.listen(lambda values, _: self.values.append(tuple(values)))

    def feed(self, data: bytes) -> Heard:
        self.parser.feed(data, 0)
        return self


def wrench_frame(force: float, stamp: int = 1) -> bytes:
    body = struct.pack("<H6fIf", 0, 0, 0, force, 0, 0, 0, stamp, 20.0)
    return b"\xaa" + body + struct.pack("<H", frame_devices.crc16_x25(body))


def test_the_wrench_frame_is_37_bytes_and_its_fields_are_in_order():
    assert load_format("wrench_crc16").size == 37
    heard = Heard("wrench_crc16").feed(wrench_frame(3.5, stamp=0xAABBCCDD))
    assert heard.values == [(0, 0, 0, 3.5, 0, 0, 0, 0xAABBCCDD, 20.0)]


@settings(max_examples=60)
@given(st.lists(st.integers(1, 50), min_size=1, max_size=40), st.integers(0, 2**32 - 1))
def test_frames_are_found_however_the_stream_is_cut(cuts, stamp):
    stream = b"".join(wrench_frame(k, stamp) for k in range(20))
    heard = Heard("wrench_crc16")
    at = 0
    while at < len(stream):
        step = cuts[at % len(cuts)]
        heard.feed(stream[at : at + step])
        at += step
    assert [values[3] for values in heard.values] == list(range(20))
    assert heard.counters["bad_checksum"] == 0


def test_after_a_bad_checksum_the_next_frame_is_found_even_inside_the_bad_one():
    good = wrench_frame(7.0)
    spoilt = bytearray(wrench_frame(1.0))
    spoilt[20] ^= 0x10
    # A false start: a sync byte, and the whole good frame within the length of the false one.
    heard = Heard("wrench_crc16").feed(bytes(spoilt) + b"\xaa\x01" + good + good)
    assert [values[3] for values in heard.values] == [7.0, 7.0]
    assert heard.counters["bad_checksum"] >= 2
    assert heard.counters["skipped_bytes"] == len(spoilt) + 2


def test_whole_numbers_between_0x55_and_0xaa_are_divided():
    body = struct.pack(">hh", -1234, 567)
    heard = Heard("counts_55aa").feed(b"\x55" + body + bytes((sum(body) & 0xFF, 0xAA)))
    assert heard.values == [(-1234, 567)]
    source = Source("s", binary_fields(load_format("counts_55aa")))
    assert source.scale("fz", "N", None, 1, 0.0, "key").value(-1234) == pytest.approx(-12.34)
    assert source.scale("fz", "N", 2.0, -1, 1.0, "key").value(-1234) == pytest.approx(25.68)
    heard.feed(b"\x55" + body + bytes((sum(body) & 0xFF, 0xAB)))
    assert heard.counters["bad_end"] == 1


def test_numbers_of_24_bits_keep_their_sign_and_their_bytes():
    body = bytes((7, 0xFF, 0xFF, 0xFE, 0))
    frame = b"\xa5\x5a" + body + bytes((frame_devices.crc8(body),))
    assert Heard("converter_24bit").feed(frame).values == [(7, -2, 0)]
    packer = BinaryPacker(load_format("converter_24bit"))
    assert packer.pack([0, -2, 0])[3:6] == b"\xff\xff\xfe"
    largest = Heard("converter_24bit").feed(packer.pack([0, 9e9, 0]))
    assert largest.values == [(1, 2**23 - 1, 0)]
    source = Source("s", binary_fields(load_format("converter_24bit")))
    assert source.scale("force", "N", None, 1, 0.0, "key").value(-50_000) == pytest.approx(-10.0)


def test_unsigned_little_endian_24_bits_are_read_in_their_order(tmp_path):
    text = (FORMAT.parent / "converter_24bit.yaml").read_text()
    path = tmp_path / "little.yaml"
    path.write_text(text.replace("i24", "u24").replace("big", "little"))
    body = bytes((1, 0xFE, 0xFF, 0xFF, 0))
    frame = b"\xa5\x5a" + body + bytes((frame_devices.crc8(body),))
    assert Heard(str(path)).feed(frame).values == [(1, 2**24 - 2, 0)]


def test_text_lines_are_matched_whole_and_others_counted():
    heard = Heard("load_cell_text")
    heard.feed(b"45 kg\r\n+1.2345 kg\r\n-0.5000 kg\r\n")
    heard.feed(b"+1.2 lb\r\nERR\r\n+1.0000 kg and more\r\n+2.0")
    assert heard.values == [(1.2345,), (-0.5,)]
    assert heard.counters["no_match"] == 3
    heard.feed(b"000 kg\n")
    assert heard.values[-1] == (2.0,)
    heard.feed(b"9" * 200).feed(b"9 kg\n+3.0000 kg\n")
    assert heard.counters["too_long"] == 1
    assert heard.values[-1] == (3.0,)


def test_a_repeated_counter_is_rejected_and_a_gap_counted():
    def frame(sequence):
        body = struct.pack("<BiI", sequence, 5, 0)
        return b"\x51" + body + struct.pack("<H", frame_devices.crc16_x25(body))

    heard = Heard("quadrature_counter").feed(frame(254) + frame(255) + frame(0) + frame(0))
    assert len(heard.values) == 3
    assert heard.counters["repeated"] == 1
    assert heard.counters["gaps"] == 0
    heard.feed(frame(3))
    assert heard.counters["gaps"] == 1


@given(st.integers(0, 2), st.floats(-3e9, 3e9))
def test_packed_commands_are_read_back_by_the_device(control, target):
    packer = BinaryPacker(load_format("position_drive_command"))
    data = packer.pack([0, control, target]) + packer.pack([0, control, 0.4])
    kept = min(max(target, -(2**31)), 2**31 - 1)
    assert frame_devices.drive_commands(data) == [(control, round(kept)), (control, 0)]
    assert (data[1], data[10]) == (0, 1)


DBC = """VERSION ""
BU_: A
BO_ 2364540158 MIXED: 8 A
 SG_ INTEL : 3|13@1- (0.5,-2) [0|0] "N" A
 SG_ MOTOROLA : 23|11@0- (0.25,3) [0|0] "m" A
 SG_ REAL : 32|32@1- (1,0) [0|0] "s" A
BO_ 5 BIG: 8 A
 SG_ FIRST : 7|20@0+ (1,0) [0|0] "" A
 SG_ SECOND : 19|12@0- (1,0) [0|0] "" A
 SG_ BYTE : 63|8@0+ (1,0) [0|0] "" A
SIG_VALTYPE_ 2364540158 REAL : 1;
"""


@pytest.fixture(scope="module")
def dbc(tmp_path_factory):
    path = tmp_path_factory.mktemp("dbc") / "odd.dbc"
    path.write_text(DBC)
    return path


@pytest.mark.parametrize("name", ["MIXED", "BIG"])
def test_compiled_messages_agree_with_cantools(dbc, name):
    oracle = cantools.database.load_file(dbc).get_message_by_name(name)
    compiled = DbcMessage(load_dbc(str(dbc))[name], None, FramedCounters())
    heard = []
    compiled.source.listen(lambda values, _: heard.append(values))
    random = np.random.default_rng(1)
    for _ in range(300):
        data = random.bytes(8)
        compiled.receive(data, 0)
        expected = oracle.decode(data, scaling=False)
        values = dict(zip((f.name for f in compiled.source.fields), heard[-1], strict=True))
        assert all(
            values[key] == value or (math.isnan(value) and math.isnan(values[key]))
            for key, value in expected.items()
        )
        if not any(map(math.isnan, expected.values())):
            assert compiled.pack(heard[-1]) == oracle.encode(expected, scaling=False, strict=False)
    assert compiled.source.scale("INTEL" if name == "MIXED" else "BYTE", "N", 1.0, 1, 0.0, "k")


def test_scale_and_offset_of_a_dbc_signal_reach_the_rigs_unit(dbc):
    source = DbcMessage(load_dbc(str(dbc))["MIXED"], None, FramedCounters()).source
    assert source.scale("INTEL", "N", None, 1, 0.0, "k").value(10) == pytest.approx(3.0)
    assert source.scale("INTEL", "N", 2.0, -1, 1.0, "k").value(10) == pytest.approx(-5.0)


def test_checksum_and_counter_of_a_big_endian_message(dbc):
    checks = MessageChecks(checksum=MessageChecksum(signal="BYTE", kind="crc8-j1850"))
    counters = FramedCounters()
    message = DbcMessage(load_dbc(str(dbc))["BIG"], checks, counters)
    heard = []
    message.source.listen(lambda values, _: heard.append(values))
    data = message.pack([1000, -5, 0])
    assert data[7] == checksum("crc8-j1850")[0](data[:7])
    message.receive(data, 0)
    assert heard == [[1000, -5, data[7]]]
    for byte in range(8):
        message.receive(data[:byte] + bytes((data[byte] ^ 1,)) + data[byte + 1 :], 0)
    assert len(heard) == 1
    assert counters["bad_checksum"] == 8


FORMAT = Path(str(load_format.__code__.co_filename)).parents[1] / "formats" / "counts_55aa.yaml"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("kind: binary", "kind: binaries", r":3: kind: 'binaries': write binary or text"),
        ('sync: "55"', 'sync: "5G"', r":4: sync: write bytes as hexadecimal"),
        ("type: i16, divisor: 100,", "type: i20, divisor: 100,", r":8: fields.0.type: "),
        ("divisor: 100,", "divisor: 0,", r":8: fields.0: scale and divisor must not be 0"),
        (
            "divisor: 100,",
            "divider: 100,",
            r":8: fields.0.divider: unknown key; did you",
        ),
        ("kind: sum8", "kind: sum9", r":10: checksum.kind: "),
        ("kind: sum8", "kind: sum8, span: [1, 9]", "span must lie within bytes 0 to 5"),
        (
            "name: mz",
            "name: fz",
            r":7: fields: two fields are named 'fz': give each",
        ),
        ("name: mz", "name: 5", r"name: must be text \(it is 5\): put it in quotes"),
    ],
)
def test_a_wrong_format_is_refused_with_line_and_key(tmp_path, old, new, said):
    text = FORMAT.read_text()
    assert old in text
    path = tmp_path / "mine.yaml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(AxisError, match=said):
        load_format(str(path))


def test_a_line_with_two_fields_of_one_name_is_refused(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("kind: text\npattern: (?P<a>.*)\nfields: [{name: a}, {name: a, scale: 2}]\n")
    with pytest.raises(AxisError, match=r":3: fields: two fields are named 'a': give each a name"):
        load_format(str(path))


def test_a_file_that_is_no_dbc_is_refused_by_name(tmp_path):
    path = tmp_path / "broken.dbc"
    path.write_text("BO_ 5 BIG: eight A\n")
    with pytest.raises(AxisError, match=r"broken\.dbc:\d+: is no DBC"):
        load_dbc(str(path))


@given(st.lists(st.tuples(st.sampled_from((*REASONS, *EVENTS)), st.integers(0, 5)), max_size=40))
def test_rejected_frames_are_the_sum_of_all_reasons_and_no_events(counted):
    counters = FramedCounters()
    for name, count in counted:
        counters[name] += count
        assert counters.rejected == sum(counters[reason] for reason in REASONS)
    counters["bad_checksum"] = 2  # also where a count is set, not added to
    assert counters.rejected == sum(counters[reason] for reason in REASONS)
