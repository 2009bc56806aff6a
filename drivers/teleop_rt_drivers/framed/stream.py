"""A stream of bytes: a serial port's descriptor, read without pyserial's own loop."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import select
import termios
import time
from collections.abc import Sequence
from typing import Protocol

import serial

from teleop_rt.axis import AxisError

READ_BYTES = 4096
"""Bytes that the kernel's terminal layer holds at most (N_TTY_BUF_SIZE)."""
MOST_READS_PER_CYCLE = 4
"""A cycle of 1 ms at 3 Mbit/s brings 300 bytes; a flood must not hold the loop."""
CONTROL_CHARACTERS = 6
"""The place of `cc`, and so of VMIN and VTIME, in the list of termios.tcgetattr."""
_NO_COUNT = bytes(4)
_HELD = {errno.EAGAIN, errno.EBUSY}
_LOOKS = 8
"""Looks at terminals while arrivals are watched: a `select` may wait longer than it is asked to, as
a read may. Stamps deviate by 0.04 of the time that is watched, of the 0.1 that a rig counts on."""


class StreamGoneError(Exception):
    """The other end is gone: cable pulled, adapter unplugged, pseudo-terminal closed."""


Arrivals = list[tuple[int, bytes]]
"""Bytes that have been read already, each with the time of its arrival [ns]."""


class Watched(Protocol):
    """A line or a bus that `keep_arrivals` watches.

    `empty_ns` is when it was last seen to hold nothing, 0 while nobody watches it: bytes found
    next arrived since. One that `is_terminal` is looked at, not waited for: see `_LOOKS`.
    """

    empty_ns: int
    is_terminal: bool

    @property
    def descriptor(self) -> int:
        """The readable descriptor of an arrival; -1 where there is none, or frames have stamps."""

    def keep(self) -> None:
        """Read the arrived bytes, and keep them with their time. Raises StreamGoneError."""


def arrived_between(empty_ns: int, now_ns: int) -> int:
    """Return when that arrived which is found now: half way since there was nothing."""
    return (empty_ns + now_ns) // 2 if empty_ns else now_ns


class ByteStream(Protocol):
    """Bytes both ways, never waiting. `kept` is read before anything else, and emptied.

    `arrived_ns` is when that arrived which was read last, 0 while nobody watches.
    """

    kept: Arrivals
    arrived_ns: int

    def read(self) -> bytes:
        """Return the arrived bytes, b"" for none. Raises StreamGoneError."""

    def write(self, data: bytes) -> bool:
        """Send; false where the bytes are not taken now. Raises StreamGoneError."""

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive, no longer than that."""

    def flush(self) -> None:
        """Drop the arrived bytes."""

    def close(self) -> None:
        """Release the stream."""


class DescriptorStream:
    """An open descriptor in non-blocking mode, whose end of file means that it is gone.

    One that `is_terminal` is read only where something waits: see `read_delivered`.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.is_terminal = os.isatty(descriptor)
        self.kept: Arrivals = []
        self.empty_ns = self.arrived_ns = 0

    def fileno(self) -> int:
        """Return the descriptor, for waiting on it."""
        return self._descriptor

    @property
    def descriptor(self) -> int:
        """Return the descriptor, which an arrival makes readable."""
        return self._descriptor

    def keep(self) -> None:
        """Read the arrived bytes, and keep them with their time. Raises StreamGoneError."""
        data = self.read()
        self.kept.append((self.arrived_ns, data))

    def read(self) -> bytes:
        """Return the arrived bytes, b"" for none. Raises StreamGoneError."""
        data = b""
        try:
            if not self.is_terminal or _waits(self._descriptor):
                data = os.read(self._descriptor, READ_BYTES)
                if not data:
                    raise StreamGoneError("end of file")
        except BlockingIOError:
            pass
        except OSError as error:
            raise StreamGoneError(str(error)) from error
        if self.empty_ns:
            now_ns = time.monotonic_ns()
            self.arrived_ns = arrived_between(self.empty_ns, now_ns)
            self.empty_ns = now_ns
        return data

    def write(self, data: bytes) -> bool:
        """Send; false where the bytes are not taken now. Raises StreamGoneError."""
        try:
            return os.write(self._descriptor, data) == len(data)
        except BlockingIOError:
            return False
        except OSError as error:
            raise StreamGoneError(str(error)) from error

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive, no longer than that."""
        select.select([self._descriptor], [], [], timeout_s)

    def flush(self) -> None:
        """Drop the arrived bytes."""
        self.kept.clear()
        with contextlib.suppress(termios.error):
            termios.tcflush(self._descriptor, termios.TCIFLUSH)

    def close(self) -> None:
        """Release the descriptor."""
        os.close(self._descriptor)


class SerialStream(DescriptorStream):
    """A serial port that pyserial opened and configured; only its descriptor is used from then on.

    pyserial sets VMIN and VTIME to 0, with which a read returns b"" both when nothing has come
    and when the cable is pulled. With VMIN 1 the first is EAGAIN.
    """

    def __init__(self, path: str, baud: int) -> None:
        try:
            self._serial = serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
            super().__init__(self._serial.fileno())
            attributes = termios.tcgetattr(self._serial.fileno())
            attributes[CONTROL_CHARACTERS][termios.VMIN] = b"\x01"
            termios.tcsetattr(self._serial.fileno(), termios.TCSANOW, attributes)
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            step = (
                f"another program has it open: `fuser {path}` shows which"
                if getattr(error, "errno", None) in _HELD
                else "`ls -l /dev/serial/by-id` shows the devices that are plugged in, and the user"
                " must be in the group that owns it"
            )
            number = getattr(
                error, "errno", None
            )  # pyserial's own text names the port again, twice
            cause = str(error) if number is None else os.strerror(number)
            raise AxisError(f"cannot open the serial port {path}: {cause}; {step}") from error
        # Not every adapter knows it; those that do answer up to 15 ms sooner.
        with contextlib.suppress(OSError, ValueError):
            self._serial.set_low_latency_mode(True)

    def close(self) -> None:
        """Release the port."""
        self._serial.close()


def keep_arrivals(watched: Sequence[Watched], seconds: float) -> None:
    """Wait so long, and keep bytes that arrive meanwhile with their own time.

    Bytes that are there at once came between two reads. The next read reports a device that left.
    """
    by_descriptor = {one.descriptor: one for one in watched if one.descriptor >= 0}
    terminals = [descriptor for descriptor, one in by_descriptor.items() if one.is_terminal]
    look_ns = round(1e9 * seconds / (_LOOKS if terminals else 1))
    end_ns = time.monotonic_ns() + round(1e9 * seconds)
    left_ns = 0
    while left_ns >= 0:
        others = [descriptor for descriptor in by_descriptor if descriptor not in terminals]
        arrived, _, _ = select.select(others, (), (), min(left_ns, look_ns) * 1e-9)
        delivered = [descriptor for descriptor in terminals if _holds(descriptor)]
        now_ns = time.monotonic_ns()
        for descriptor, one in by_descriptor.items():
            found = descriptor in delivered or (descriptor in arrived and not left_ns)
            if not (found and one.empty_ns):
                one.empty_ns = now_ns
        for descriptor in (*arrived, *delivered):
            try:
                by_descriptor[descriptor].keep()
            except StreamGoneError:
                del by_descriptor[descriptor]
                terminals = [one for one in terminals if one != descriptor]
        left_ns = end_ns - now_ns or -1
    for one in watched:
        if one.descriptor < 0 and not one.empty_ns:
            one.empty_ns = now_ns


def _waits(descriptor: int) -> bool:
    """Return whether a terminal's driver has delivered something. Raises OSError."""
    return fcntl.ioctl(descriptor, termios.FIONREAD, _NO_COUNT) != _NO_COUNT


def _holds(descriptor: int) -> bool:
    """Return whether a read of a terminal finds something: bytes, or that it is gone."""
    try:
        return _waits(descriptor)
    except OSError:
        return True
