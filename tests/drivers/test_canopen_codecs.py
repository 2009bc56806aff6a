from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teleop_rt.axis import AxisError
from teleop_rt_drivers.can_frames import FRAME, WIDE
from teleop_rt_drivers.canopen import cia402, eds, intake
from teleop_rt_drivers.canopen.channel import Replies
from teleop_rt_drivers.canopen.cia402 import Cia402State, drive_state
from teleop_rt_drivers.canopen.counters import Counters
from teleop_rt_drivers.canopen.drive import Drive
from teleop_rt_drivers.canopen.entries import address
from teleop_rt_drivers.canopen.node_config import PdoConfig
from teleop_rt_drivers.canopen.pdo import PdoCodec
from teleop_rt_drivers.canopen.setup import interpolation_period
from teleop_rt_drivers.canopen.watch import new_lives
from teleop_rt_drivers.drive_intent import Intent
from teleop_rt_drivers.quantity import Scale

FILES = {"encoder_cia406.eds": 0x10, "force_cia404.eds": 0x20, "drive_cia402.eds": 0x30}


@pytest.mark.parametrize(
    ("file", "node", "cob_ids"),
    [
        ("encoder_cia406.eds", 0x10, {0x1800: 0x190, 0x1801: 0x290}),
        ("force_cia404.eds", 0x20, {0x1800: 0x1A0}),
        ("drive_cia402.eds", 0x30, {0x1400: 0x230, 0x1800: 0x1B0}),
    ],
)
def test_eds_gives_the_predefined_cob_ids(file, node, cob_ids):
    dictionary = eds.load(file, node)
    for index, cob_id in cob_ids.items():
        assert eds.variable(dictionary, index, 1).default == cob_id


@pytest.mark.parametrize("file", FILES)
def test_every_default_mapping_of_an_eds_can_be_mapped_and_fits_a_frame(file):
    dictionary = eds.load(file, FILES[file])
    mappings = [i for i in dictionary if 0x1600 <= i < 0x1800 or 0x1A00 <= i < 0x1C00]
    assert mappings
    for index in mappings:
        words = [
            dictionary[index][sub].default for sub in range(1, dictionary[index][0].default + 1)
        ]
        for word in words:
            entry = eds.variable(dictionary, word >> 16, word >> 8 & 0xFF)
            assert entry.pdo_mappable
            assert len(entry) == word & 0xFF
        assert sum(word & 0xFF for word in words) <= 64


@pytest.mark.parametrize("file", FILES)
def test_every_object_of_the_eds_lists_is_described(file):
    dictionary = eds.load(file, FILES[file])
    assert {0x1000, 0x1001, 0x1003, 0x1005, 0x1006, 0x1008, 0x1010, 0x1011} <= set(dictionary)
    assert {0x1014, 0x1016, 0x1017, 0x1018, 0x1019, 0x1029} <= set(dictionary)


def test_missing_eds_is_named():
    with pytest.raises(AxisError, match=r"nowhere\.eds"):
        eds.load("nowhere.eds", 1)


def test_broken_eds_is_named(tmp_path):
    file = tmp_path / "broken.eds"
    file.write_text("[1018\nParameterName=x")
    with pytest.raises(AxisError, match=r"broken\.eds"):
        eds.load(str(file), 1)


def codec(objects, *, file="drive_cia402.eds", receive=True):
    pdo = PdoConfig(number=1, objects=objects)
    return PdoCodec(pdo, eds.load(file, FILES[file]), "drive", receive=receive)


@given(st.integers(0, 0xFFFF), st.integers(-(2**15), 2**15 - 1), st.integers(-(2**31), 2**31 - 1))
def test_drive_command_survives_the_round_trip_in_little_endian(control, torque, target):
    layout = CODEC
    data = layout.struct.pack(control, torque, target)
    assert data == struct.pack("<H", control) + struct.pack("<h", torque) + struct.pack(
        "<i", target
    )
    assert layout.struct.unpack(data) == (control, torque, target)


CODEC = codec(("0x6040", "0x6071", "0x607A"))


def test_mapping_words_are_index_subindex_bits():
    assert CODEC.words == [0x60400010, 0x60710010, 0x607A0020]
    assert CODEC.cob_id == 0x230


def test_the_layout_follows_the_order_of_the_config():
    swapped = codec(("0x607A", "0x6040"))
    assert swapped.slot("0x6040") == 1
    assert swapped.struct.pack(1, 2) == b"\x01\0\0\0\x02\0"


def test_real32_force_is_decoded_as_a_float():
    layout = codec(("0x6130:1", "0x6150:1"), file="force_cia404.eds", receive=False)
    assert layout.struct.unpack(struct.pack("<fB", 1.5, 3)) == (1.5, 3)


@pytest.mark.parametrize(
    ("objects", "said"),
    [
        (("0x6099",), "no object 0x6099"),
        (("0x6085",), "cannot be mapped"),
        (("0x607A", "0x6064", "0x6040"), "10 bytes"),
    ],
)
def test_a_mapping_that_no_device_takes_is_refused(objects, said):
    with pytest.raises(AxisError, match=said):
        codec(objects)


def test_a_role_that_no_pdo_carries_is_refused():
    with pytest.raises(AxisError, match="0x6064"):
        CODEC.slot("0x6064")


def test_addresses_are_hexadecimal_index_and_decimal_subindex():
    assert address("0x6005:1") == (0x6005, 1)
    assert address("0x6004") == (0x6004, 0)


@given(st.integers(-(2**31), 2**31 - 1), st.sampled_from([1, -1]))
def test_scale_gives_back_the_counts(counts, sign):
    scale = Scale(5e-6, sign, 0.25)
    assert scale.counts(scale.value(counts)) == counts


def test_scale_applies_sign_and_offset():
    assert Scale(1e-3, -1, 2.0).value(500) == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("statusword", "state"),
    [
        (0x0000, Cia402State.NOT_READY),
        (0x0020, Cia402State.NOT_READY),
        (0x0240, Cia402State.SWITCH_ON_DISABLED),
        (0x0260, Cia402State.SWITCH_ON_DISABLED),
        (0x0231, Cia402State.READY_TO_SWITCH_ON),
        (0x0233, Cia402State.SWITCHED_ON),
        (0x1237, Cia402State.OPERATION_ENABLED),
        (0x0217, Cia402State.QUICK_STOP_ACTIVE),
        (0x023F, Cia402State.FAULT_REACTION),
        (0x0208, Cia402State.FAULT),
        (0x0228, Cia402State.FAULT),
    ],
)
def test_statusword_contains_the_state(statusword, state):
    assert drive_state(statusword) is state


@pytest.mark.parametrize(
    ("period_ns", "expected"),
    [(1_000_000, (1, -3)), (500_000, (5, -4)), (10_000_000, (10, -3)), (400_000, (4, -4))],
)
def test_interpolation_period_is_exact(period_ns, expected):
    value, exponent = interpolation_period(period_ns)
    assert (value, exponent) == expected
    assert value * 10 ** (9 + exponent) == period_ns


def test_interpolation_period_that_the_drive_cannot_take_is_refused():
    with pytest.raises(AxisError, match="60C2h"):
        interpolation_period(333_333_333)


def in_slot(can_id, data):
    slots = np.zeros((1, WIDE.size), np.uint8)
    FRAME.pack_into(slots[0], 0, can_id, len(data), data, 0)
    return slots


@settings(deadline=None)  # the kernel may have to be compiled
@given(st.data())
@pytest.mark.parametrize("kind", "bBhHiIqQfd")
def test_a_number_of_each_kind_is_what_struct_reads(kind, data):
    size = struct.calcsize("<" + kind)
    raw = data.draw(st.binary(min_size=8, max_size=8))
    at = data.draw(st.integers(0, 8 - size))
    (expected,) = struct.unpack_from("<" + kind, raw, at)
    found = intake.number(in_slot(0x190, raw), 0, at, intake.format_code(kind))
    assert found == float(expected) or (math.isnan(found) and math.isnan(expected))


class TestReplies:
    def run(self, received):
        replies, counters, fresh = Replies(), Counters(), []
        for count in received:
            replies.asked()
            replies.received = count
            fresh.append(replies.settle(counters))
        return fresh, counters, replies

    def test_one_answer_to_each_sync_is_fresh(self):
        assert self.run([1, 1, 1])[0] == [True, True, True]

    def test_a_late_answer_is_caught_up_by_two(self):
        fresh, counters, _ = self.run([1, 0, 2, 1])
        assert fresh == [True, False, True, True]
        assert counters["unsolicited"] == 0

    def test_the_single_answer_after_a_missing_one_is_not_trusted(self):
        assert self.run([1, 0, 1])[0] == [True, False, False]

    def test_a_lost_answer_costs_three_cycles(self):
        fresh, counters, _ = self.run([1, 0, 1, 1, 1, 1])
        assert fresh == [True, False, False, False, True, True]
        assert counters["late"] == 2

    def test_a_long_silence_costs_no_more_than_one_lost_answer(self):
        assert self.run([1] + [0] * 50 + [1, 1, 1, 1])[0][-4:] == [False, False, True, True]

    def test_a_node_that_stalls_and_catches_up_is_no_second_sender(self):
        stalls = [1, 0, 0, 0, 4, 0, 0, 3, 0, 1, 2, 0, 0, 1, 1, 3, 1, 1]
        fresh, counters, replies = self.run(stalls)
        assert counters["unsolicited"] == 0
        assert not replies.duplicate
        asked, answered = 0, 0
        for received, is_fresh in zip(stalls, fresh, strict=True):
            asked, answered = asked + 1, answered + received
            assert is_fresh == (received > 0 and answered == asked)

    def test_answers_that_were_given_up_and_come_after_all_are_late(self):
        _, counters, replies = self.run([1, 0, 0, 1, 1, 1, 2, 2, 1])
        assert counters["unsolicited"] == 0
        assert not replies.duplicate

    def test_more_answers_than_syncs_are_a_second_sender(self):
        fresh, counters, replies = self.run([2, 2, 2])
        assert fresh == [False, False, False]
        assert counters["unsolicited"] == 3
        assert replies.duplicate

    def test_two_doubled_answers_are_not_yet_a_second_sender(self):
        assert not self.run([2, 2, 1])[2].duplicate


class TestDrive:
    TPDO = codec(("0x6041", "0x6077", "0x6064"), receive=False)

    def make(self):
        return Drive(self.TPDO, CODEC, Scale(1e-6, 1, 0.0), Counters())

    def report(self, drive, statusword, position):
        drive.replies.asked()
        slots = in_slot(self.TPDO.cob_id, self.TPDO.struct.pack(statusword, 0, position))
        arrays = drive.record.stored, Counters().words, new_lives(0), slots
        assert intake.take_frames(*arrays, 0, 1, 0) == 1
        self.settle(drive)

    def settle(self, drive):
        intake.end_cycle(drive.record.stored, Counters().words, 0)
        drive.settle()

    def test_it_commands_the_actual_position_until_it_is_enabled(self):
        drive = self.make()
        drive.arm()
        for statusword in (0x240, 0x231, 0x233):
            self.report(drive, statusword, 1234)
            assert CODEC.struct.unpack(drive.command(0.05))[2] == 1234
        self.report(drive, 0x237, 1234)
        assert CODEC.struct.unpack(drive.command(0.05))[2] == 50_000

    def test_it_walks_the_states_only_when_armed(self):
        drive = self.make()
        self.report(drive, 0x240, 0)
        assert CODEC.struct.unpack(drive.command(0.0))[0] == cia402.DISABLE_VOLTAGE
        drive.arm()
        words = []
        for statusword in (0x240, 0x231, 0x233, 0x237):
            self.report(drive, statusword, 0)
            words.append(CODEC.struct.unpack(drive.command(0.0))[0])
        assert words == [0x06, 0x07, 0x0F, 0x0F]
        assert drive.enabled

    def test_a_drive_that_leaves_enabled_by_itself_is_not_enabled_again(self):
        drive = self.make()
        drive.arm()
        self.report(drive, 0x237, 0)
        assert drive.enabled
        self.report(drive, 0x240, 0)
        assert drive.fell_out
        assert drive.intent is Intent.STOPPED
        assert CODEC.struct.unpack(drive.command(0.0))[0] == cia402.DISABLE_VOLTAGE

    def test_a_drive_in_fault_is_not_reset_by_arming(self):
        drive = self.make()
        drive.arm()
        self.report(drive, 0x208, 0)
        assert drive.faulty
        assert CODEC.struct.unpack(drive.command(0.0))[0] == cia402.DISABLE_VOLTAGE

    def test_a_silent_drive_is_not_believed_enabled(self):
        drive = self.make()
        drive.arm()
        self.report(drive, 0x237, 0)
        for _ in range(3):
            self.settle(drive)
        assert not drive.enabled

    @pytest.mark.parametrize("position", [float("nan"), float("inf"), -float("inf")])
    def test_a_position_that_is_no_number_keeps_the_last_command(self, position):
        drive = self.make()
        drive.arm()
        self.report(drive, 0x237, 0)
        drive.command(0.02)
        assert CODEC.struct.unpack(drive.command(position))[2] == 20_000

    def test_a_position_beyond_the_objects_range_is_clamped(self):
        drive = self.make()
        drive.arm()
        self.report(drive, 0x237, 0)
        assert CODEC.struct.unpack(drive.command(1e9))[2] == 2**31 - 1
        assert CODEC.struct.unpack(drive.command(-1e9))[2] == -(2**31)

    def test_stop_asks_for_quick_stop_where_the_tool_is(self):
        drive = self.make()
        drive.arm()
        self.report(drive, 0x237, 777)
        assert CODEC.struct.unpack(drive.stop_command()) == (cia402.QUICK_STOP, 0, 777)
        assert not drive.enabled
