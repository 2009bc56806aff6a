"""Watched terminals are asked in one step: none is drained in a cycle while nothing waits."""

from __future__ import annotations

import os
import pty
import select
import tty

import pytest
from framed_bench import load
from rig_bench import MS, START_NS

from teleop_rt.axis import AxisFault, Sample
from teleop_rt_drivers.framed.axis import FramedAxis
from teleop_rt_drivers.framed.binary import BinaryPacker
from teleop_rt_drivers.framed.config import SerialPortConfig
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.framed.format import load_format
from teleop_rt_drivers.framed.quiet import quiet_lines
from teleop_rt_drivers.framed.serial_port import SerialPort
from teleop_rt_drivers.framed.stream import DescriptorStream

PERIOD_NS = MS


class Lines:
    """The serial rig's axis on terminals whose far ends are here, at times that are set."""

    def __init__(self) -> None:
        rig, self.now_ns, self.far = load("serial"), START_NS, {}
        self._packers, self.ports, self.counters = {}, {}, FramedCounters()
        for name, config in rig.axis.ports.items():
            self.far[name], near = pty.openpty()
            tty.setraw(near)
            os.set_blocking(near, False)
            stream = DescriptorStream(near)
            self._packers[name] = BinaryPacker(load_format(config.format))
            self.ports[name] = SerialPort(name, config, lambda one=stream: one, self.counters)
        self.axis = FramedAxis(rig.axis, rig, self.ports, lambda: self.now_ns, self.counters)
        self.sample = Sample()
        self.axis.listen()
        self._sent = 0

    def watch(self) -> None:
        """Let the lines be watched: by now they hold nothing."""
        for port in self.ports.values():
            port.empty_ns = self.now_ns

    def send(self, name: str) -> None:
        """Send a device's next frame, and wait until the terminal has it."""
        self._sent += 1
        fields = self.ports[name].sources[name].fields
        stamped = [1000.0 * self._sent * (one.name == "stamp") for one in fields]
        os.write(self.far[name], self._packers[name].pack(stamped))
        assert select.select([self.ports[name].descriptor], [], [], 10.0)[0]

    def cycle(self) -> None:
        """Read the axis one period later."""
        self.now_ns += PERIOD_NS
        self.axis.read_into(self.sample)

    def pull(self, name: str) -> None:
        """End a line."""
        os.close(self.far.pop(name))

    def close(self) -> None:
        self.axis.close()
        for end in self.far.values():
            os.close(end)


@pytest.fixture
def lines():
    made = Lines()
    yield made
    made.close()


def test_what_comes_after_quiet_cycles_came_half_way_since_the_last(lines):
    lines.watch()
    lines.send("counter")
    lines.send("wrench")
    lines.cycle()
    assert lines.sample.valid
    for _ in range(3):
        lines.cycle()
    assert {port.empty_ns for port in lines.ports.values()} == {lines.now_ns}
    lines.send("wrench")
    lines.cycle()
    assert lines.sample.force_stamp_ns == lines.now_ns - PERIOD_NS // 2
    assert lines.sample.position_stamp_ns == START_NS + PERIOD_NS // 2


def test_quiet_lines_are_not_drained_and_others_are(lines, monkeypatch):
    lines.watch()
    with monkeypatch.context() as quiet:
        for port in lines.ports.values():
            quiet.setattr(port, "drain", lambda _: pytest.fail("nothing waits"))
        lines.cycle()
    lines.send("drive")
    lines.cycle()
    assert lines.axis.counters["frames"] == 1


@pytest.mark.parametrize("name", ["counter", "wrench", "drive"])
def test_a_line_that_ends_is_found_in_the_next_cycle(lines, name):
    lines.watch()
    lines.cycle()
    assert lines.sample.fault is AxisFault.NONE
    lines.pull(name)
    lines.cycle()
    assert lines.sample.fault is AxisFault.UNPLUGGED


def test_a_fault_in_sending_is_found_though_the_lines_are_quiet(lines):
    lines.watch()
    lines.cycle()
    lines.ports["drive"].fault = AxisFault.UNPLUGGED
    lines.cycle()
    assert lines.sample.fault is AxisFault.UNPLUGGED


def test_lines_that_nobody_watches_are_drained_at_once(lines):
    asked = quiet_lines(tuple(lines.ports.values()))
    assert asked is not None
    assert not asked.are_quiet(lines.now_ns)
    assert {port.empty_ns for port in lines.ports.values()} == {0}


def test_a_closed_axis_asks_no_descriptor_that_may_be_another_s_by_then(lines):
    lines.watch()
    lines.axis.close()
    assert quiet_lines(tuple(lines.ports.values())) is None
    lines.cycle()
    assert lines.axis._lines is None  # a look at another's descriptor shows nowhere


@pytest.mark.parametrize("request_bytes", ["", "3F"])
def test_only_open_terminals_that_a_cycle_need_not_ask_can_be_quiet(request_bytes):
    near, far = os.pipe() if not request_bytes else pty.openpty()
    config = SerialPortConfig(
        device="wrench", baud=460800, format="wrench_crc16", request=request_bytes
    )
    port = SerialPort("wrench", config, lambda: DescriptorStream(near), FramedCounters())
    port.open()
    assert quiet_lines([port]) is None
    port.close()
    os.close(far)
