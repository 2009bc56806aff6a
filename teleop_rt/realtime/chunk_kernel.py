"""Where the messages of a chunk lie, found by one kernel; for files with very many chunks.

A chunk that holds anything else than whole messages is left to others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel

Bytes = NDArray[np.uint8]
Whole = NDArray[np.int64]

_A_MESSAGE = 5
"""Opcode of a message; of MCAP, as are the places of the fields below."""
_LENGTH_AT, _CHANNEL_AT, _SEQUENCE_AT, _TEXT_AT = 1, 9, 11, 31
_HEAD_BYTES = 9
"""Opcode and length, which the length itself does not count."""
_MOST_CHANNELS = 1024  # of a chunk; one with more is not taken by the kernel


@kernel
def number_at(data: Bytes, at: int, size: int) -> int:
    """Return the whole number of so many bytes, at most 8, that begins here."""
    number = np.int64(0)
    for byte in range(size):
        number |= np.int64(data[at + byte]) << np.int64(8 * byte)
    return int(number)


@kernel
def find_messages(data: Bytes, heads: Whole) -> int:
    """Write text's begin, its end, sequence and channel of each message into `heads` (most, 4).

    Return how many there are; -1 where any record is no message, or not whole.
    """
    at = count = 0
    while at < len(data):
        if at + _TEXT_AT > len(data) or data[at] != _A_MESSAGE:
            return -1
        length = number_at(data, at + _LENGTH_AT, 8)
        if length < _TEXT_AT - _HEAD_BYTES or length > len(data) - at - _HEAD_BYTES:
            return -1
        end = at + _HEAD_BYTES + length
        heads[count, 0], heads[count, 1] = at + _TEXT_AT, end
        heads[count, 2] = number_at(data, at + _SEQUENCE_AT, 4)
        heads[count, 3] = number_at(data, at + _CHANNEL_AT, 2)
        at = end
        count += 1
    return count


@kernel
def put_in_order(heads: Whole, count: int, channels: Whole, places: Whole) -> int:
    """Write places (count, 3) of `count` messages channel by channel, in the order of the file.

    `channels` (most, 2) take each channel, in the order of their first messages, and where its
    places end. Return how many channels there are; -1 where they are too many.
    """
    used = 0
    for row in range(count):
        slot = 0
        while slot < used and channels[slot, 0] != heads[row, 3]:
            slot += 1
        if slot == used:
            if used == len(channels):
                return -1
            channels[used, 0], channels[used, 1] = heads[row, 3], 0
            used += 1
        channels[slot, 1] += 1
        heads[row, 3] = slot
    begin = 0
    for slot in range(used):
        channels[slot, 1], begin = begin, begin + channels[slot, 1]
    for row in range(count):
        slot = heads[row, 3]
        to = channels[slot, 1]
        for field in range(3):
            places[to, field] = heads[row, field]
        channels[slot, 1] = to + 1
    return used


class MessageFinder:
    """Finds the messages of one chunk after the other."""

    def __init__(self) -> None:
        self._heads = np.empty((0, 4), np.int64)
        self._channels = np.empty((_MOST_CHANNELS, 2), np.int64)

    def places(self, data: bytes) -> dict[int, Whole] | None:
        """Return where the messages lie, by channel: begin of the text, end, sequence (n, 3).

        None where `data` hold any other record, or none that is whole.
        """
        most = len(data) // _TEXT_AT
        if most > len(self._heads):
            self._heads = np.empty((most, 4), np.int64)
        count = find_messages(np.frombuffer(data, np.uint8), self._heads)
        places = np.empty((max(0, count), 3), np.int64)
        used = put_in_order(self._heads, count, self._channels, places)
        if count < 0 or used < 0:
            return None
        begin, found = 0, {}
        for channel, end in self._channels[:used].tolist():
            found[channel], begin = places[begin:end], end
        return found
