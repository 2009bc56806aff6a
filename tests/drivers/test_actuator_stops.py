"""Makers' drives that lose power: without a daemon, by a stop, closed, failed."""

from __future__ import annotations

import pytest
from armed_actuators import DRIVES, ON_CAN, WATCHDOG_MS, armed, cycle, until
from framed_bench import FramedBench, load
from rig_bench import MS

from teleop_rt.axis import AxisFault
from teleop_rt_drivers.simulated.synchronous_bus import as_sent


@pytest.mark.parametrize("kind", ON_CAN)
def test_without_the_daemon_the_motor_loses_its_voltage_within_the_watchdog(kind):
    bench = armed(kind)
    assert bench.simulated.drive.powered
    bench.silence(WATCHDOG_MS - 10)
    assert bench.simulated.drive.powered, "fed until now"
    bench.silence(20)
    assert not bench.simulated.drive.powered
    until(bench, lambda sample: sample.fault is not AxisFault.NONE, 40)
    assert bench.sample.fault in {AxisFault.DRIVE_FAULT, AxisFault.DEVICE_LOST}
    for _ in range(50):
        assert not cycle(bench).enabled
        assert not bench.simulated.drive.powered, "nobody gives it power again by himself"


@pytest.mark.parametrize("kind", DRIVES)
def test_a_stop_brings_a_moving_axis_to_rest_and_takes_the_voltage(kind):
    bench = armed(kind)
    for k in range(100):
        cycle(bench, 1e-4 * k)
    at = bench.simulated.plant.position
    bench.axis.stop()
    for _ in range(150):
        bench.now += MS
        bench.axis.read_into(bench.sample)
        bench.axis.stop()
    assert not bench.simulated.drive.powered
    assert bench.simulated.plant.position - at < 4e-3


@pytest.mark.parametrize("kind", DRIVES)
def test_an_axis_that_is_closed_while_it_moves_leaves_the_drive_without_voltage(kind):
    bench = armed(kind)
    for k in range(100):
        cycle(bench, 1e-4 * k)
    assert bench.simulated.drive.powered
    bench.axis.close()
    assert not bench.simulated.drive.powered


@pytest.mark.parametrize("kind", DRIVES)
def test_a_stop_takes_the_voltage_in_time_though_the_drive_says_that_it_moves(kind):
    bench = armed(kind)
    for k in range(100):
        cycle(bench, 1e-4 * k)
    bench.simulated.inject("freeze", "drive")
    for _ in range(30):
        bench.now += MS
        bench.axis.read_into(bench.sample)
        bench.axis.stop()
    for _ in range(90):
        bench.now += MS
        bench.axis.read_into(bench.sample)
        bench.axis.stop()
    assert not bench.simulated.drive.powered


def test_a_drive_that_has_failed_is_not_asked_again_to_take_power():
    bench = FramedBench(load("odrive"))
    bench.axis.configure()
    bench.simulated.inject("refuse_enable", "drive")
    drives = bench.ends.bus_pair("drive")[1]
    asked, deliver = [], drives.deliver
    drives.deliver = lambda frame: (asked.append(as_sent(frame)[0]), deliver(frame))[1]
    bench.axis.arm()
    until(bench, lambda sample: sample.fault is AxisFault.DRIVE_FAULT, 40)
    asked.clear()
    for _ in range(100):
        cycle(bench)
    assert 3 << 5 | 0x0C not in asked, "no position is commanded either"
    assert 3 << 5 | 0x0B not in asked
    # An ODrive clears this error at the next request, such as that to be idle.
    assert bench.sample.fault is AxisFault.DRIVE_FAULT
    assert "invalid state asked for" in bench.sample.complaint
