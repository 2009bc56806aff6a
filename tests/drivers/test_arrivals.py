"""Stamps of bytes on lines: their time of arrival, and half way to the answer of a servo."""

from __future__ import annotations

import math
import os
import time

import can
import numpy as np
import pytest
from armed_actuators import armed
from framed_bench import RIGS, edited, load
from rig_bench import MS, START_NS, plant_config

from teleop_rt.axis import AxisFault
from teleop_rt.config.loader import load_trial
from teleop_rt.estimation.pairing import Pairing
from teleop_rt.realtime.clock import WATCHED_UP_TO_NS, RealClock
from teleop_rt.trial.estimators import pipeline_settings
from teleop_rt_drivers import registry
from teleop_rt_drivers.framed.binary import BinaryPacker
from teleop_rt_drivers.framed.can_port import CanEnd
from teleop_rt_drivers.framed.config import SerialPortConfig
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.framed.format import load_format
from teleop_rt_drivers.framed.serial_port import SerialPort
from teleop_rt_drivers.framed.stream import DescriptorStream, StreamGoneError, keep_arrivals
from teleop_rt_drivers.simulated.plant import Plant
from teleop_rt_drivers.slow_check import check_stamps

SILICONE = RIGS.parent / "trials" / "silicone_cube.yaml"


def test_what_arrives_is_kept_with_its_time():
    near, far = os.pipe()
    stream = DescriptorStream(near)
    os.write(far, b"abc")
    before_ns = time.monotonic_ns()
    keep_arrivals([stream], 1e-3)
    ((arrived_ns, data),) = stream.kept
    assert data == b"abc"
    assert before_ns <= arrived_ns <= time.monotonic_ns()
    os.close(far)
    keep_arrivals([stream], 1e-3)
    assert len(stream.kept) == 1
    with pytest.raises(StreamGoneError):
        stream.read()
    stream.close()


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"])
def test_a_servo_s_position_is_stamped_half_way_between_question_and_answer(kind):
    bench = armed(kind)
    asked = bench.now
    line = bench.ends.line_pair("drive")[0]
    line.kept.append((asked + 400_000, line.read()))
    sample = bench.cycle(0.0)
    assert sample.position_stamp_ns == asked + 200_000
    assert bench.cycle(0.0).position_stamp_ns == bench.now - MS, "unknown: when it was asked"


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"])
def test_an_answer_that_the_cycle_itself_reads_has_the_stream_s_time(kind):
    bench = armed(kind)
    asked = bench.now
    bench.ends.line_pair("drive")[0].arrived_ns = asked + 400_000
    assert bench.cycle(0.0).position_stamp_ns == asked + 200_000


@pytest.mark.parametrize("kind", ["damiao", "robstride", "moteus"])
def test_a_motor_s_position_is_stamped_half_way_to_its_answer_on_a_watched_bus(kind):
    """The bus was empty when it was asked: the answer came half a cycle later, or so."""
    bench = armed(kind)
    asked = bench.now
    bench.axis._parts[0][1]._ports[0].wire.empty_ns = asked
    assert bench.cycle(0.0).position_stamp_ns == asked + MS // 4


def test_a_force_has_the_time_at_which_its_frame_arrived():
    bench = armed("feetech")
    line = bench.ends.line_pair("sensor.wrench")[0]
    bench.now += MS
    arrived = bench.now - 300_000
    line.kept.append((arrived, line.read()))
    bench.axis.read_into(bench.sample)
    assert bench.sample.force_stamp_ns == arrived


@pytest.mark.parametrize("late_ms", [0.0, 2.0, 3.7])
def test_forces_that_are_newer_than_positions_meet_those_of_their_times(late_ms):
    """A servo's position is a cycle old: each force waits for it, and none is lost."""
    pairing, period_ns = Pairing(2 * MS, 2 * MS, 1e-3), 2 * MS
    met = []
    for k in range(1, 60):
        now_ns = k * period_ns
        position_ns = now_ns - round(late_ms * MS)
        if pairing.take(1e-9 * position_ns, position_ns, 1e-9 * (now_ns - MS), now_ns):
            met.append((pairing.position, pairing.force, pairing.gap))
    assert len(met) >= 55
    assert all(x == pytest.approx(f) for x, f, _ in met)
    assert not any(gap for *_, gap in met)


def test_a_drive_s_reported_force_does_not_depend_on_how_often_its_plant_is_asked():
    plants = [Plant(plant_config(), START_NS, 1) for _ in range(2)]
    rng = np.random.default_rng(2)
    for plant in plants:
        plant.hold()
    forces = []
    for k in range(1, 30):
        for plant in plants:
            plant.follow(1e-4 * (k + (k % 2)), 2e-3)
        for part in np.sort(rng.integers(1, 2 * MS, 5)):
            plants[1].advance(START_NS + (k - 1) * 2 * MS + int(part))
        for plant in plants:
            plant.advance(START_NS + k * 2 * MS)
        forces.append([plant.servo_force for plant in plants])
    whole, parts = np.array(forces).T
    assert np.max(np.abs(whole)) > 20.0
    assert np.max(np.abs(parts - whole)) < 0.25 * np.max(np.abs(whole))


def test_the_clock_watches_in_place_of_sleep_until_shortly_before_the_deadline():
    watched = []
    clock = RealClock(20 * MS, watch=watched.append)
    clock.wait_next_tick()
    (seconds,) = watched
    assert 0 < seconds <= (20 * MS - WATCHED_UP_TO_NS) * 1e-9


def test_what_no_sync_latches_is_paired_by_its_stamps():
    for kind in ("feetech", "dynamixel", "mixed", "odrive", "damiao", "serial", "raw_can"):
        axis = load(kind).axis
        assert axis.paired
        assert 1e-5 < axis.stamp_deviation_s(1e-3) < 0.15e-3
    canopen = load("canopen").axis
    assert not canopen.paired
    assert canopen.stamp_deviation_s(1e-3) == 0.0


def test_a_bus_that_is_only_read_is_known_to_a_cycle_and_the_interval_says_so():
    options = [
        f"rig={RIGS / 'simulated_odrive.yaml'}", "rig.axis.parts.drive.bus.interface=gs_usb",
        "rig.sensors.force_lag_deviation_ms=0.1",
    ]  # fmt: skip
    trial = load_trial(SILICONE, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, options)
    stamps_s = 1e-3 * math.hypot(1.0 / math.sqrt(12.0), 0.1)
    assert trial.rig.axis.stamp_deviation_s(1e-3) == pytest.approx(stamps_s)
    whole_s = pipeline_settings(trial).force_lag_deviation_s
    assert whole_s == pytest.approx(math.hypot(stamps_s, 0.1e-3))


@pytest.mark.parametrize(
    ("interface", "severity", "words"),
    [
        ("unix", "ok", "0.1 ms, and so is the damping, by 0.1 N s/m for each 1000 N/m"),
        ("gs_usb", "warning", "0.31 ms, and so is the damping, by 0.31 N s/m for each 1000 N/m"),
    ],
)
def test_check_states_how_well_damping_can_be_known(interface, severity, words, tmp_path):
    change = ("interface: unix", f"interface: {interface}")
    found = check_stamps(edited("odrive", tmp_path, change))
    assert [one.severity for one in found] == [severity]
    assert words in found[0].what
    assert check_stamps(load("canopen")) == []


def test_a_force_that_a_converter_averaged_meets_the_position_averaged_alike():
    """A swing of 3 Hz: by an HX711's settling it is found a hundredth smaller, and k with it."""
    swing, period_ns = 2.0 * math.pi * 3.0, 12_500_000
    average = np.full(50, 0.02)
    for _ in range(3):  # four averages of 12.5 ms, each in steps of 0.25 ms
        average = np.convolve(average, np.full(50, 0.02))
    ages_s = 0.25e-3 * np.arange(len(average))
    found = []
    for settling_s in (0.0, 0.05):
        pairing = Pairing(2 * MS, period_ns, 0.025 - 0.5e-3, settling_s)
        pairs = []
        for k in range(1500):
            now_ns = 2 * MS * k
            force_ns = now_ns // period_ns * period_ns
            force = 1000.0 * float(average @ np.sin(swing * (1e-9 * force_ns - ages_s)))
            position = math.sin(swing * 1e-9 * now_ns)
            if pairing.take(position, now_ns, force, force_ns):
                pairs.append((pairing.position, pairing.force))
        x, f = np.array(pairs[20:]).T
        found.append(float(x @ f / (x @ x)))
    assert found[0] < 992.0
    assert found[1] == pytest.approx(1000.0, abs=0.5)


def test_what_came_while_nobody_looked_has_the_middle_of_that_time():
    near, far = os.pipe()
    stream = DescriptorStream(near)
    keep_arrivals([stream], 1e-4)
    looked_ns = stream.empty_ns
    time.sleep(0.002)
    os.write(far, b"abc")
    time.sleep(0.002)
    before_ns = time.monotonic_ns()
    keep_arrivals([stream], 1e-4)
    after_ns = time.monotonic_ns()
    ((arrived_ns, _),) = stream.kept
    assert (looked_ns + before_ns) // 2 <= arrived_ns <= (looked_ns + after_ns) // 2
    stream.close()
    os.close(far)


class _Bus(can.BusABC):
    """Gives frames with the stamps of its list."""

    def __init__(self, stamps_s):
        self.channel_info = "stamps"
        super().__init__(channel="stamps")
        self._stamps_s = list(stamps_s)
        self._is_shutdown = True

    def recv(self, timeout=None):
        if not self._stamps_s:
            return None
        return can.Message(timestamp=self._stamps_s.pop(0), arbitration_id=1, data=b"\0")

    def send(self, msg, timeout=None):
        raise AssertionError


class _Noting(CanEnd):
    def __init__(self, bus, *, stamps):
        super().__init__(bus, {"flood": 0, "unreadable": 0})
        self._stamps = stamps
        self.came = []

    def take(self, can_id, data, now_ns):
        self.came.append(now_ns)


def test_a_frame_has_the_stamp_of_the_kernel_where_that_can_be():
    now_ns = time.monotonic_ns()
    wall_s = time.time() - time.monotonic()
    credible, hour = wall_s + (now_ns - 300_000) * 1e-9, wall_s + now_ns * 1e-9 - 3600.0
    end = _Noting(_Bus([credible, hour]), stamps=True)
    end.empty_ns = now_ns - MS
    end.drain(now_ns)
    stamped, middle = end.came
    assert stamped == pytest.approx(now_ns - 300_000, abs=20_000)
    assert middle == now_ns - MS // 2, "a clock that was set: half way since there was nothing"
    unwatched = _Noting(_Bus([credible]), stamps=True)
    unwatched.drain(now_ns)
    assert unwatched.came == [now_ns]


def test_frames_that_were_kept_have_the_middle_of_the_time_in_which_they_came():
    end = _Noting(_Bus([0.0]), stamps=False)
    end.empty_ns = empty_ns = time.monotonic_ns() - 10 * MS
    end.keep()
    kept_ns = time.monotonic_ns()
    assert empty_ns < end.empty_ns <= kept_ns, "the next bytes came after this look"
    end.drain(kept_ns + 5 * MS)
    (came_ns,) = end.came
    assert empty_ns + 5 * MS <= came_ns <= (empty_ns + kept_ns) // 2


def test_each_read_begins_the_time_in_which_the_next_bytes_come():
    near, far = os.pipe()
    os.set_blocking(near, False)
    stream = DescriptorStream(near)
    stream.empty_ns = began_ns = time.monotonic_ns() - 100 * MS
    os.write(far, b"a")
    stream.read()
    first_ns = stream.arrived_ns
    os.write(far, b"b")
    stream.read()
    assert began_ns < first_ns < began_ns + 90 * MS
    assert stream.arrived_ns > began_ns + 99 * MS
    stream.close()
    os.close(far)


def test_a_force_that_the_cycle_itself_reads_has_the_stream_s_time():
    bench = armed("feetech")
    line = bench.ends.line_pair("sensor.wrench")[0]
    bench.now += MS
    bench.simulated.process()
    line.arrived_ns = bench.now - 300_000
    bench.axis.read_into(bench.sample)
    assert bench.sample.force_stamp_ns == bench.now - 300_000


def test_a_watched_port_decodes_what_comes_at_once_and_stamps_it():
    near, far = os.pipe()
    os.set_blocking(near, False)
    counters = FramedCounters()
    config = SerialPortConfig(device="wrench", baud=460800, format="wrench_crc16")
    port = SerialPort("wrench", config, lambda: DescriptorStream(near), counters)
    stamps: list[int] = []
    port.sources["wrench"].listen(lambda _, now_ns: stamps.append(now_ns))
    port.open()
    packer = BinaryPacker(load_format("wrench_crc16"))
    port.empty_ns = began_ns = time.monotonic_ns() - 100 * MS
    os.write(far, packer.pack([0.0] * 9))
    keep_arrivals(port.watched, 1e-4)
    assert counters["frames"] == 1, "before the cycle that uses it"
    looked_ns = port.empty_ns
    assert began_ns < stamps[0] <= (began_ns + looked_ns) // 2
    now_ns = looked_ns + 10 * MS
    os.write(far, packer.pack([0.0] * 9))
    port.drain(now_ns)
    assert stamps[1:] == [(looked_ns + now_ns) // 2]
    os.close(far)
    keep_arrivals(port.watched, 1e-4)
    assert port.fault is AxisFault.NONE, "found by the cycle, not by the watch"
    port.drain(now_ns + MS)
    assert port.fault is AxisFault.UNPLUGGED
    port.close()
