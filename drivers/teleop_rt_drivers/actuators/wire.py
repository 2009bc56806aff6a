"""The wire of a maker's frames: a CAN bus, or a half-duplex serial line."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Protocol

from teleop_rt.axis import AxisFault
from teleop_rt_drivers.actuators.codec import Frame
from teleop_rt_drivers.can_frames import EXTENDED, EXTENDED_MASK
from teleop_rt_drivers.framed.can_port import CanEnd
from teleop_rt_drivers.framed.stream import (
    MOST_READS_PER_CYCLE,
    READ_BYTES,
    DescriptorStream,
    StreamGoneError,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from teleop_rt_drivers.actuators.codec import Frames, LineCodec
    from teleop_rt_drivers.framed.stream import ByteStream, Watched

    Heard = Callable[[Frame, int], None]

SETTLE_S = 0.005
"""Time that a drive on a line has for each packet of its set-up, which it does not answer."""
REMEMBERED = 16
"""Packets sent lately, by which an adapter's echo is known; the longest set-up has twelve."""


class Wire(Protocol):
    """Frames out and in, never waiting but in `open`, `settle` and `wait`."""

    fault: AxisFault
    arrived_ns: int
    """When the frame that is handed on arrived; 0 where that is not known."""

    @property
    def watched(self) -> Sequence[Watched]:
        """The open line or bus, whose arrivals can be kept."""

    def open(self, heard: Heard) -> None:
        """Reset, and pass received frames to `heard`. Raises AxisError."""

    def order(self, frames: Frames, now_ns: int) -> bool:
        """Send the frames of an order; false where the wire is not free for them now."""

    def drain(self, now_ns: int) -> None:
        """Hand on all that has arrived."""

    def settle(self) -> None:
        """Give the drive time for packets that it does not answer."""

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive, no longer than that."""

    def raise_fault(self, fault: AxisFault) -> None:
        """Latch the first fault."""

    def close(self) -> None:
        """Release the wire."""


class CanWire(CanEnd):
    """A CAN bus that it takes over and closes."""

    _heard: Heard
    arrived_ns = 0

    def open(self, heard: Heard) -> None:
        """Reset."""
        self.begin()
        self._heard = heard

    def take(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Hand a data frame on."""
        self.arrived_ns = now_ns if self.empty_ns else 0
        self._heard(Frame(can_id & EXTENDED_MASK, data, bool(can_id & EXTENDED)), now_ns)

    def order(self, frames: Frames, now_ns: int) -> bool:  # noqa: ARG002 - a bus arbitrates itself
        """Send the frames of an order; the bus is always free for them."""
        for frame in frames:
            flags = EXTENDED if frame.extended else 0
            self.transmit(frame.can_id | flags, frame.data, wide=frame.fd)
        return True

    def settle(self) -> None:
        """Return at once: a controller on a CAN bus queues its frames."""


class LineWire:
    """A half-duplex serial line: two that speak at once spoil both packets.

    So nothing is sent within `turn_ns` of an order that has not been answered. An adapter may echo
    the sent bytes: a packet of our own is no answer.
    """

    _heard: Heard

    def __init__(
        self,
        codec: LineCodec,
        open_stream: Callable[[], ByteStream],
        counters: dict[str, int],
        turn_ns: int,
    ) -> None:
        self.fault = AxisFault.NONE
        self._codec = codec
        self._open_stream = open_stream
        self._counters = counters
        self._turn_ns = turn_ns
        self._stream: ByteStream | None = None
        self._arrived = bytearray()
        self._sent: deque[bytes] = deque(maxlen=REMEMBERED)
        self._answered = True
        self._ordered_ns = self.arrived_ns = 0

    @property
    def watched(self) -> list[Watched]:
        """The open line."""
        return [self._stream] if isinstance(self._stream, DescriptorStream) else []

    def open(self, heard: Heard) -> None:
        """Open the port, or reset the open one. Raises AxisError."""
        self._heard = heard
        if self.fault is not AxisFault.NONE:
            self.close()
        if self._stream is None:
            self._stream = self._open_stream()
        self.fault = AxisFault.NONE
        self._stream.flush()
        self._arrived.clear()
        self._answered = True

    def order(self, frames: Frames, now_ns: int) -> bool:
        """Send the packets of an order at once, unless the drive may be answering the last."""
        if not self._answered and now_ns - self._ordered_ns < self._turn_ns:
            self._counters["line_busy"] += 1
            return False
        if self._stream is None or self.fault is not AxisFault.NONE:
            return False
        self._sent.extend(frame.data for frame in frames)
        self._answered, self._ordered_ns = False, now_ns
        try:
            if not self._stream.write(b"".join(frame.data for frame in frames)):
                self._counters["send_failed"] += 1
        except StreamGoneError:
            self.raise_fault(AxisFault.UNPLUGGED)
        return True

    def drain(self, now_ns: int) -> None:
        """Read the arrived bytes, and hand on each packet whose checksum is right."""
        if self._stream is None or self.fault is not AxisFault.NONE:
            return
        for arrived_ns, data in self._stream.kept:
            self.arrived_ns = arrived_ns
            self._arrived += data
            self._hand_on(now_ns)
        self._stream.kept.clear()
        try:
            for _ in range(MOST_READS_PER_CYCLE):
                data = self._stream.read()
                self.arrived_ns = self._stream.arrived_ns
                self._arrived += data
                if len(data) < READ_BYTES:
                    break
            else:
                self._counters["flood"] += 1
        except StreamGoneError:
            self.raise_fault(AxisFault.UNPLUGGED)
            return
        self._hand_on(now_ns)

    def _hand_on(self, now_ns: int) -> None:
        """Hand on the whole packets."""
        while packet := self._next_packet():
            if packet not in self._sent:
                self._answered = True
                self._heard(Frame(0, packet), now_ns)

    def _next_packet(self) -> bytes:
        """Return the next sound packet, b"" where none is whole; search on where one is not."""
        arrived, codec, counters = self._arrived, self._codec, self._counters
        while (begin := arrived.find(codec.header)) >= 0:
            counters["skipped_bytes"] += begin
            del arrived[:begin]
            size = codec.size(arrived)
            if size > codec.longest:
                counters["wrong_length"] += 1
                del arrived[:1]
                continue
            if size == 0 or size > len(arrived):
                return b""
            packet = bytes(arrived[:size])
            if codec.sound(packet):
                del arrived[:size]
                return packet
            counters["bad_checksum"] += 1
            del arrived[:1]
        # The last bytes may be the beginning of a header.
        spoilt = max(0, len(arrived) - len(codec.header) + 1)
        counters["skipped_bytes"] += spoilt
        del arrived[:spoilt]
        return b""

    def settle(self) -> None:
        """Wait a moment; nothing answers."""
        self._answered = True
        self.wait(SETTLE_S)

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive, no longer than that."""
        if self._stream is not None and self.fault is AxisFault.NONE:
            self._stream.wait(timeout_s)

    def raise_fault(self, fault: AxisFault) -> None:
        """Latch the first fault; later ones are its consequences."""
        if self.fault is AxisFault.NONE:
            self.fault = fault

    def close(self) -> None:
        """Release the port."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()
