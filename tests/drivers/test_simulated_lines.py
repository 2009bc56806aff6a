"""Simulated devices on lines of the system, of which only those are read that are readable."""

from __future__ import annotations

import os
import socket

import pytest
from framed_bench import load
from rig_bench import START_NS, plant_config

from teleop_rt_drivers.framed.stream import DescriptorStream
from teleop_rt_drivers.simulated.frame_devices import crc16_x25
from teleop_rt_drivers.simulated.plant import Plant
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
            rig.axis, plant, streams, lambda: START_NS, rig.period_ns, 1, lambda: None
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
