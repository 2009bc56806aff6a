"""What an end of the link counts, and what it learns of delay and of the other clock."""

from __future__ import annotations

from dataclasses import dataclass, field

LATE, LATE_WELCOME = "late", "late welcome"
OVERTAKEN = frozenset({LATE, LATE_WELCOME})
"""What a link in order brings too late: a newer message, or an answer, had come before."""
_SMOOTHING = 16


@dataclass(slots=True)
class Statistics:
    """Counters of one end; rejected packets are counted by reason.

    `round_trip_ns` is smoothed, `round_trip_min_ns` the least seen; -1 before the first.
    `clock_offset_ns` is the peer's clock minus ours, from the exchange with the least round
    trip (NTP, RFC 5905 section 8); it is off by at most half of that round trip. `one_way_ns`
    is the smoothed delay from the peer to here, by that offset.
    """

    sent: int = 0
    received: int = 0
    lost: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    round_trip_ns: int = -1
    round_trip_min_ns: int = -1
    clock_offset_ns: int = 0
    one_way_ns: int = -1

    @property
    def refused(self) -> int:
        """How many packets were not accepted, those left out that a newer one had overtaken."""
        return sum(self.rejected.values()) - self.overtaken

    @property
    def overtaken(self) -> int:
        """How many packets came too late to be of use."""
        return sum(self.rejected.get(reason, 0) for reason in OVERTAKEN)

    def reject(self, reason: str) -> None:
        """Count a packet that was not accepted."""
        self.rejected[reason] = self.rejected.get(reason, 0) + 1

    def exchange(self, sent_ns: int, peer_received_ns: int, peer_sent_ns: int, now_ns: int) -> None:
        """Take in a complete round trip: our stamp, the peer's two stamps, and our arrival."""
        round_trip_ns = (now_ns - sent_ns) - (peer_sent_ns - peer_received_ns)
        if round_trip_ns < 0:
            self.reject("echo")
            return
        self.round_trip_ns = _smooth(self.round_trip_ns, round_trip_ns)
        if self.round_trip_min_ns < 0 or round_trip_ns <= self.round_trip_min_ns:
            self.round_trip_min_ns = round_trip_ns
            self.clock_offset_ns = ((peer_received_ns - sent_ns) + (peer_sent_ns - now_ns)) // 2
        one_way_ns = now_ns - peer_sent_ns + self.clock_offset_ns
        one_way_ns = max(one_way_ns, 0)
        self.one_way_ns = _smooth(self.one_way_ns, one_way_ns)


def _smooth(mean_ns: int, value_ns: int) -> int:
    """Return the mean moved towards a value; a negative mean is none yet."""
    return value_ns if mean_ns < 0 else mean_ns + (value_ns - mean_ns) // _SMOOTHING
