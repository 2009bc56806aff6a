"""A terminal is read only where something waits: a read that finds nothing may wait for others."""

from __future__ import annotations

import errno
import os
import pty
import select
import termios
import time
import tty
from types import SimpleNamespace

import numpy as np
import pytest

from teleop_rt.realtime.system_calls import read_bytes, read_delivered
from teleop_rt_drivers.framed import stream as stream_module
from teleop_rt_drivers.framed.stream import (
    CONTROL_CHARACTERS,
    DescriptorStream,
    StreamGoneError,
    keep_arrivals,
)


@pytest.fixture
def line():
    """Both ends of a line whose near end ends a read at once: then 0 bytes mean that it is gone."""
    far, near = pty.openpty()
    tty.setraw(near)
    attributes = termios.tcgetattr(near)
    control = attributes[CONTROL_CHARACTERS]
    control[termios.VMIN] = control[termios.VTIME] = 0
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


def test_arrivals_on_a_terminal_are_kept_without_waiting_for_it(line, monkeypatch):
    """A terminal is never among those that are waited for; bytes come between two looks."""
    waited: list[list[int]] = []
    looks = iter([b"", b"first", b"", b"second"])
    stream = DescriptorStream(line["near"])
    times: list[int] = []

    def wait(descriptors, *_):
        waited.append(list(descriptors))
        times.append(time.monotonic_ns())
        if data := next(looks, b""):
            os.write(line["far"], data)
            poll_ended.select([line["near"]], [], [], 10.0)
        return [], [], []

    poll_ended = SimpleNamespace(select=select.select)
    monkeypatch.setattr(stream_module, "select", SimpleNamespace(select=wait))
    keep_arrivals([stream], 1e-3)
    while len(times) < 5:
        keep_arrivals([stream], 1e-3)
    assert [data for _, data in stream.kept] == [b"first", b"second"]
    assert not any(waited)
    for (arrived_ns, _), look in zip(stream.kept, (1, 3), strict=True):
        assert times[look - 1] <= arrived_ns <= times[look + 1]


def test_a_terminal_that_is_gone_ends_no_watch_and_is_found_by_the_next_read(line):
    stream = DescriptorStream(line["near"])
    os.close(line.pop("far"))
    keep_arrivals([stream], 1e-4)
    assert stream.kept == []
    with pytest.raises(StreamGoneError):
        stream.read()
