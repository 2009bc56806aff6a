"""The fdcanusb's lines, by a simulated adapter on a pseudo-terminal, written from its README."""

from __future__ import annotations

import os
import select
import threading
import tty

import can
import pytest
from framed_bench import load

from teleop_rt.axis import AxisError
from teleop_rt_drivers.actuators.codec import Report, Taken
from teleop_rt_drivers.actuators.wire import CanWire
from teleop_rt_drivers.bus import BusConfig, open_bus
from teleop_rt_drivers.fdcanusb_bus import received
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.simulated.moteus import SimulatedMoteus

LOCKED = b"ERR bus is on"


class Adapter:
    """Answers lines as the README of mjbots/fdcanusb describes; frames go to `on_frame`."""

    def __init__(self, on_frame=lambda _: None, answer_with: bytes | None = None) -> None:
        self.device, daemon = os.openpty()
        tty.setraw(daemon)
        self.path = os.ttyname(daemon)
        self._daemon = daemon
        self.on_frame, self.values, self.lines = on_frame, {}, []
        self.is_on = True  # left on by the program before
        self._answer_with = answer_with
        self._ends = os.pipe()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        begun = b""
        while self.device in select.select([self.device, self._ends[0]], [], [])[0]:
            begun += os.read(self.device, 4096)
            *lines, begun = begun.split(b"\n")
            for line in lines:
                self.lines.append(line.decode())
                self.say(self._answer_with or self.answer(line.decode().split()))

    def answer(self, words: list[str]) -> bytes:
        if words[:2] == ["can", "off"]:
            was, self.is_on = self.is_on, False
            return b"OK" if was else b"ERR already in BusOff"
        if words[:2] == ["can", "on"]:
            was, self.is_on = self.is_on, True
            return b"ERR already in BusOn" if was else b"OK"
        if words[:2] == ["conf", "set"]:
            if self.is_on:
                return LOCKED
            self.values[words[2]] = int(words[3])
            return b"OK"
        if words[0] == "can" and words[1] in {"std", "ext"} and self.is_on:
            self.on_frame(words[1:])
            return b"OK"
        return b"ERR unknown command"

    def say(self, line: bytes) -> None:
        os.write(self.device, line + b"\r\n")

    def close(self) -> None:
        if not self._thread.is_alive():
            return
        os.write(self._ends[1], b"x")
        self._thread.join()
        for descriptor in (self.device, self._daemon, *self._ends):
            os.close(descriptor)


@pytest.fixture
def adapter():
    made = Adapter()
    yield made
    made.close()


def opened(adapter: Adapter) -> can.BusABC:
    return open_bus(
        BusConfig(
            interface="fdcanusb", channel=adapter.path, bitrate=1_000_000, fd=True,
            data_bitrate=5_000_000,
        )
    )  # fmt: skip


def test_rates_are_set_with_the_bus_off_and_frames_go_as_the_readme_writes_them(adapter):
    bus = opened(adapter)
    assert adapter.values == {
        "can.bitrate": 1_000_000, "can.fd_bitrate": 5_000_000, "can.fdcan_frame": 1,
        "can.bitrate_switch": 1, "can.automatic_retransmission": 1,
    }  # fmt: skip
    assert adapter.lines[0] == "can off"
    assert adapter.lines[-1] == "can on"
    wide = can.Message(
        arbitration_id=0x8001, is_extended_id=True, is_fd=True, bitrate_switch=True,
        data=bytes.fromhex("1500"),
    )  # fmt: skip
    bus.send(wide)
    bus.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=b"\xab\xcd"))
    bus.send(can.Message(arbitration_id=0x7, is_extended_id=False))
    bus.shutdown()
    bus.shutdown()
    adapter.close()
    assert adapter.lines[-4:] == [
        "can ext 8001 1500 F B", "can std 123 abcd f b", "can std 7  f b", "can off",
    ]  # fmt: skip


def test_received_lines_are_frames_with_their_flags_and_damaged_ones_are_dropped(adapter):
    bus = opened(adapter)
    adapter.say(b"rcv 100 240400 E B F r t1234 f-1")
    adapter.say(b"rcv 100 24x400 E B F r")
    adapter.say(b"rcv 7FF 01 e b f R f0")
    adapter.say(b"rcv 12345678")
    adapter.say(b"\x00\xff garbage")
    adapter.say(b"rcv 7FF 0102030405060708 e b f r f-1")
    first, second = bus.recv(1.0), bus.recv(1.0)
    assert (first.arbitration_id, first.is_extended_id, first.is_fd) == (0x100, True, True)
    assert (first.bitrate_switch, bytes(first.data)) == (True, b"\x24\x04\x00")
    assert (second.arbitration_id, second.is_extended_id, second.is_fd) == (0x7FF, False, False)
    assert bytes(second.data) == bytes(range(1, 9))
    assert bus.recv(0) is None
    bus.shutdown()


@pytest.mark.parametrize(
    "line",
    [
        (b"800", b"00", b" e b f r"),  # too large for 11 bits
        (b"20000000", b"00", b" E b f r"),
        (b"1", b"00" * 9, b" e b f r"),  # nine bytes without CAN FD
        (b"1", b"00" * 65, b" e B F r"),
    ],
)
def test_a_line_of_a_frame_that_cannot_be_is_no_frame(line):
    assert received(*line) is None


def test_an_adapter_that_refuses_is_named_with_its_words_and_a_silent_one_too():
    refusing = Adapter(answer_with=b"ERR nonsense")
    with pytest.raises(AxisError, match=r"conf set can\.bitrate 1000000`: ERR nonsense"):
        opened(refusing)
    refusing.close()
    other = Adapter(answer_with=b"hello")
    with pytest.raises(AxisError, match="no answer to `can off`: is it an fdcanusb"):
        opened(other)
    other.close()
    with pytest.raises(AxisError, match=r"cannot open the serial port /dev/no-fdcanusb"):
        open_bus(BusConfig(interface="fdcanusb", channel="/dev/no-fdcanusb"))


def test_a_refused_frame_and_a_pulled_cable_are_errors_of_the_bus():
    adapter = Adapter()
    bus = opened(adapter)
    adapter.is_on = False  # as after an error of the bus
    frame = can.Message(arbitration_id=1, is_extended_id=False, data=b"\x00")
    bus.send(frame)
    bus.recv(1.0)
    with pytest.raises(can.CanOperationError, match="refused a frame: ERR unknown command"):
        bus.send(frame)
    adapter.close()
    with pytest.raises(can.CanOperationError, match="the adapter is gone"):
        bus.recv(0.1)
    bus.shutdown()


def test_a_moteus_answers_through_the_adapter_as_on_any_bus():
    rig = load("moteus")
    part = rig.axis.parts["drive"]
    adapter = Adapter()
    drive = SimulatedMoteus(
        part, Standing(), lambda can_id, data: adapter.say(line_of(can_id, data)), 10**6
    )
    adapter.on_frame = lambda words: drive.receive(int(words[1], 16), bytes.fromhex(words[2]), 0)
    wire = CanWire(opened(adapter), FramedCounters())
    codec, report, taken = part.codec(rig), Report(), []
    wire.open(lambda frame, _: taken.append(codec.take(frame, report)))
    wire.order(codec.disable(), 0)
    for _ in range(100):
        wire.wait(0.05)
        wire.drain(0)
        if taken:
            break
    assert taken == [Taken.MEASURED]
    assert report.position * part.scale == pytest.approx(0.0123, abs=1e-6)
    wire.close()
    adapter.close()


class Standing:
    """A plant that stands still."""

    reported_position, velocity, servo_force = 0.0123, 0.0, 0.0

    def power_off(self) -> None:
        """Lose power."""


def line_of(can_id: int, data: bytes) -> bytes:
    """The line for a frame that a moteus sent, its marks of length and CAN FD taken off."""
    return b"rcv %X %s E B F r t7 f-1" % (can_id & 0x1FFF_FFFF, data.hex().upper().encode())
