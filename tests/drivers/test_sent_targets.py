"""Targets of a drive on a line, which go out in one step as the bytes of a frame."""

from __future__ import annotations

import os
import pty
import select
import tty

import pytest
from framed_bench import load
from rig_bench import MS, START_NS

from teleop_rt.axis import AxisFault
from teleop_rt_drivers.framed.binary import BinaryPacker
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.framed.drive import FramedDrive
from teleop_rt_drivers.framed.format import load_format
from teleop_rt_drivers.framed.serial_port import SerialPort
from teleop_rt_drivers.framed.stream import DescriptorStream
from teleop_rt_drivers.quantity import Scale

SCALE = Scale(1.0e-6, -1, 0.25)
FOLLOWS, FOLLOW = 1, 1
OUT_OF_RANGE = 1e6
POSITIONS = (0.0, -0.0125, 0.2500005, 0.2500015, 0.0371, OUT_OF_RANGE, -OUT_OF_RANGE)


class Line:
    """A drive on a terminal, which follows; its far end is here."""

    def __init__(self, zero: str = "encoder") -> None:
        part = load("serial").axis
        config = part.drive.model_copy(update={"zero": zero})
        self.far, near = pty.openpty()
        for end in (near, self.far):
            tty.setraw(end)
            os.set_blocking(end, False)
        self.counters = FramedCounters()
        self.port = SerialPort(
            "drive", part.ports["drive"], lambda: DescriptorStream(near), self.counters
        )
        answer = self.port.sources["drive"]
        self.drive = FramedDrive(config, self.port, answer, (SCALE, SCALE), self.counters)
        self.port.open()
        self.drive.arm()
        answer.deliver([0.0, FOLLOWS, 0.0], START_NS)
        self.drive.settle(START_NS + MS)
        format_ = load_format(part.ports["drive"].command_format)
        self._packer, self._size = BinaryPacker(format_), format_.size

    def packed(self, counts: int) -> bytes:
        """Return the next frame of a command to follow to these counts."""
        return self._packer.pack([0.0, FOLLOW, counts])

    def said(self, frames: int = 1) -> bytes:
        """Return so many frames sent since, as soon as the terminal has delivered them."""
        data = b""
        while len(data) < frames * self._size:
            assert select.select([self.far], [], [], 10.0)[0], "nothing more was sent"
            data += os.read(self.far, 4096)
        return data

    def close(self) -> None:
        self.port.close()
        os.close(self.far)


@pytest.fixture
def step_by_step(monkeypatch):
    """Refuse frames that are sent step by step."""
    return lambda port: monkeypatch.setattr(
        port, "send", lambda *_: pytest.fail("it was sent step by step")
    )


def test_a_target_is_sent_in_one_step_as_the_bytes_that_its_counts_make(step_by_step):
    line = Line()
    step_by_step(line.port)
    for position in POSITIONS:
        line.drive.command(position)
        assert line.said() == line.packed(SCALE.counts(position))
    line.close()


def test_counts_go_on_where_frames_are_sent_either_way():
    line = Line()
    line.drive.command(0.01)
    line.port.send("drive", [0.0, 2.0, 5.0])
    line.drive.command(0.02)
    frames = line.packed(SCALE.counts(0.01)), line._packer.pack([0.0, 2.0, 5.0])
    assert line.said(3) == b"".join((*frames, line.packed(SCALE.counts(0.02))))
    line.close()


def test_a_drive_that_counts_from_anywhere_is_sent_no_jump():
    line = Line(zero="unknown")
    line.drive.command(0.1)
    assert line.said() == line.packed(0), "where it stands"
    line.drive.command(0.101)
    assert line.said() == line.packed(-1000)
    line.close()


def test_a_target_that_is_no_number_repeats_the_last_and_is_counted():
    line = Line()
    line.drive.command(0.01)
    line.drive.command(float("nan"))
    assert line.said(2) == line.packed(SCALE.counts(0.01)) + line.packed(SCALE.counts(0.01))
    assert line.counters["bad_command"] == 1
    line.close()


def test_a_line_that_takes_no_more_is_counted_and_one_that_ended_is_a_fault():
    line = Line()
    for _ in range(100_000):
        line.drive.command(0.01)
        if line.counters["send_failed"]:
            break
    assert line.counters["send_failed"] == 1
    assert line.port.fault is AxisFault.NONE
    os.close(line.far)
    line.drive.command(0.01)
    assert line.port.fault is AxisFault.UNPLUGGED
    line.drive.command(0.02)
    assert line.counters["send_failed"] == 1
    line.port.close()
