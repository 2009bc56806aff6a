"""Simulated devices on lines of the system, of which only those are read that are readable."""

from __future__ import annotations

import os
import socket

import pytest
from framed_bench import load
from rig_bench import MS, START_NS, canopen_rig, plant_config

from teleop_rt_drivers.framed.stream import DescriptorStream
from teleop_rt_drivers.simulated.frame_devices import crc16_x25
from teleop_rt_drivers.simulated.plant import Plant
from teleop_rt_drivers.simulated.rig import SimulatedRig
from teleop_rt_drivers.simulated.serial_network import SerialNetwork


class Lines:
    """The devices of the serial rig; the drive's line goes to a socket of the test."""

    def __init__(self) -> None:
        rig = load("serial")
        ports = rig.axis.ports
        self.pairs = {name: socket.socketpair() for name in ports}
        for _, device_end in self.pairs.values():
            os.set_blocking(device_end.fileno(), False)
        streams = {
            name: DescriptorStream(os.dup(device_end.fileno()))
            for name, (_, device_end) in self.pairs.items()
        }
        plant = Plant(plant_config(), START_NS, 1)
        self.network = SerialNetwork(
            rig.axis,
            plant,
            streams,
            lambda: START_NS,
            rig.period_ns,
            1,
            lambda: None,
            lambda _: None,
        )
        self.network.power_on()
        drive = next(name for name in ports if ports[name].command_format is not None)
        self.host = self.pairs[drive][0]
        os.set_blocking(self.host.fileno(), False)
        self.drive_descriptor = streams[drive].descriptor

    def answer(self) -> bytes:
        try:
            return self.host.recv(100)
        except BlockingIOError:
            return b""


@pytest.fixture
def lines():
    made = Lines()
    yield made
    made.network.close()
    for pair in made.pairs.values():
        for end in pair:
            end.close()


def test_a_line_is_read_once_it_is_readable_and_not_before(lines):
    body = bytes((0, 0)) + bytes(4)
    lines.host.send(b"\xc3" + body + crc16_x25(body).to_bytes(2, "little"))
    lines.network.serve_once(())
    assert lines.answer() == b""
    lines.network.serve_once([lines.drive_descriptor])
    assert lines.answer()[:1] == b"\x3c"


def test_every_line_is_read_where_nobody_looked_which_are_readable(lines):
    lines.host.send(bytes(9))
    lines.network.process()
    with pytest.raises(BlockingIOError):
        os.read(lines.drive_descriptor, 1)


class Network:
    """Devices on one line, which have something to do so long after they were served."""

    def __init__(self, served: list[str], name: str, period_ns: int) -> None:
        self.host, self.line = socket.socketpair()
        self._served, self._name, self._period_ns = served, name, period_ns

    def power_on(self) -> None:
        """Do nothing."""

    def serve_once(self, readable) -> None:
        self._served.append(self._name)
        if self.line.fileno() in readable:
            self.line.recv(100)

    def due_ns(self, now_ns: int) -> int:
        return now_ns + self._period_ns

    def descriptors(self) -> list[int]:
        return [self.line.fileno()]


def test_a_network_is_served_where_its_frames_wait_or_its_time_has_come_and_no_other():
    now_ns, served = START_NS, []
    rig = SimulatedRig(plant_config(), canopen_rig(), lambda: now_ns, 1)
    first, second = Network(served, "first", 2 * MS), Network(served, "second", 9 * MS)
    rig.networks = [first, second]

    def rounds():
        nonlocal now_ns
        yield ["first", "second"]  # at the beginning
        second.host.send(b"frame")
        yield ["second"]
        now_ns += 2 * MS
        yield ["first"]
        now_ns += 9 * MS
        yield ["first", "second"]

    found, wanted = [], rounds()

    def stop() -> bool:
        if served:
            found.append(served.copy())
            served.clear()
        return next(wanted, None) is None

    rig.serve(stop)
    assert found == list(rounds())
    for end in (first.host, first.line, second.host, second.line):
        end.close()
