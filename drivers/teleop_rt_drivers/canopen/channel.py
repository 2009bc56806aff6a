"""A measured value that arrives in one PDO per SYNC: checked, matched to its SYNC, or rejected."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt_drivers.canopen import intake
from teleop_rt_drivers.canopen.intake import DUPLICATE_CYCLES, format_code
from teleop_rt_drivers.canopen.source import SourceRecord, place

if TYPE_CHECKING:
    from teleop_rt_drivers.canopen.counters import Counters
    from teleop_rt_drivers.canopen.pdo import PdoCodec
    from teleop_rt_drivers.quantity import Plausible, Scale

_VALUE, _STAMP, _RECEIVED, _OWED = map(place, ("value", "stamp_ns", "received", "owed"))
_EXCESS = place("excess_cycles")


class Replies:
    """Matches the answers of one node to the SYNCs that asked for them.

    A node answers each SYNC once and in order, but an answer can be late or lost, and the two
    look alike. So the newest answer is known to be that to the newest SYNC only when nothing is
    owed any more; a node that answers again but does not catch up has lost those. Answers
    that were given up and come after all are late; more than those are a second sender's.
    """

    def __init__(self, record: SourceRecord | None = None) -> None:
        self._record = record or SourceRecord()

    def reset(self) -> None:
        """Owe nothing, suspect nothing."""
        source = self._record.source
        source.received = source.owed = source.given_up = 0
        source.behind_cycles = source.excess_cycles = 0

    @property
    def received(self) -> int:
        """How many answers came in this cycle."""
        return self._record.counts[_RECEIVED]

    @received.setter
    def received(self, count: int) -> None:
        self._record.counts[_RECEIVED] = count

    @property
    def duplicate(self) -> bool:
        """Return whether a second node answers under the same id."""
        return self._record.counts[_EXCESS] >= DUPLICATE_CYCLES

    @property
    def answered(self) -> bool:
        """Return whether as many answers came as are owed."""
        counts = self._record.counts
        return counts[_RECEIVED] >= counts[_OWED]

    def asked(self) -> None:
        """Note that a SYNC was sent."""
        intake.note_sync_sent(self._record.stored)

    def settle(self, counters: Counters) -> bool:
        """Return whether the newest answer of this cycle belongs to the newest SYNC."""
        return intake.answers(self._record.source, counters.words)


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
    ) -> None:
        self.codec = codec
        self.too_old = f"{codec.name}: no new value"
        self.record = SourceRecord()
        self.replies = Replies(self.record)
        source = self.record.source
        source.cob_id, source.length = codec.cob_id, codec.struct.size
        source.number_at, source.number_kind = codec.places[slot], format_code(codec.kinds[slot])
        if status_slot is not None:
            source.status_at = codec.places[status_slot]
            source.status_kind = format_code(codec.kinds[status_slot])
        source.offset, source.gain = scale.offset, scale.sign * scale.per_count
        source.lower, source.upper = plausible.lower, plausible.upper
        source.slack, source.rate_per_ns = plausible.slack, plausible.rate * 1e-9

    def watch_speed(self, slot: int, most: float) -> None:
        """Count frames whose field at this slot is saturated: its size is `most` or more."""
        source = self.record.source
        source.extra_at = self.codec.places[slot]
        source.extra_kind, source.most_extra = format_code(self.codec.kinds[slot]), most

    @property
    def value(self) -> float:
        """The value [rig unit]."""
        return self.record.floats[_VALUE]

    @property
    def stamp_ns(self) -> int:
        """The time of the SYNC that latched it."""
        return self.record.counts[_STAMP]

    def reset(self) -> None:
        """Forget the value: the next one may be anywhere in range."""
        self.replies.reset()
        self.record.source.known = 0
        self.record.source.candidate = math.nan
