"""Makers' drives under damaged, foreign and missing frames."""

from __future__ import annotations

import random

import can
import pytest
from armed_actuators import DRIVES, ON_CAN, ON_LINES, armed, cycle, until
from framed_bench import load

from teleop_rt.axis import AxisFault
from teleop_rt_drivers.quantity import plausible_position


@pytest.mark.parametrize("kind", DRIVES)
def test_a_silent_drive_is_lost_and_named(kind):
    bench = armed(kind)
    bench.simulated.inject("mute", "drive")
    held = until(bench, lambda sample: not sample.valid, 5)
    assert held <= 3
    assert "position from drive" in bench.sample.stale
    took = until(bench, lambda sample: sample.fault is not AxisFault.NONE, 70)
    assert bench.sample.fault is AxisFault.DEVICE_LOST
    assert took + held <= 62
    assert "silent for more than 60 ms" in bench.sample.complaint


@pytest.mark.parametrize("fault", ["wrong_id", "wrong_length"])
@pytest.mark.parametrize("kind", DRIVES)
def test_frames_of_another_id_or_half_a_frame_are_counted_and_the_drive_is_lost(kind, fault):
    bench = armed(kind)
    bench.simulated.inject(fault, "drive")
    until(bench, lambda sample: sample.fault is not AxisFault.NONE, 70)
    assert bench.sample.fault in {AxisFault.DEVICE_LOST, AxisFault.DRIVE_FAULT}
    assert bench.sample.rejected > 0


@pytest.mark.parametrize("kind", DRIVES)
def test_swapped_bytes_are_no_position_that_moves_impossibly(kind):
    bench = armed(kind)
    for k in range(100):
        cycle(bench, 4e-5 * k)
    bench.simulated.inject("swapped_bytes", "drive")
    for _ in range(80):
        sample = cycle(bench, 4e-3)
        if sample.valid and sample.fault is AxisFault.NONE:
            assert sample.position == pytest.approx(bench.simulated.plant.position, abs=2e-3)


@pytest.mark.parametrize("kind", ON_CAN)
def test_bus_off_is_found_in_two_cycles(kind):
    bench = armed(kind)
    bench.simulated.inject("bus_off", "drive")
    until(bench, lambda sample: sample.fault is AxisFault.BUS_OFF, 2)


@pytest.mark.parametrize("kind", ON_LINES)
def test_a_pulled_cable_is_found_in_two_cycles(kind):
    bench = armed(kind)
    bench.simulated.inject("unplug", "drive")
    until(bench, lambda sample: sample.fault is AxisFault.UNPLUGGED, 2)


@pytest.mark.parametrize("kind", ON_CAN)
def test_a_second_master_is_found(kind):
    bench = armed(kind)
    sent: list[object] = []
    ours, drives = bench.ends.bus_pair("drive")
    deliver, drives.deliver = drives.deliver, sent.append
    cycle(bench)
    drives.deliver = deliver
    cycle(bench)
    ours.deliver(sent[-1])
    assert cycle(bench).fault is AxisFault.FOREIGN_MASTER


@pytest.mark.parametrize("kind", ON_CAN)
def test_mutated_frames_raise_nothing_and_every_valid_position_is_within_range_and_jump(kind):
    rng = random.Random(7)  # noqa: S311 - reproducible
    bounds = plausible_position(load(kind))
    compared = sum(attack(armed(kind), bounds, rng) for _ in range(10))
    assert compared > 60


def attack(bench, bounds, rng) -> int:
    """Send mutated frames until the axis is lost; return how many positions were compared."""
    daemon_end, seen = bench.ends.bus_pair("drive")[0], []
    deliver = daemon_end.deliver
    daemon_end.deliver = lambda frame: (seen.append(frame), deliver(frame))[1]
    cycle(bench)
    cycle(bench)
    last, stamp, compared = bench.sample.position, bench.sample.position_stamp_ns, 0
    for _ in range(200):
        deliver(mutated(rng.choice(seen[:20]), rng))
        sample = cycle(bench)
        if sample.position_stamp_ns > stamp:
            elapsed_s = (sample.position_stamp_ns - stamp) * 1e-9
            assert bounds.lower <= sample.position <= bounds.upper
            assert abs(sample.position - last) <= bounds.slack + bounds.rate * elapsed_s + 1e-12
            last, stamp, compared = sample.position, sample.position_stamp_ns, compared + 1
        if sample.fault is not AxisFault.NONE:
            break
    return compared


def mutated(frame: can.Message, rng: random.Random) -> can.Message:
    """The frame with bits of data or id flipped, or cut."""
    data, can_id = bytearray(frame.data), frame.arbitration_id
    for _ in range(rng.randint(1, 4)):
        if rng.random() < 0.2:
            can_id ^= 1 << rng.randrange(29 if frame.is_extended_id else 11)
        elif rng.random() < 0.2:
            data = data[: rng.randrange(len(data) + 1)]
        elif data:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    size = len(data)
    if frame.is_fd and size > 8:
        size = max(n for n in (8, 12, 16, 20, 24, 32, 48, 64) if n <= size)
    return can.Message(
        arbitration_id=can_id,
        is_extended_id=frame.is_extended_id,
        is_fd=frame.is_fd,
        data=bytes(data[:size]),
    )
