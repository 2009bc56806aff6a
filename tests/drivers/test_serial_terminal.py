"""The serial rig over real pseudo-terminals."""

from __future__ import annotations

import fcntl
import os
import pty
import time

import pytest
from framed_bench import edited
from live_rig import cycles_until, serving

from teleop_rt.axis import AxisError, AxisFault, Sample
from teleop_rt_drivers.framed.stream import SerialStream, StreamGoneError
from teleop_rt_drivers.opening import open_axis
from teleop_rt_drivers.registry import own_run
from teleop_rt_drivers.simulated import servo


@pytest.fixture
def rig(tmp_path, monkeypatch):
    """Nobody's silence counts: on a loaded machine either thread may rest 60 ms and more."""
    monkeypatch.setattr(servo, "WATCHDOG_NS", 10**15)
    long = "timeout_ms: 30000"
    return edited(
        "serial",
        tmp_path,
        ("folder: /tmp/teleop-rt-ports", f"folder: {tmp_path}/ports"),
        ("field: count", f"field: count\n    {long}"),
        ("field: fz", f"{long}\n    field: fz"),
        ("answer: drive", f"answer: drive\n    {long}"),
    )


def test_the_axis_configures_arms_and_stops_over_pseudo_terminals(rig, tmp_path):
    sample = Sample()
    with serving(rig) as simulated:
        axis = open_axis(rig, time.monotonic_ns)
        axis.configure()
        assert not axis.read_into(sample)
        axis.arm()
        assert cycles_until(axis, sample, lambda: sample.enabled and sample.valid)
        assert sample.fault is AxisFault.NONE
        assert sample.rejected == 0
        axis.stop()
        assert cycles_until(axis, sample, lambda: not simulated.drive.powered)
        axis.close()
    assert not (tmp_path / "ports").exists()


def test_a_pulled_cable_is_a_fault_and_the_cycle_goes_on(rig):
    sample = Sample()
    with serving(rig) as simulated:
        axis = open_axis(rig, time.monotonic_ns)
        axis.configure()
        assert cycles_until(axis, sample, lambda: sample.valid)
        simulated.inject("unplug", "force sensor")
        assert cycles_until(axis, sample, lambda: sample.fault is AxisFault.UNPLUGGED)
        axis.close()


def test_cables_that_are_plugged_in_again_are_found_by_a_reset_and_enable_nothing(rig):
    sample = Sample()
    axis = open_axis(rig, time.monotonic_ns)
    with serving(rig) as simulated:
        axis.configure()
        axis.arm()
        assert cycles_until(axis, sample, lambda: sample.enabled)
        simulated.inject("unplug", "drive")
        assert cycles_until(axis, sample, lambda: sample.fault is AxisFault.UNPLUGGED)
    with serving(rig) as simulated:
        axis.read_into(sample)
        assert sample.fault is AxisFault.UNPLUGGED
        axis.configure()
        assert cycles_until(axis, sample, lambda: sample.valid)
        assert sample.fault is AxisFault.NONE
        assert not sample.enabled
        assert not simulated.drive.powered
        axis.close()


def test_a_missing_port_is_named_with_the_next_step(rig):
    axis = open_axis(rig, time.monotonic_ns)
    with pytest.raises(AxisError, match=r"cannot open the serial port \S*counter: [^\[]*by-id"):
        axis.configure()


def test_a_port_that_another_program_holds_is_named_as_such():
    _, theirs = pty.openpty()
    fcntl.flock(theirs, fcntl.LOCK_EX)
    with pytest.raises(AxisError, match=r"another program has it open: `fuser /dev/pts/\d+`"):
        SerialStream(os.ttyname(theirs), 115200)


def test_nothing_to_read_is_distinguished_from_a_cable_that_is_gone():
    ours, theirs = pty.openpty()
    stream = SerialStream(os.ttyname(theirs), 115200)
    os.close(theirs)
    assert stream.read() == b""
    os.write(ours, b"abc")
    stream.wait(1.0)
    assert stream.read() == b"abc"
    assert stream.write(b"x")
    assert os.read(ours, 10) == b"x"
    os.close(ours)
    with pytest.raises(StreamGoneError):
        stream.read()
    stream.close()


def test_every_run_gets_ports_of_its_own(rig):
    one, other = own_run(rig), own_run(rig)
    assert one != other
    assert all(change.startswith("rig.axis.folder=/") for change in (*one, *other))
