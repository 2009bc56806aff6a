"""Stamps of what comes on lines: when it arrived, and half way to the answer of a servo."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest
from framed_bench import FramedBench, load
from rig_bench import MS, START_NS, plant_config
from test_actuators import armed

from teleop_rt.estimation.pairing import Pairing
from teleop_rt.realtime.clock import WATCHED_UP_TO_NS, RealClock
from teleop_rt_drivers.framed.stream import DescriptorStream, StreamGoneError, keep_arrivals
from teleop_rt_drivers.simulated.plant import Plant


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
    line.kept.append((asked + 400_000, bytes(line._arrived)))
    line._arrived.clear()
    sample = bench.cycle(0.0)
    assert sample.position_stamp_ns == asked + 200_000
    assert bench.cycle(0.0).position_stamp_ns == bench.now - MS, "unknown: when it was asked"


def test_a_force_has_the_time_at_which_its_frame_arrived():
    bench = armed("feetech")
    line = bench.ends.line_pair("sensor.wrench")[0]
    bench.now += MS
    bench.simulated.process()
    arrived = bench.now - 300_000
    line.kept.append((arrived, bytes(line._arrived)))
    line._arrived.clear()
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


def test_only_a_servo_beside_a_force_sensor_is_paired():
    assert load("feetech").axis.paired
    assert load("dynamixel").axis.paired
    for kind in ("mixed", "odrive", "canopen", "serial"):
        assert not load(kind).axis.paired
    bench = FramedBench(load("serial"))
    bench.axis.configure()
    assert len(bench.axis.streams) == 3
