"""Kernels say on a CAN bus the same as Python: SYNC and commands, frame by frame."""

from __future__ import annotations

import errno
import struct
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_bench import START_NS, canopen_rig

from teleop_rt.axis import Sample
from teleop_rt_drivers.can_door import LENGTH_SHIFT, put_frame
from teleop_rt_drivers.can_frames import plain_message
from teleop_rt_drivers.canopen import exchange
from teleop_rt_drivers.canopen.axis import CanopenAxis
from teleop_rt_drivers.canopen.config import CanopenConfig
from teleop_rt_drivers.canopen.exchange import COUNT, SENT, new_sync, note_sent, send_sync
from teleop_rt_drivers.canopen.sdo import BOOT_UP
from teleop_rt_drivers.canopen.source import SourceRecord
from teleop_rt_drivers.canopen.watch import OPERATIONAL
from teleop_rt_drivers.quantity import Scale
from teleop_rt_drivers.unix_bus import UnixBus

RIG = canopen_rig()
assert isinstance(RIG.axis, CanopenConfig)
AXIS: CanopenConfig = RIG.axis
ENCODER, FORCE, DRIVE, COMMAND = 0x290, 0x1A0, 0x1B0, 0x230
ENABLED, OFF = 0x237, 0x240
POSITIONS = (0.01, 0.0123456, -3.0, float("nan"), 1e9, 0.02)


@pytest.fixture
def buses(tmp_path):
    """The daemon's end and the devices' end of a bus that kernels use."""
    with UnixBus(str(tmp_path)) as ours, UnixBus(str(tmp_path)) as theirs:
        assert ours.recv(0) is None
        yield ours, theirs


def answer(bus: UnixBus, statusword: int) -> None:
    """The answers of all devices to one SYNC."""
    bus.send(plain_message(ENCODER, bytes(8)))
    bus.send(plain_message(FORCE, bytes(5)))
    bus.send(plain_message(DRIVE, struct.pack("<Hhi", statusword, 0, 1234)))


def said(bus: UnixBus) -> list[tuple[int, bytes]]:
    return [(can_id, bytes(data)) for can_id, data, _ in bus.waiting_frames(64)]


def conversation(ours: UnixBus, theirs: UnixBus, config: CanopenConfig, *, by_kernel: bool):
    """Frames of an axis in some cycles, in the middle ones of which its drive is enabled."""
    clock = time.monotonic_ns if by_kernel else (lambda: time.monotonic_ns() + 0)
    axis = CanopenAxis(config, RIG, ours, clock)
    axis.listen()
    axis._drive.arm()
    ours.waiting_frames(64)
    if not by_kernel:
        axis._send_position = None
    heard, sample = [], Sample()
    words = [OFF, *[ENABLED] * (len(POSITIONS) + 1), OFF]
    for statusword, position in zip(words, [0.005, *POSITIONS, 0.03, 0.04], strict=False):
        axis.read_into(sample)
        axis.write(position)
        frames = said(theirs)
        heard.append([frame for frame in frames if frame[0] in {0x080, COMMAND}])
        answer(theirs, statusword)
    return heard, dict(axis.counters), sample.enabled


@pytest.mark.parametrize("counter", [None, 3])
def test_a_kernel_says_what_python_says(buses, counter):
    daemon = AXIS.daemon.model_copy(update={"sync_counter": counter})
    config = AXIS.model_copy(update={"daemon": daemon})
    by_kernel = conversation(*buses, config, by_kernel=True)
    assert by_kernel == conversation(*buses, config, by_kernel=False)
    syncs = [frame for cycle in by_kernel[0] for frame in cycle if frame[0] == 0x080]
    counts = [data for _, data in syncs]
    wanted = [b"\1", b"\2", b"\3"] if counter else [b""]
    assert counts == [wanted[i % len(wanted)] for i in range(len(counts))]
    assert by_kernel[1]["bad_command"] == 1


def test_a_cycle_is_one_step_of_python_for_sync_and_command(buses, monkeypatch):
    ours, theirs = buses
    axis = CanopenAxis(AXIS, RIG, ours, time.monotonic_ns)
    axis.listen()
    axis._drive.arm()
    sample = Sample()
    for _ in range(2):
        axis.read_into(sample)
        answer(theirs, ENABLED)
    axis.read_into(sample)
    said(theirs)

    def refuse(*_):
        raise AssertionError("not by this way")

    monkeypatch.setattr(axis, "_send_frame", refuse)
    answer(theirs, ENABLED)
    axis.read_into(sample)
    axis.write(0.01)
    assert sample.valid
    assert [can_id for can_id, _ in said(theirs)] == [0x080, COMMAND]


def test_the_own_heartbeat_is_one_frame_by_a_kernel_and_by_python(buses, monkeypatch):
    ours, theirs = buses
    axis = CanopenAxis(AXIS, RIG, ours, time.monotonic_ns)
    axis.listen()
    said(theirs)
    with monkeypatch.context() as by_kernel:
        by_kernel.setattr(axis, "_send_frame", lambda *_: pytest.fail("not by this way"))
        axis._send_heartbeat()
    frames = said(theirs)
    assert frames == [(BOOT_UP + AXIS.daemon.node_id, bytes((OPERATIONAL,)))]
    monkeypatch.setattr(axis, "_put_frame", None)
    axis._send_heartbeat()
    assert said(theirs) == frames


def test_a_heartbeat_that_cannot_be_sent_is_counted_once(buses):
    ours, _ = buses
    axis = CanopenAxis(AXIS, RIG, ours, time.monotonic_ns)
    axis.listen()
    ours.door.door.descriptor = -1
    axis._send_frame = failing
    axis._send_heartbeat()
    assert axis.counters["send_failed"] == 1


def failing(*_: object) -> None:
    raise OSError(errno.ENOBUFS, "no buffer space")


def test_the_values_of_a_cycle_bear_the_time_of_the_frame_that_asked_for_them(buses):
    ours, theirs = buses
    axis = CanopenAxis(AXIS, RIG, ours, time.monotonic_ns)
    axis.listen()
    sample = Sample()
    axis.read_into(sample)
    ((_, _, asked_ns),) = [one for one in theirs.waiting_frames(64) if one[0] == 0x080]
    answer(theirs, OFF)
    axis.read_into(sample)
    assert sample.valid
    assert sample.stamp_ns == sample.position_stamp_ns == sample.force_stamp_ns == asked_ns


def test_a_frame_that_a_full_queue_refuses_is_lost_and_no_fault(buses):
    ours, theirs = buses
    axis = CanopenAxis(AXIS, RIG, ours, time.monotonic_ns)
    axis.listen()
    sample = Sample()
    while ours.lost < 3:
        axis.read_into(sample)
    assert axis.counters["send_failed"] == 0
    assert axis.counters["sync_sent"] > 3
    assert len(said(theirs)) > 0


def test_a_frame_for_a_door_that_is_shut_is_an_error_and_counts_no_sync(buses):
    ours, _ = buses
    syncs = new_sync(0x080, 3)
    words = syncs.view(np.int64)
    ours.shutdown()
    assert ours.door.door.descriptor < 0
    assert put_frame(ours.door.arrays[0], ours.door.words, 0x123, 0) < 0
    assert not send_sync(syncs, ours.door.arrays[0], ours.door.words)
    assert (words[COUNT], words[SENT]) == (1, 0)


def test_a_frame_is_put_on_the_bus_as_it_is(buses):
    ours, theirs = buses
    data = bytes(range(248, 256))
    number = int.from_bytes(data, "little", signed=True)
    before_ns = time.monotonic_ns()
    sent_ns = put_frame(
        ours.door.arrays[0], ours.door.words, 0x91ABCDEF | 8 << LENGTH_SHIFT, number
    )
    assert theirs.waiting_frames(64) == [(0x91ABCDEF, data, sent_ns)]
    assert before_ns <= sent_ns <= time.monotonic_ns()


def test_sync_counts_from_one_to_its_last_and_again(buses):
    syncs = new_sync(0x080, 4)
    words, counts = syncs.view(np.int64), []
    for now_ns in range(9):
        counts.append(int(words[COUNT]))
        note_sent(syncs, START_NS + now_ns)
    assert counts == [1, 2, 3, 4, 1, 2, 3, 4, 1]
    assert words[SENT] == START_NS + 8


def driven(scale: Scale, control_at: int, target_at: int) -> SourceRecord:
    record = SourceRecord()
    source = record.source
    source.offset, source.gain = scale.offset, scale.sign * scale.per_count
    source.control_at, source.target_at = control_at, target_at
    return record


@settings(deadline=None)  # the kernel may have to be compiled
@given(st.floats(-1.0, 1.0), st.sampled_from([1, -1]), st.floats(1e-7, 1e-3), st.floats(-0.1, 0.1))
def test_a_target_is_the_nearest_count_as_python_rounds_it(position, sign, per_count, offset):
    scale = Scale(per_count, sign, offset)
    record = driven(scale, 0, 2)
    exchange.set_target(record.stored, position)
    assert record.source.target == scale.counts(position)


@pytest.mark.parametrize(("half", "even"), [(0.5, 0), (1.5, 2), (2.5, 2), (-0.5, 0), (-1.5, -2)])
def test_a_target_between_two_counts_is_the_even_one(half, even):
    record = driven(Scale(1.0, 1, 0.0), 0, 2)
    exchange.set_target(record.stored, half)
    assert record.source.target == even == round(half)


@pytest.mark.parametrize(("position", "target"), [(1e300, 2**31 - 1), (-1e300, -(2**31))])
def test_a_target_beyond_what_the_object_holds_is_its_end(position, target):
    record = driven(Scale(1e-6, 1, 0.0), 0, 2)
    exchange.set_target(record.stored, position)
    assert record.source.target == target


@pytest.mark.parametrize(("layout", "control_at", "target_at"), [("<Hi", 0, 2), ("<iH", 4, 0)])
@pytest.mark.parametrize("target", [0, 1, -1, 2**31 - 1, -(2**31)])
def test_a_command_is_the_bytes_that_struct_packs(layout, control_at, target_at, target):
    record = driven(replace(Scale(1.0, 1, 0.0)), control_at, target_at)
    record.source.target = target
    values = (0x0F, target) if control_at == 0 else (target, 0x0F)
    packed = struct.pack(layout, *values)
    word = exchange.command_word(record.stored[0], 0x0F)
    assert word.to_bytes(8, "little", signed=True)[: len(packed)] == packed
