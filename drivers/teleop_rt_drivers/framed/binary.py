"""Binary frames in a byte stream: found by their sync bytes, believed by their checksum."""

from __future__ import annotations

import math
import os
import struct
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt_drivers.framed.checksum import checksum
from teleop_rt_drivers.framed.format import SIZE, THREE_BYTES
from teleop_rt_drivers.framed.source import FieldInfo
from teleop_rt_drivers.framed.stream import StreamGoneError
from teleop_rt_drivers.framed.taking import COUNTERS
from teleop_rt_drivers.framed.whole_frame import (
    FINE,
    NOTHING,
    OTHER,
    WholeFrames,
    counter_codes,
    fits,
    is_exact,
)
from teleop_rt_drivers.framed.written_frame import FrameWriter

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from teleop_rt_drivers.framed.format import BinaryFormat
    from teleop_rt_drivers.framed.source import Source, Values

    Whole = NDArray[np.int64]


def binary_fields(frame: BinaryFormat) -> tuple[FieldInfo, ...]:
    """Return the fields of a format."""
    return tuple(
        FieldInfo(field.name, field.unit, field.scale / field.divisor, field.offset)
        for field in frame.fields
    )


class FrameCounter:
    """Watches a field that counts up: a repeated frame is rejected, a gap is counted.

    `newest` (1,) is the newest count, -1 before any; kernels may read and write it, too.
    """

    def __init__(self, slot: int, modulo: int, counters: dict[str, int]) -> None:
        self._slot = slot
        self._modulo = modulo
        self._counters = counters
        self.newest: Whole = np.full(1, -1, np.int64)
        self._last = self.newest.data

    def reset(self) -> None:
        """Begin with whatever comes."""
        self._last[0] = -1

    def accept(self, values: Values) -> bool:
        """Take a frame's count; false for the one that was seen last."""
        raw, last = values[self._slot], self._last[0]
        if not math.isfinite(raw):
            self._counters["not_a_number"] += 1
            return False
        count = self._last[0] = int(raw)
        if last < 0:
            return True
        if count == last:
            self._counters["repeated"] += 1
            return False
        if (count - last) % self._modulo != 1:
            self._counters["gaps"] += 1
        return True


class BinaryParser:
    """Finds the frames of a stream; after a bad one it looks again from the next byte on.

    A frame that comes whole and alone is taken by kernels, where numbers of 64 bits hold it. `read`
    is the one that reads it, too; None where that is not to be read by a kernel which comes next.
    """

    def __init__(self, frame: BinaryFormat, source: Source, counters: dict[str, int]) -> None:
        self._format = frame
        self._source = source
        self._counters = counters
        self._whole: WholeFrames | None = None
        self.read: Callable[[int, bool, int, int], int] | None = None
        self._sync = bytes.fromhex(frame.sync)
        self._end = bytes.fromhex(frame.end)
        self._struct = struct.Struct(frame.layout)
        self._size = frame.size
        self._checksum_at = frame.checksum_at
        self._span = slice(0, 0)
        self._function = None
        if frame.checksum is not None:
            self._function, _ = checksum(frame.checksum.kind)
            self._span = slice(*(frame.checksum.span or (len(self._sync), self._checksum_at)))
        self._end_at = self._size - len(self._end)
        self._order = frame.byte_order
        self._three_bytes = _three_bytes(frame)
        self._counter = None
        if frame.counter is not None:
            slot = source.slot(frame.counter)
            modulo = 1 << 8 * SIZE[frame.fields[slot].type]
            self._counter = FrameCounter(slot, modulo, counters)
        self._pending = b""

    def reset(self) -> None:
        """Forget a frame that has begun; who listens by now is served by kernels."""
        self._pending = b""
        if self._counter is not None:
            self._counter.reset()
        if self._whole is None and is_exact(self._format, self._source):
            last = np.zeros(1, np.int64) if self._counter is None else self._counter.newest
            self._whole = WholeFrames(self._format, self._source, last)
        self._choose_reader()

    def _choose_reader(self) -> None:
        """Let a kernel read the next bytes, unless a frame has begun."""
        whole = self._whole
        self.read = None if whole is None or self._pending else whole.read

    def take_read(self, found: int) -> int:
        """Take the bytes that `read` has found; return their number. Raises StreamGoneError."""
        whole = self._whole
        if whole is None or found == NOTHING:
            return 0
        if found != OTHER:
            if found != FINE or self._source.others:
                self._hand_on(whole, found, whole.arrived_ns)
            else:  # nearly always
                self._counters["frames"] += 1
            return self._size
        if (received := whole.received) < 0:
            raise StreamGoneError(os.strerror(-received))
        self._find(whole.data(), whole.arrived_ns)
        return received

    def feed(self, data: bytes, now_ns: int) -> None:
        """Take bytes as they came; at most one unfinished frame is kept."""
        whole = None if self._pending else self._whole
        if whole is not None and (found := whole.take(data, len(data), now_ns)):
            self._hand_on(whole, found, now_ns)
        else:
            self._find(data, now_ns)

    def _hand_on(self, whole: WholeFrames, found: int, now_ns: int) -> None:
        """Count a frame that kernels have taken, and give it to those who read it themselves."""
        self._counters["frames"] += 1
        if found != FINE:
            for code in counter_codes(found):
                if code:
                    self._counters[COUNTERS[code]] += 1
        for listener in self._source.others:
            listener(whole.numbers, now_ns)

    def _find(self, data: bytes, now_ns: int) -> None:
        """Find the frames among bytes, and keep the rest."""
        buffer = self._pending + data
        at, end, size = 0, len(buffer), self._size
        while True:
            found = buffer.find(self._sync, at)
            if found < 0:
                found = max(at, end - len(self._sync) + 1)
                self._counters["skipped_bytes"] += found - at
                at = found
                break
            self._counters["skipped_bytes"] += found - at
            at = found
            if end - at < size:
                break
            if problem := self._problem(frame := buffer[at : at + size]):
                self._counters[problem] += 1
                self._counters["skipped_bytes"] += 1
                at += 1
            else:
                self._deliver(frame, now_ns)
                at += size
        self._pending = buffer[at:]
        self._choose_reader()

    def _problem(self, frame: bytes) -> str:
        """Return by which counter a frame's end bytes or checksum are wrong, "" where they fit."""
        if self._end and frame[self._end_at :] != self._end:
            return "bad_end"
        if self._function is not None:
            sent = frame[self._checksum_at : self._end_at]
            if self._function(frame[self._span]) != int.from_bytes(sent, self._order):
                return "bad_checksum"
        return ""

    def _deliver(self, frame: bytes, now_ns: int) -> None:
        values: Values = self._struct.unpack_from(frame)
        if self._three_bytes:
            values = self._with_three_bytes(frame)
        self._counters["frames"] += 1
        if self._counter is None or self._counter.accept(values):
            self._source.deliver(values, now_ns)

    def _with_three_bytes(self, frame: bytes) -> Values:
        """Return the values of a frame that has numbers of 24 bits."""
        values = list(self._struct.unpack_from(frame))
        for slot, signed in self._three_bytes:
            values[slot] = int.from_bytes(values[slot], self._order, signed=signed)
        return values


class BinaryPacker:
    """Makes frames from raw values; counts and checksums them.

    `writer` does it by a kernel, None where numbers of 64 bits do not hold a frame's.
    """

    def __init__(self, frame: BinaryFormat) -> None:
        self.fields = binary_fields(frame)
        self._sync = bytes.fromhex(frame.sync)
        self._end = bytes.fromhex(frame.end)
        self._struct = struct.Struct(frame.layout)
        self._bounds = [_bounds(field.type) for field in frame.fields]
        self._whole = [field.type[0] != "f" for field in frame.fields]
        self._order = frame.byte_order
        self._three_bytes = _three_bytes(frame)
        self._checksum = None if frame.checksum is None else checksum(frame.checksum.kind)
        self._span = slice(len(self._sync), frame.checksum_at)
        if frame.checksum is not None and frame.checksum.span is not None:
            self._span = slice(*frame.checksum.span)
        names = [field.name for field in frame.fields]
        self._counter = None if frame.counter is None else names.index(frame.counter)
        next_count = np.zeros(1, np.int64)
        self._count = next_count.data
        self.writer = FrameWriter(frame, next_count) if fits(frame) else None

    def pack(self, values: Values) -> bytes:
        """Return a frame; whole numbers are rounded and kept within the field's range."""
        if self.writer is not None and (frame := self.writer.write(values)) is not None:
            return frame
        raw: list[float] = []
        for value, (low, high), whole in zip(values, self._bounds, self._whole, strict=True):
            kept = min(max(value, low), high)
            raw.append(round(kept) if whole else kept)
        if self._counter is not None:
            raw[self._counter] = self._count[0]
            self._count[0] = int((self._count[0] + 1) % (self._bounds[self._counter][1] + 1))
        fields: list[float | bytes] = list(raw)
        for slot, signed in self._three_bytes:
            fields[slot] = int(raw[slot]).to_bytes(3, self._order, signed=signed)
        body = self._sync + self._struct.pack(*fields)[len(self._sync) :]
        if self._checksum is not None:
            function, size = self._checksum
            body += function(body[self._span]).to_bytes(size, self._order)
        return body + self._end


def _three_bytes(frame: BinaryFormat) -> list[tuple[int, bool]]:
    """Return the places of numbers of 24 bits, and whether each has a sign."""
    places = enumerate(frame.fields)
    return [(slot, field.type == "i24") for slot, field in places if field.type in THREE_BYTES]


def _bounds(kind: str) -> tuple[float, float]:
    """Return the least and the largest value of a type."""
    bits = 8 * SIZE[kind]
    if kind[0] == "u":
        return 0, (1 << bits) - 1
    if kind[0] == "i":
        return -(1 << bits - 1), (1 << bits - 1) - 1
    return -math.inf, math.inf
