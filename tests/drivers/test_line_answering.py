"""Frames that a kernel sends in place of simulated devices on serial lines: they are theirs."""

from __future__ import annotations

import os
import select
import socket
import struct
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from framed_bench import FramedBench, load
from rig_bench import MS, plant_config
from test_answering import FAR_NS, PROCESS_DATA, ask

from teleop_rt_drivers.framed.stream import DescriptorStream
from teleop_rt_drivers.opening import open_rig_on
from teleop_rt_drivers.simulated import senses
from teleop_rt_drivers.simulated.frame_devices import crc16_x25
from teleop_rt_drivers.simulated.line_answer import is_late
from teleop_rt_drivers.simulated.line_frames import DRIVE, EDGES, WRENCH, WrittenFrame
from teleop_rt_drivers.simulated.servo import WATCHDOG_NS, ServoState
from teleop_rt_drivers.unix_bus import UnixBus

OFF, FOLLOW = 0, 1
PYTHON_SENT = 2  # measurements of each sensor: before the kernel had its turn, and after
QUIET = {"force_noise": 0.0, "force_lag_jitter_us": 0.0}
SECOND_NS = 1_000_000_000
DEVICE_US = 1_000_040  # of a device's clock in a second: it is 40 ppm fast


def sealed(frame: bytes) -> bytes:
    return frame + crc16_x25(frame[1:]).to_bytes(2, "little")


@pytest.mark.parametrize("force", [0.0, -3.25, 17.1])
def test_a_wrench_has_its_force_and_its_device_s_time(force):
    made = WrittenFrame(WRENCH).of(force, now_ns=SECOND_NS)
    body = struct.pack("<H6fIf", 0, 0, 0, force, 0, 0, 0, DEVICE_US, 24.5)
    assert made == sealed(b"\xaa" + body)


def test_a_counter_board_counts_its_frames_beyond_a_byte():
    frame = WrittenFrame(EDGES)
    for count in range(1, 300):
        made = frame.of(-7.6, now_ns=SECOND_NS)
        assert made == sealed(b"\x51" + struct.pack("<BiI", count & 0xFF, -8, DEVICE_US))


@pytest.mark.parametrize(("place", "sent"), [(2.5, 2), (-3e10, -(2**31) + 1), (3e10, 2**31 - 1)])
def test_a_drive_s_answer_has_its_place_within_the_field(place, sent):
    made = WrittenFrame(DRIVE, b"\x3d").of(place, 2)
    assert made == sealed(b"\x3d" + struct.pack("<BBi", 1, 2, sent))


class Ends:
    """The devices' ends of a rig: lines of sockets, and a bus."""

    def __init__(self, folder) -> None:
        self.channel = str(folder / "bus")
        self.hosts: dict[str, socket.socket] = {}

    def line(self, key: str, path: str, baud: int) -> DescriptorStream:
        near, far = socket.socketpair()
        os.set_blocking(far.fileno(), False)
        os.set_blocking(near.fileno(), False)
        self.hosts[key.rpartition(".")[2]] = near
        return DescriptorStream(far.detach())

    def bus(self, key: str, config) -> UnixBus:
        return UnixBus(self.channel)


@pytest.fixture
def world(tmp_path):
    """Gives rigs on lines of sockets, at the machine's time, without noise."""
    made = []

    def open_one(kind: str):
        ends = Ends(tmp_path)
        plant = plant_config(sensors=QUIET)
        rig = open_rig_on(load(kind), plant, time.monotonic_ns, 1, ends)
        truths: list[list[float]] = []
        rig.on_truth = truths.append
        rig.on_truths = lambda rows: truths.extend(rows.tolist())
        one = SimpleNamespace(rig=rig, ends=ends, hosts=ends.hosts, truths=truths)
        one.network = rig.networks[-1]
        rig.power_on()
        made.append(one)
        return one

    yield open_one
    for one in made:
        one.rig.close()
        for host in one.hosts.values():
            host.close()


def heard(world, port: str, size: int) -> list[bytes]:
    """The frames that came on a line since the last call."""
    try:
        data = world.hosts[port].recv(1 << 16)
    except BlockingIOError:
        return []
    assert len(data) % size == 0
    return [data[at : at + size] for at in range(0, len(data), size)]


def ask_drive(world, control: int, target: int = 0) -> None:
    world.hosts["drive"].send(sealed(b"\xc3" + struct.pack("<BBi", 0, control, target)))


def served(world) -> None:
    world.network.serve_once(world.network.descriptors())


def answered(world, until_ns: int = FAR_NS):
    return world.network.answer_until(until_ns, [])


def test_a_kernel_goes_on_counting_where_the_devices_were_and_they_where_it_is(world):
    one = world("serial")
    ask_drive(one, OFF)
    served(one)
    for _ in range(5):
        ask_drive(one, OFF)
        assert answered(one) == (one.network,)
    one.network.process()
    counts = [frame[1] for frame in heard(one, "counter", 12)]
    assert counts == list(range(1, len(counts) + 1))
    assert len(counts) > PYTHON_SENT, "the kernel sent the others"
    answers = heard(one, "drive", 9)
    assert [frame[1] for frame in answers] == [1, 2, 3, 4, 5, 6]
    assert all(sealed(frame[:-2]) == frame for frame in answers)
    assert len(one.truths) >= len(counts) - 1, "the motion at each measurement is noted"


def test_the_drive_hears_other_bytes_than_commands_of_every_cycle(world):
    one = world("serial")
    ask_drive(one, OFF)
    served(one)
    one.hosts["drive"].send(b"noise")
    ask_drive(one, FOLLOW)
    answered(one)
    assert one.network.drive.servo.state is ServoState.FOLLOWING
    assert [frame[2] for frame in heard(one, "drive", 9)] == [ServoState.OFF, ServoState.FOLLOWING]


@pytest.fixture
def following(world):
    """A rig whose drive follows."""
    one = world("serial")
    for control in (OFF, FOLLOW):
        ask_drive(one, control)
        served(one)
    heard(one, "drive", 9)
    return one


def test_a_kernel_follows_a_target_as_the_drive_does(following):
    one = following
    plant, start = one.rig.plant, one.rig.plant.reference
    ask_drive(one, FOLLOW, round(plant.counts_of(start)) + 150)
    answered(one)
    assert one.network.drive.servo.state is ServoState.FOLLOWING
    assert len(heard(one, "drive", 9)) == 1
    assert plant.reference == pytest.approx(start + 150e-6, abs=1e-6)


def test_a_drive_whose_last_command_a_kernel_took_stops_when_commands_stay_away(following):
    servo, before_ns = following.network.drive.servo, time.monotonic_ns()
    ask_drive(following, FOLLOW)
    answered(following)
    servo.run(before_ns + WATCHDOG_NS)
    assert servo.state is ServoState.FOLLOWING
    servo.run(time.monotonic_ns() + WATCHDOG_NS)
    assert servo.state is ServoState.OFF
    assert not answered(following), "a command that it is off is yet to come"


@pytest.mark.parametrize("device", ["encoder", "force sensor", "drive"])
def test_no_kernel_answers_for_a_device_that_is_broken(world, device):
    one = world("serial")
    ask_drive(one, OFF)
    served(one)
    assert answered(one)
    one.rig.inject("mute", device)
    assert not answered(one)
    one.rig.heal(device)
    assert answered(one)


def test_a_frozen_sensor_repeats_the_frame_that_a_kernel_sent(world):
    one = world("serial")
    ask_drive(one, OFF)
    served(one)
    answered(one)
    last = heard(one, "counter", 12)[-1]
    one.rig.inject("freeze", "encoder")
    one.network.devices["encoder"].run(time.monotonic_ns() + MS)
    assert heard(one, "counter", 12) == [last]


def test_nothing_is_sent_on_a_line_that_is_pulled(world):
    one = world("serial")
    ask_drive(one, OFF)
    served(one)
    assert answered(one)
    one.rig.inject("unplug", "encoder")
    one.rig.heal("encoder")
    assert not answered(one)
    served(one)


def test_another_readable_line_ends_the_wait(world):
    one = world("serial")
    ask_drive(one, OFF)
    served(one)
    near, far = socket.socketpair()
    with near, far:
        far.send(b"frame")
        before = len(one.truths)
        assert one.network.answer_until(FAR_NS, [near.fileno()])
        assert len(one.truths) <= before + 1, "not until the lines have been silent"


def test_a_timer_is_set_once_for_the_sensor_that_sends_next(world):
    answering = world("serial").network.answering
    lines, now_ns = answering.lines, time.monotonic_ns()
    lines.sensors["due_ns"] = now_ns + 3600 * SECOND_NS, now_ns + 1800 * SECOND_NS
    assert not is_late(lines, now_ns)
    assert lines.ring[2] * SECOND_NS + lines.ring[3] == now_ns + 1800 * SECOND_NS
    lines.ring[:] = 0
    assert not is_late(lines, now_ns + MS), "as it is after a command"
    assert not lines.ring.any()
    assert not select.select([answering.timer], (), (), 0)[0]
    assert is_late(lines, now_ns + 1800 * SECOND_NS)
    lines.sensors["due_ns"] = time.monotonic_ns() + MS
    assert not is_late(lines, now_ns)
    assert select.select([answering.timer], (), (), 10)[0]


def test_a_sensor_s_line_is_served_by_the_kernel_that_answers_a_bus(world, monkeypatch):
    one, cycles = world("mixed"), 20
    one.network = one.rig.networks[0]
    end = UnixBus(one.ends.channel)
    try:
        one.network.serve_once(())
        one.rig.power_on()
        end.send_frame(0, bytes((1, 0)))
        for _ in range(3):
            end.send_frame(0x230, bytes(8))
            end.send_frame(0x080, b"")
            one.network.serve_once(())
        end.waiting_frames(256)
        heard(one, "wrench", 37)
        monkeypatch.setattr(one.rig.networks[1], "serve_once", pytest.fail)
        child = os.fork()
        if child == 0:
            os._exit(0 if ask(end, cycles, PROCESS_DATA - 1) == cycles else 1)
        ended = 0
        while not ended:
            assert answered(one, time.monotonic_ns() + 20 * MS) == tuple(one.rig.networks)
            ended, status = os.waitpid(child, os.WNOHANG)
        assert os.waitstatus_to_exitcode(status) == 0
    finally:
        end.shutdown()
    frames = heard(one, "wrench", 37)
    assert len(frames) >= 5
    assert all(sealed(frame[:-2]) == frame for frame in frames)


def test_rows_of_true_motion_are_noted_once_for_each_instant_in_few_calls(world):
    rig = world("serial").rig
    rows = np.zeros((4, len(rig.truth_row)))
    rows[:, 0] = 5, 5, 6, 7
    noted: list[list[float]] = []
    rig.on_truths = lambda rows: noted.extend(rows[:, 0].tolist())
    rig.note_rows(rows)
    rig.note_rows(rows[-1:])
    rig.note_rows(rows[:0])
    assert noted == [5, 6, 7]
    assert rig.truth_row[0] == 7
    calls: list[str] = []
    rows[:, 0] = 8, 9, 10, 11
    sys.setprofile(lambda frame, event, _: calls.append(frame.f_code.co_name * (event == "call")))
    try:
        rig.note_rows(rows)
    finally:
        sys.setprofile(None)
    assert noted[3:] == [8, 9, 10, 11]
    # The method, numpy's sum of truth values, and the function above.
    assert len([name for name in calls if name]) <= 3, calls


def test_a_kernel_s_turn_ends_by_its_time_at_1_khz_before_it_runs_out_of_numbers_or_rows():
    assert senses.LONGEST_ANSWERING_NS == 100 * MS
    assert senses.DRAWS * MS > senses.LONGEST_ANSWERING_NS
    assert senses.MOST_ROWS * MS / 2 > senses.LONGEST_ANSWERING_NS


def test_devices_on_a_clock_of_a_test_answer_themselves():
    assert FramedBench(load("serial")).simulated.networks[0].answering is None
