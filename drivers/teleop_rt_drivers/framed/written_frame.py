"""A frame that is sent, written by one compiled step: fields, count and checksum."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import bound, kernel
from teleop_rt.kernels.record import record_type
from teleop_rt.realtime.system_calls import write_bytes
from teleop_rt_drivers.framed.remainder import NONE, Bytes, StoredCheck, Table, check_of
from teleop_rt_drivers.framed.whole_frame import FLOAT, SIGNED, SINGLE, UNSIGNED, described

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt_drivers.framed.format import BinaryFormat
    from teleop_rt_drivers.framed.source import Values
    from teleop_rt_drivers.framed.whole_frame import FrameFields, Frames, Numbers, Places, Whole

NO_WORD = -1 << 20
"""In place of a number of bytes: a field has no word for a number, and nothing was sent."""
_LARGEST_SINGLE = float(np.finfo(np.float32).max)


@kernel
def within_field(value: float, size: int, kind: int) -> float:
    """Return a number as a field can hold it: a whole one is rounded and kept in range."""
    if kind == FLOAT:
        return value
    most = float(1 << 8 * int(size) - (1 if kind == SIGNED else 0)) - 1.0
    least = -most - 1.0 if kind == SIGNED else 0.0
    return float(np.rint(min(max(value, least), most)))


@kernel
def has_word_for(value: float, size: int, kind: int) -> bool:
    """Return whether a field has a word for a number: not for none, nor for too large a one."""
    if kind != FLOAT:
        return not math.isnan(value)
    return size != SINGLE or not math.isfinite(value) or abs(value) <= _LARGEST_SINGLE


@kernel
def write_number(data: Bytes, at: int, size: int, kind: int, is_big: bool, value: float) -> None:
    """Write a number that is held into so many bytes of a frame."""
    if kind == FLOAT and size == SINGLE:
        word = np.uint64(np.float32(value).view(np.uint32))
    elif kind == FLOAT:
        word = np.float64(value).view(np.uint64)
    else:
        word = np.uint64(np.int64(value))
    for byte in range(size):
        place = at + (size - 1 - byte if is_big else byte)
        data[place] = word >> np.uint64(8 * byte) & np.uint64(0xFF)


@kernel
def write_frame(
    frames: Frames,
    check: StoredCheck,
    table: Table,
    sync: Bytes,
    end: Bytes,
    places: Places,
    next_count: Whole,
    wanted: Numbers,
    data: Bytes,
) -> bool:
    """Write a frame of the wanted numbers; return False where a field has no word for one."""
    frame: Any = frames[0]
    is_big = frame.is_big > 0
    for field in range(len(places)):
        if not has_word_for(wanted[field], places[field, 1], places[field, 2]):
            return False
    if frame.counter >= 0:
        wanted[frame.counter] = next_count[0]
        next_count[0] = (next_count[0] + 1) % frame.counts
    for field in range(len(places)):
        at, size, kind = places[field, 0], places[field, 1], places[field, 2]
        write_number(data, at, size, kind, is_big, within_field(wanted[field], size, kind))
    for byte in range(len(sync)):
        data[byte] = sync[byte]
    for byte in range(len(end)):
        data[frame.end_at + byte] = end[byte]
    if check[0].way != NONE:
        found = float(check_of(check, table, data, frame.first_checked, frame.end_checked))
        size = frame.end_at - frame.check_at
        write_number(data, frame.check_at, size, UNSIGNED, is_big, found)
    return True


@kernel
def send_frame(
    frames: Frames,
    check: StoredCheck,
    table: Table,
    sync: Bytes,
    end: Bytes,
    places: Places,
    next_count: Whole,
    wanted: Numbers,
    data: Bytes,
    descriptor: int,
) -> int:
    """Write a frame as `write_frame` does, and send it; return as `write_bytes`, or NO_WORD."""
    if not write_frame(frames, check, table, sync, end, places, next_count, wanted, data):
        return NO_WORD
    frame: Any = frames[0]
    return write_bytes(descriptor, frame.place, frame.length)


class AimFields:
    """Fields of the way from a target [rig unit] into a command that asks to follow it.

    The slots are those of target and control value among the raw values, `follow` is the latter,
    and the rest is the target's `Scale`.
    """

    target_slot: int
    control_slot: int
    follow: float
    per_count: float
    sign: int
    offset: float


_AIM = record_type(AimFields)
StoredAim = NDArray[np.record]


def new_aim() -> StoredAim:
    """Return zeroed fields (1,)."""
    return np.zeros(1, _AIM)


@kernel
def send_target(
    aims: StoredAim,
    frames: Frames,
    check: StoredCheck,
    table: Table,
    sync: Bytes,
    end: Bytes,
    places: Places,
    next_count: Whole,
    wanted: Numbers,
    data: Bytes,
    target: float,
    descriptor: int,
) -> int:
    """Send the frame that asks to follow to a target, as `Scale.counts` has it, by `send_frame`."""
    aim: Any = aims[0]
    wanted[aim.control_slot] = aim.follow
    wanted[aim.target_slot] = np.rint(aim.sign * (target - aim.offset) / aim.per_count)
    return send_frame(frames, check, table, sync, end, places, next_count, wanted, data, descriptor)


class FrameWriter:
    """Writes frames of one format; `next_count` (1,) is the count of the next one."""

    def __init__(self, format_: BinaryFormat, next_count: Whole) -> None:
        wanted, data = np.zeros(len(format_.fields)), np.zeros(format_.size, np.uint8)
        self._fill = struct.Struct(f"{len(wanted)}d").pack_into
        self._wanted, self._data, self.size = wanted.data, data.data, format_.size
        self._arrays = arrays = (*described(format_), next_count, wanted, data)
        cast("FrameFields", arrays[0][0]).place = data.ctypes.data
        self._write = bound(write_frame, arrays)
        self._send = bound(send_frame, arrays, 0)

    def write(self, values: Values) -> bytes | None:
        """Return the frame of these raw values; None where a field has no word for one."""
        self._fill(self._wanted, 0, *values)
        return bytes(self._data) if self._write() else None

    def target_sender(self, aim: StoredAim) -> Callable[[float, int], int]:
        """Return the function that sends a target to a descriptor as `send_target` does."""
        return bound(send_target, (aim, *self._arrays), 0.0, 0)

    def send(self, values: Values, descriptor: int) -> int:
        """Send the frame of these raw values as `send_frame` does."""
        self._fill(self._wanted, 0, *values)
        return self._send(descriptor)
