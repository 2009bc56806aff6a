"""A serial port as a source of frames."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from teleop_rt.axis import NO_AXIS_FAULT, AxisError, AxisFault
from teleop_rt_drivers.framed.binary import BinaryPacker, BinaryParser, binary_fields
from teleop_rt_drivers.framed.format import BinaryFormat, load_format
from teleop_rt_drivers.framed.source import Source
from teleop_rt_drivers.framed.stream import (
    MOST_READS_PER_CYCLE,
    READ_BYTES,
    DescriptorStream,
    StreamGoneError,
    arrived_between,
)
from teleop_rt_drivers.framed.text import TextParser, text_fields
from teleop_rt_drivers.framed.whole_frame import NOTHING
from teleop_rt_drivers.framed.written_frame import NO_WORD

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt_drivers.framed.config import SerialPortConfig
    from teleop_rt_drivers.framed.source import Values
    from teleop_rt_drivers.framed.stream import ByteStream, Watched
    from teleop_rt_drivers.framed.written_frame import StoredAim


class SerialPort:
    """One device on a serial port: it sends one kind of frame, and may take one.

    Arrivals on it may be watched: they are decoded as they come, each with its own time.
    """

    def __init__(
        self,
        name: str,
        config: SerialPortConfig,
        open_stream: Callable[[], ByteStream],
        counters: dict[str, int],
    ) -> None:
        self.fault = NO_AXIS_FAULT
        self.empty_ns = 0
        self.descriptor = -1
        self.is_terminal = False
        self._counters = counters
        self._open_stream = open_stream
        self._stream: ByteStream | None = None
        self._binary: BinaryParser | None = None
        self._start = bytes.fromhex(config.start)
        self._request = bytes.fromhex(config.request)
        frame = load_format(config.format)
        if isinstance(frame, BinaryFormat):
            source = Source(name, binary_fields(frame))
            self._binary = BinaryParser(frame, source, counters)
            self._parser: BinaryParser | TextParser = self._binary
        else:
            source = Source(name, text_fields(frame))
            self._parser = TextParser(frame, source, counters)
        self.sources = {name: source}
        self.commands: dict[str, Source] = {}
        self._packer: BinaryPacker | None = None
        if config.command_format is not None:
            command = load_format(config.command_format)
            if not isinstance(command, BinaryFormat):
                raise AxisError(
                    f"port {name}: a command must be binary: name a format with `kind: binary`"
                )
            self._packer = BinaryPacker(command)
            self.commands[name] = Source(name, self._packer.fields)

    @property
    def watched(self) -> list[Watched]:
        """The open line, whose arrivals can be kept."""
        return [] if self.descriptor < 0 else [self]

    @property
    def only_listens(self) -> bool:
        """Whether it is an open terminal on which a cycle has nothing to do unless bytes come."""
        return self.is_terminal and self.descriptor >= 0 and not self._request

    def open(self) -> None:
        """Open the port, or reset the open one. Raises AxisError."""
        if self.fault is not NO_AXIS_FAULT:
            self.close()
        if self._stream is None:
            self._stream = self._open_stream()
            if isinstance(self._stream, DescriptorStream):
                self.descriptor = self._stream.descriptor
                self.is_terminal = self._stream.is_terminal
        self.fault = NO_AXIS_FAULT
        self._stream.flush()
        self._parser.reset()
        if self._start:
            self._write(self._start)
        if self._request:
            self._write(self._request)

    def drain(self, now_ns: int) -> None:
        """Decode all that has arrived, and ask for the next where the device waits for it."""
        stream, binary = self._stream, self._binary
        if stream is None or self.fault is not NO_AXIS_FAULT:
            return
        if stream.kept:
            for arrived_ns, data in stream.kept:
                self._parser.feed(data, arrived_ns)
            stream.kept.clear()
        try:
            if binary is None or self.descriptor < 0 or (read := binary.read) is None:
                received = self._receive(stream, now_ns)
            else:  # nearly always, and so with few calls
                found = read(self.descriptor, self.is_terminal, self.empty_ns, now_ns)
                self.empty_ns = now_ns if self.empty_ns else 0
                received = binary.take_read(found) if found != NOTHING else 0
            if received >= READ_BYTES:
                self._receive_more(stream, now_ns)
        except StreamGoneError:
            self.fault = AxisFault.UNPLUGGED
            return
        if self._request:
            self._write(self._request)

    def keep(self) -> None:
        """Decode the arrived bytes, with their time. Raises StreamGoneError."""
        if self._stream is not None:
            self._receive(self._stream, time.monotonic_ns())

    def _receive(self, stream: ByteStream, now_ns: int) -> int:
        """Read and decode once; return how many bytes that was."""
        binary, empty_ns = self._binary, self.empty_ns
        self.empty_ns = now_ns if empty_ns else 0
        if binary is not None and self.descriptor >= 0 and binary.read is not None:
            found = binary.read(self.descriptor, self.is_terminal, empty_ns, now_ns)
            return binary.take_read(found)
        arrived_ns = arrived_between(empty_ns, now_ns)
        data = stream.read()
        if data:
            self._parser.feed(data, stream.arrived_ns or arrived_ns)
        return len(data)

    def _receive_more(self, stream: ByteStream, now_ns: int) -> None:
        """Read and decode the bytes left after a whole read; a flood is left for the next cycle."""
        for _ in range(MOST_READS_PER_CYCLE - 1):
            if self._receive(stream, now_ns) < READ_BYTES:
                return
        self._counters["flood"] += 1

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive, no longer than that."""
        if self._stream is not None and self.fault is NO_AXIS_FAULT:
            self._stream.wait(timeout_s)

    def send(self, command: str, values: Values) -> None:  # noqa: ARG002 - the port has but one
        """Send a command frame of raw values."""
        packer = self._packer
        if packer is None or self.fault is not NO_AXIS_FAULT:
            return
        writer = None if self.descriptor < 0 else packer.writer
        sent = NO_WORD if writer is None else writer.send(values, self.descriptor)
        if writer is None or sent == NO_WORD:
            self._write(packer.pack(values))
        elif sent < writer.size:
            self._note_unsent(sent)

    def target_sender(self, aim: StoredAim) -> Callable[[float], bool] | None:
        """Return a sender of a drive's target in one step: see `FramedPort`."""
        writer = None if self._packer is None else self._packer.writer
        if writer is None:
            return None
        send_target, size = writer.target_sender(aim), writer.size

        def send(target: float) -> bool:
            if self.descriptor < 0 or self.fault is not NO_AXIS_FAULT:
                return False
            if (sent := send_target(target, self.descriptor)) < size:
                if sent == NO_WORD:
                    return False
                self._note_unsent(sent)
            return True

        return send

    def _note_unsent(self, sent: int) -> None:
        """Note that a line took so few bytes of a frame; minus an error's number, it is gone."""
        if sent < 0:
            self.fault = AxisFault.UNPLUGGED
        else:
            self._counters["send_failed"] += 1

    def close(self) -> None:
        """Release the port."""
        stream, self._stream = self._stream, None
        self.descriptor, self.empty_ns = -1, 0
        if stream is not None:
            stream.close()

    def _write(self, data: bytes) -> None:
        if self._stream is None or self.fault is not NO_AXIS_FAULT:
            return
        try:
            if not self._stream.write(data):
                self._counters["send_failed"] += 1
        except StreamGoneError:
            self.fault = AxisFault.UNPLUGGED
