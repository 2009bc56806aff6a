"""A measured value that arrives in one PDO per SYNC: checked, matched to its SYNC, or rejected."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teleop_rt_drivers.canopen.pdo import PdoCodec
    from teleop_rt_drivers.quantity import Plausible, Scale

DUPLICATE_CYCLES = 3
"""Cycles in a row with more answers than were ever owed: then a second sender is believed."""
CYCLES_TO_CATCH_UP = 3
"""Answered cycles that a node may stay behind; then what it owes is believed to be lost."""
MOST_OWED = 10_000
NO_CANDIDATE = math.nan


class Replies:
    """Matches the answers of one node to the SYNCs that asked for them.

    A node answers each SYNC once and in order, but an answer can be late or lost, and the two
    look alike. So the newest answer is known to be that to the newest SYNC only when nothing is
    owed any more; a node that answers again but does not catch up has lost what it owes. Answers
    that were given up and come after all are late; more than those are a second sender's.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Owe nothing, suspect nothing."""
        self.received = 0
        self._owed = 0
        self._given_up = 0
        self._behind_cycles = 0
        self._excess_cycles = 0

    @property
    def duplicate(self) -> bool:
        """Return whether a second node answers under the same id."""
        return self._excess_cycles >= DUPLICATE_CYCLES

    @property
    def answered(self) -> bool:
        """Return whether as many answers came as are owed."""
        return self.received >= self._owed

    def asked(self) -> None:
        """Note that a SYNC was sent."""
        if self._owed < MOST_OWED:
            self._owed += 1

    def settle(self, counters: dict[str, int]) -> bool:
        """Return whether the newest answer of this cycle belongs to the newest SYNC."""
        received = self.received
        self.received = 0
        if received == self._owed:  # nearly always: one asked, one answered
            self._owed = self._behind_cycles = self._excess_cycles = 0
            return received > 0
        if received > self._owed:
            self._settle_excess(received - self._owed, counters)
            return False
        self._excess_cycles = 0
        self._owed -= received
        if received == 0:
            return False
        self._behind_cycles += 1
        if self._behind_cycles < CYCLES_TO_CATCH_UP:
            counters["late"] += received
            return False
        self._given_up = min(self._given_up + self._owed, MOST_OWED)
        self._owed = self._behind_cycles = 0
        return True

    def _settle_excess(self, excess: int, counters: dict[str, int]) -> None:
        """Book answers beyond what is owed: late ones as far as some were given up."""
        self._owed = self._behind_cycles = 0
        late = min(excess, self._given_up)
        self._given_up -= late
        counters["late"] += late
        counters["unsolicited"] += excess - late
        self._excess_cycles = self._excess_cycles + 1 if excess > late else 0


class Channel:
    """One value of the rig, from the newest valid frame of its PDO.

    `value` [rig unit] and `stamp_ns`, the time of the SYNC that latched it, change only when a
    frame has passed every check and belongs to the newest SYNC.
    """

    def __init__(
        self,
        codec: PdoCodec,
        slot: int,
        status_slot: int | None,
        scale: Scale,
        plausible: Plausible,
        counters: dict[str, int],
    ) -> None:
        self.codec = codec
        self.too_old = f"{codec.name}: no new value"
        self.replies = Replies()
        self.value = 0.0
        self.stamp_ns = 0
        self.known = False
        self._unpack = codec.struct.unpack
        self._slot = slot
        self._status_slot = status_slot
        self._offset, self._gain = scale.offset, scale.sign * scale.per_count
        self._lower, self._upper = plausible.lower, plausible.upper
        self._slack, self._rate_per_ns = plausible.slack, plausible.rate * 1e-9
        self._counters = counters
        self._candidate = NO_CANDIDATE

    def reset(self) -> None:
        """Forget the value: the next one may be anywhere in range."""
        self.replies.reset()
        self.known = False
        self._candidate = NO_CANDIDATE

    def take(self, data: bytes | bytearray) -> tuple[int | float, ...] | None:
        """Take a frame's bytes: count it as an answer, keep its value if that can be true."""
        self.replies.received += 1
        try:
            fields: tuple[int | float, ...] = self._unpack(data)
        except struct.error:
            self._counters["wrong_length"] += 1
            return None
        value = self._offset + self._gain * fields[self._slot]
        status = self._status_slot
        # What is no number is in no range.
        if self._lower <= value <= self._upper and (status is None or not fields[status]):
            self._candidate = value
        elif not math.isfinite(value):
            self._counters["not_a_number"] += 1
        elif status is not None and fields[status]:
            self._counters["bad_status"] += 1
        else:
            self._counters["out_of_range"] += 1
        return fields

    def settle(self, sync_ns: int) -> bool:
        """Take over this cycle's value if it is new, belongs to the SYNC and did not jump."""
        candidate = self._candidate
        self._candidate = NO_CANDIDATE
        if not self.replies.settle(self._counters) or candidate != candidate:  # noqa: PLR0124 - not a number
            return False
        if self.known:
            reach = self._slack + self._rate_per_ns * (sync_ns - self.stamp_ns)
            if abs(candidate - self.value) > reach:
                self._counters["impossible_jump"] += 1
                return False
        self.value = candidate
        self.stamp_ns = sync_ns
        self.known = True
        return True
