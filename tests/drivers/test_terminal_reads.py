"""A terminal is read only where something waits: a read that finds nothing may wait for others."""

from __future__ import annotations

import errno
import os
import pty
import select
import termios
import tty

import numpy as np
import pytest

from teleop_rt.realtime.system_calls import read_bytes, read_delivered
from teleop_rt_drivers.framed.stream import VMIN, DescriptorStream, StreamGoneError


@pytest.fixture
def line():
    """Both ends of a line whose near end ends a read at once: then 0 bytes mean that it is gone."""
    far, near = pty.openpty()
    tty.setraw(near)
    attributes = termios.tcgetattr(near)
    attributes[VMIN][termios.VMIN] = attributes[VMIN][termios.VTIME] = 0
    termios.tcsetattr(near, termios.TCSANOW, attributes)
    ends = {"near": near, "far": far}
    yield ends
    for end in ends.values():
        os.close(end)


def delivered(line: dict[str, int], memory: np.ndarray) -> int:
    return read_delivered(line["near"], memory, memory.ctypes.data)


def test_what_has_not_come_is_not_read(line):
    memory = np.zeros(64, np.uint8)
    assert read_bytes(line["near"], memory.ctypes.data, len(memory)) == -errno.EPIPE, "it was read"
    assert delivered(line, memory) == 0
    assert DescriptorStream(line["near"]).read() == b""


def test_what_has_come_is_read_whole_and_no_longer_than_there_is_room(line):
    memory, sent = np.zeros(64, np.uint8), bytes(range(100))
    os.write(line["far"], sent)
    select.select([line["near"]], [], [], 10.0)
    assert delivered(line, memory) == 64
    assert memory.tobytes() == sent[:64]
    assert delivered(line, memory) == 36
    assert memory.tobytes()[:36] == sent[64:]
    assert delivered(line, memory) == 0
    os.write(line["far"], b"more")
    select.select([line["near"]], [], [], 10.0)
    assert DescriptorStream(line["near"]).read() == b"more"


def test_a_line_whose_other_end_is_closed_is_gone(line):
    stream, memory = DescriptorStream(line["near"]), np.zeros(64, np.uint8)
    os.close(line.pop("far"))
    assert delivered(line, memory) == -errno.EIO
    with pytest.raises(StreamGoneError):
        stream.read()


def test_what_is_no_terminal_is_read_until_its_end():
    near, far = os.pipe()
    os.set_blocking(near, False)
    stream = DescriptorStream(near)
    assert stream.read() == b""
    os.write(far, b"last")
    os.close(far)
    assert stream.read() == b"last"
    with pytest.raises(StreamGoneError, match="end of file"):
        stream.read()
    stream.close()
