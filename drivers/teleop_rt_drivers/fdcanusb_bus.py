"""An fdcanusb (mjbots) as a CAN interface: lines of text on a serial port, CAN FD included.

Source: mjbots/fdcanusb, README.md. Each command is a line that the adapter answers with OK or
ERR; frames that arrive come as lines `rcv ID DATA FLAGS` in between.
"""

from __future__ import annotations

import contextlib
import errno
import re
import time
from collections import deque

import can

from teleop_rt.axis import AxisError
from teleop_rt_drivers.framed.stream import SerialStream, StreamGoneError

BAUD = 1_000_000
"""Bit rate of the port; the adapter ignores it, because the port is USB."""
ANSWER_S = 0.5
"""Longest wait for the adapter's answer to a command."""
LONGEST_LINE = 256
"""Bytes of 64 data bytes in hexadecimal, with id and flags, and room."""
RECEIVED = re.compile(
    rb"rcv ([0-9A-Fa-f]{1,8}) ((?:[0-9A-Fa-f]{2})*)((?: (?:[EeBbFfRr]|t\d+|f-?\d+))*)"
)
MOST_STANDARD = 0x7FF
"""Largest identifier of 11 bits."""


class FdcanusbBus(can.BusABC):
    """The adapter, its bus on. Neither send nor recv waits, but `recv` for its timeout."""

    def __init__(
        self, channel: str, bitrate: int | None, data_bitrate: int | None, *, fd: bool
    ) -> None:
        super().__init__(channel)
        self.channel_info = f"fdcanusb {channel}"
        self._fd = fd
        self._begun = bytearray()
        self._frames: deque[can.Message] = deque()
        self._answers: deque[bytes] = deque(maxlen=16)
        self._refused = b""
        self._stream = SerialStream(channel, BAUD)
        try:
            self._begin(bitrate, data_bitrate)
        except BaseException:
            self.shutdown()
            raise

    def _begin(self, bitrate: int | None, data_bitrate: int | None) -> None:
        """Set the bit rates, which needs the bus off, and go on the bus."""
        self._stream.flush()
        self._ask("can off", may_fail=True)  # an error where it is off already
        for key, value in (
            ("bitrate", bitrate),
            ("fd_bitrate", data_bitrate or bitrate),
            ("fdcan_frame", int(self._fd)),
            ("bitrate_switch", int(self._fd)),
            ("automatic_retransmission", 1),
        ):
            if value is not None:
                self._ask(f"conf set can.{key} {value}")
        self._ask("can on")
        self._answers.clear()
        self._frames.clear()

    def _ask(self, command: str, *, may_fail: bool = False) -> None:
        """Send a command and wait for its answer. Raises AxisError."""
        self._answers.clear()
        self._write(command)
        end_s = time.monotonic() + ANSWER_S
        while not self._answers and (left_s := end_s - time.monotonic()) > 0:
            self._stream.wait(left_s)
            self._read()
        if not self._answers:
            raise AxisError(f"{self.channel_info}: no answer to `{command}`: is it an fdcanusb?")
        if (answer := self._answers.popleft()) != b"OK" and not may_fail:
            raise AxisError(
                f"{self.channel_info}: `{command}`: {answer.decode('ascii', 'replace')}"
            )

    def fileno(self) -> int:
        """Return the port's descriptor, for waiting on it."""
        return self._stream.fileno()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - as the interface has it
        """Send a frame; raises CanOperationError where it is not taken, or the last was refused."""
        kind = "ext" if msg.is_extended_id else "std"
        flags = f"{'F' if msg.is_fd else 'f'} {'B' if msg.bitrate_switch else 'b'}"
        self._write(f"can {kind} {msg.arbitration_id:x} {bytes(msg.data).hex()} {flags}")
        if self._refused:
            refused, self._refused = self._refused.decode("ascii", "replace"), b""
            raise can.CanOperationError(f"the adapter refused a frame: {refused}")

    def _write(self, line: str) -> None:
        try:
            taken = self._stream.write(f"{line}\n".encode("ascii"))
        except StreamGoneError as error:
            raise can.CanOperationError(f"the adapter is gone: {error}", errno.ENODEV) from error
        if not taken:
            raise can.CanOperationError("the adapter takes no more lines", errno.ENOBUFS)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._frames:
            self._read()
        if not self._frames and timeout:
            self._stream.wait(timeout)
            self._read()
        return (self._frames.popleft(), False) if self._frames else (None, False)

    def _read(self) -> None:
        """Take whole lines: frames and answers; others are dropped."""
        try:
            self._begun += self._stream.read()
        except StreamGoneError as error:
            raise can.CanOperationError(f"the adapter is gone: {error}", errno.ENODEV) from error
        *lines, rest = bytes(self._begun).split(b"\n")
        self._begun = bytearray(rest if len(rest) <= LONGEST_LINE else b"")
        for line in lines:
            self._take(line.rstrip(b"\r"))

    def _take(self, line: bytes) -> None:
        if line == b"OK" or line.startswith(b"ERR"):
            self._answers.append(line)
            self._refused = line if line != b"OK" else self._refused
        elif (found := RECEIVED.fullmatch(line)) and (frame := received(*found.groups())):
            self._frames.append(frame)

    def shutdown(self) -> None:
        """Leave the bus, and release the port."""
        if not self._is_shutdown:
            super().shutdown()
            with contextlib.suppress(can.CanError):
                self._write("can off")
            self._stream.close()


def received(identifier: bytes, data: bytes, flags: bytes) -> can.Message | None:
    """Return the frame of a line, None for one that cannot be."""
    marks = flags.split()
    can_id, wide = int(identifier, 16), b"F" in marks
    extended = b"E" in marks or (b"e" not in marks and can_id > MOST_STANDARD)
    if b"R" in marks:
        return None
    try:
        return can.Message(
            arbitration_id=can_id,
            is_extended_id=extended,
            is_fd=wide,
            bitrate_switch=b"B" in marks,
            data=bytes.fromhex(data.decode("ascii")),
            check=True,
        )
    except ValueError:
        return None
