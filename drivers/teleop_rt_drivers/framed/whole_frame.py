"""A frame that comes whole and alone, as nearly all do: read, checked and decoded in one step.

Whatever else comes is left to the parser, which finds frames byte by byte.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import bound, kernel
from teleop_rt.kernels.record import record_type
from teleop_rt.realtime.system_calls import read_bytes, read_delivered
from teleop_rt_drivers.framed import taking
from teleop_rt_drivers.framed.format import SIZE
from teleop_rt_drivers.framed.remainder import NONE, Bytes, StoredCheck, Table, check_of, new_check
from teleop_rt_drivers.framed.stream import READ_BYTES

if TYPE_CHECKING:
    from teleop_rt_drivers.device_clock import Stored as Clocks
    from teleop_rt_drivers.framed.format import BinaryFormat
    from teleop_rt_drivers.framed.source import Source

    Whole = NDArray[np.int64]

_LONGEST_EXACT = 4
"""Bytes of whole numbers that floating point of 64 bits holds exactly."""
UNSIGNED, SIGNED, FLOAT = range(3)
"""Kinds of the number in a field."""
SINGLE = 4
"""Bytes of a floating-point number of 32 bits."""
NOTHING = -1
"""Result for a line on which nothing waits."""
OTHER = 0
"""Result for data other than the next whole frame: the parser is to look at them."""
FINE = 1
"""Result for a frame none of whose values is to be counted; others have codes above that bit."""
_CODE_BITS, _CODE = 4, 0xF  # of a result: so many for each value's code, and their mask


class FrameFields:
    """Fields of a frame's description; how many bytes were `received` last, and when they arrived.

    That is minus the number of an error where the line is gone.
    """

    length: int
    check_at: int
    first_checked: int
    end_checked: int
    end_at: int
    is_big: int
    counter: int
    counts: int
    values: int
    place: int
    received: int
    arrived_ns: int


_FRAME = record_type(FrameFields)
_RECEIVED, _ARRIVED = map(list(FrameFields.__annotations__).index, ("received", "arrived_ns"))
Frames = NDArray[np.record]
Places = NDArray[np.int64]
Numbers = NDArray[np.float64]


@kernel
def number(data: Bytes | bytes, at: int, size: int, kind: int, is_big: bool) -> float:
    """Return the number of so many bytes of a frame."""
    word = np.uint64(0)
    for byte in range(size):
        place = at + (size - 1 - byte if is_big else byte)
        word |= np.uint64(data[place]) << np.uint64(8 * byte)
    if kind == FLOAT:
        if size == SINGLE:
            return float(np.uint32(word).view(np.float32))
        return float(np.uint64(word).view(np.float64))
    if kind == SIGNED and word >> np.uint64(8 * size - 1):
        return float(np.int64(word) - (np.int64(1) << np.int64(8 * size)))
    return float(word)


@kernel
def holds(data: Bytes | bytes, at: int, wanted: Bytes) -> bool:
    """Return whether these bytes are in a frame at this place."""
    same = True
    for byte in range(len(wanted)):
        same &= data[at + byte] == wanted[byte]
    return same


@kernel
def is_sound(
    frame: FrameFields,
    check: StoredCheck,
    table: Table,
    sync: Bytes,
    end: Bytes,
    data: Bytes | bytes,
    length: int,
) -> bool:
    """Return whether data of this length are one frame: its first and last bytes, its checksum."""
    if length != frame.length or not holds(data, 0, sync) or not holds(data, frame.end_at, end):
        return False
    if check[0].way == NONE:
        return True
    size = frame.end_at - frame.check_at
    sent = number(data, frame.check_at, size, UNSIGNED, frame.is_big > 0)
    return sent == check_of(check, table, data, frame.first_checked, frame.end_checked)


@kernel
def is_next(frame: FrameFields, last: Whole, numbers: Numbers) -> bool:
    """Return whether a frame's count follows the last one; if so it is the last one now."""
    if frame.counter < 0:
        return True
    count = int(numbers[frame.counter])
    if last[0] >= 0 and (count - last[0] - 1) % frame.counts != 0:
        return False
    last[0] = count
    return True


@kernel
def take_whole(
    frames: Frames,
    check: StoredCheck,
    table: Table,
    sync: Bytes,
    end: Bytes,
    places: Places,
    last: Whole,
    numbers: Numbers,
    values: taking.StoredValue,
    clocks: Clocks,
    data: Bytes | bytes,
    length: int,
    now_ns: int,
) -> int:
    """Take data that are the next frame; return OTHER, or its values' code (`counter_codes`)."""
    frame: Any = frames[0]
    if not is_sound(frame, check, table, sync, end, data, length):
        return OTHER
    for field in range(len(places)):
        at, size, kind = places[field, 0], places[field, 1], places[field, 2]
        numbers[field] = number(data, at, size, kind, frame.is_big > 0)
    if not is_next(frame, last, numbers):
        return OTHER
    found = FINE
    for index in range(frame.values):
        code = taking.take_numbers(values[index], clocks[index], numbers, now_ns)
        found |= code << _CODE_BITS * (index + 1)
    return found


@kernel
def take_read(
    frames: Frames,
    check: StoredCheck,
    table: Table,
    sync: Bytes,
    end: Bytes,
    places: Places,
    last: Whole,
    numbers: Numbers,
    values: taking.StoredValue,
    clocks: Clocks,
    memory: Bytes,
    descriptor: int,
    is_terminal: bool,
    empty_ns: int,
    now_ns: int,
) -> int:
    """Read the bytes that wait at a descriptor into the memory and take them by `take_whole`.

    It arrived half way since the line was seen to be empty, if it is watched: else `empty_ns` is 0.
    Where nothing waits, NOTHING is returned; OTHER, too, where the line is gone.
    """
    frame: Any = frames[0]
    frame.arrived_ns = (empty_ns + now_ns) // 2 if empty_ns > 0 else now_ns
    if is_terminal:
        frame.received = read_delivered(descriptor, memory, frame.place)
    else:
        frame.received = read_bytes(descriptor, frame.place, len(memory))
    if frame.received <= 0:
        return NOTHING if frame.received == 0 else OTHER
    return take_whole(
        frames, check, table, sync, end, places, last, numbers, values, clocks, memory,
        frame.received, frame.arrived_ns,
    )  # fmt: skip


def fits(format_: BinaryFormat) -> bool:
    """Return whether floating point holds every number of a frame exactly."""
    types = [field.type for field in format_.fields]
    return all(kind[0] == "f" or SIZE[kind] <= _LONGEST_EXACT for kind in types)


def is_exact(format_: BinaryFormat, source: Source) -> bool:
    """Return whether floating point holds all that a frame's values are compared by.

    That is not so for whole numbers of 64 bits, nor for a status or time that is no whole number.
    """
    types = [field.type for field in format_.fields]
    used = source.values[: source.value_count]
    slots = [slot for one in used for slot in (one.clock_slot, one.status_slot) if slot >= 0]
    return fits(format_) and all(types[slot][0] != "f" for slot in slots)


class WholeFrames:
    """Takes whole frames of one format; `numbers` holds the raw values of the last one.

    `last` is the count of the frame before, as the parser has it, too.
    """

    def __init__(self, format_: BinaryFormat, source: Source, last: Whole) -> None:
        description = described(format_)
        stored = description[0]
        frame = cast("FrameFields", stored[0])
        frame.values = source.value_count
        memory = np.zeros(READ_BYTES, np.uint8)
        frame.place = memory.ctypes.data
        numbers = np.zeros(len(format_.fields))
        self.numbers, self._memory = numbers.data, memory.data
        arrays = (*description, last, numbers, source.values, source.clocks)
        self.take = bound(take_whole, arrays, b"", 0, 0)
        self.read = bound(take_read, (*arrays, memory), 0, True, 0, 0)  # noqa: FBT003
        self._counts = stored.view(np.int64).data

    @property
    def received(self) -> int:
        """How many bytes `read` received, minus an error's number where the line is gone."""
        return self._counts[_RECEIVED]

    @property
    def arrived_ns(self) -> int:
        """The time of arrival of the bytes that `read` received."""
        return self._counts[_ARRIVED]

    def data(self) -> bytes:
        """Return the bytes that `read` received."""
        return bytes(self._memory[: max(0, self.received)])


def described(
    format_: BinaryFormat,
) -> tuple[Frames, StoredCheck, Table, Bytes, Bytes, Places]:
    """Return a format for kernels: its frame, checksum with table, first and last bytes, fields."""
    stored: Frames = np.zeros(1, _FRAME)
    frame = cast("FrameFields", stored[0])
    sync, end = _bytes_of(format_.sync), _bytes_of(format_.end)
    kind, span = None, None
    if format_.checksum is not None:
        kind, span = format_.checksum.kind, format_.checksum.span
    frame.length, frame.check_at = format_.size, format_.checksum_at
    frame.end_at, frame.is_big = format_.size - len(end), format_.byte_order == "big"
    frame.first_checked, frame.end_checked = span or (len(sync), format_.checksum_at)
    frame.counter, frame.counts = -1, 1
    names = [field.name for field in format_.fields]
    if format_.counter is not None:
        frame.counter = names.index(format_.counter)
        frame.counts = 1 << 8 * SIZE[format_.fields[frame.counter].type]
    return stored, *new_check(kind), sync, end, _places(format_)


def counter_codes(found: int) -> list[int]:
    """Return the codes of `taking.COUNTERS` of a frame's values, from `take_whole`'s result."""
    codes = []
    while found := found >> _CODE_BITS:
        codes.append(found & _CODE)
    return codes


def _bytes_of(text: str) -> Bytes:
    return np.array(list(bytes.fromhex(text)), np.uint8)


def _places(format_: BinaryFormat) -> Places:
    """Return place, size and kind of each field (n, 3)."""
    kinds = {"u": UNSIGNED, "i": SIGNED, "f": FLOAT}
    at, rows = len(bytes.fromhex(format_.sync)), []
    for field in format_.fields:
        rows.append((at, SIZE[field.type], kinds[field.type[0]]))
        at += SIZE[field.type]
    return np.array(rows, np.int64)
