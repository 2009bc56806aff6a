"""Counters of one end of the link, and its estimates of delay and of the other clock."""

from __future__ import annotations

from dataclasses import dataclass, field

LATE, LATE_WELCOME, STALE = "late", "late welcome", "stale"
OVERTAKEN = frozenset({LATE, LATE_WELCOME})
"""Late packets of a healthy link: a newer message, or an answer, arrived earlier."""
_SMOOTHING = 16


@dataclass(slots=True)
class Statistics:
    """Counters of one end; rejected packets are counted by reason.

    `round_trip_ns` is smoothed, `round_trip_min_ns` the least seen; -1 before the first.
    `one_way_ns` is the smoothed delay from the peer to here, by the estimate of the peer's clock.
    `take_overs` counts how often another master opened a session while one was alive.
    """

    sent: int = 0
    received: int = 0
    lost: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    round_trip_ns: int = -1
    round_trip_min_ns: int = -1
    one_way_ns: int = -1
    take_overs: int = 0

    @property
    def refused(self) -> int:
        """How many packets were not accepted, those left out that a newer one had overtaken."""
        return sum(self.rejected.values()) - self.overtaken if self.rejected else 0

    @property
    def overtaken(self) -> int:
        """How many packets came too late to be of use."""
        return sum(self.rejected.get(reason, 0) for reason in OVERTAKEN)

    def reject(self, reason: str) -> None:
        """Count a packet that was not accepted."""
        self.rejected[reason] = self.rejected.get(reason, 0) + 1

    def round_trip(self, round_trip_ns: int) -> None:
        """Take in the length of a complete round trip; a negative one is none."""
        if round_trip_ns < 0:
            self.reject("echo")
            return
        self.round_trip_ns = _smooth(self.round_trip_ns, round_trip_ns)
        if self.round_trip_min_ns < 0 or round_trip_ns <= self.round_trip_min_ns:
            self.round_trip_min_ns = round_trip_ns

    def transit(self, transit_ns: int) -> None:
        """Take in how long a message was on its way."""
        self.one_way_ns = _smooth(self.one_way_ns, max(transit_ns, 0))


def _smooth(mean_ns: int, value_ns: int) -> int:
    """Return the mean moved towards a value; a negative mean is none yet."""
    return value_ns if mean_ns < 0 else mean_ns + (value_ns - mean_ns) // _SMOOTHING
