"""Counters of one end of the link, and its estimates of delay and of the other clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.kernels.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Whole = NDArray[np.int64]

LATE, LATE_WELCOME, STALE = "late", "late welcome", "stale"
OVERTAKEN = frozenset({LATE, LATE_WELCOME})
"""Late packets of a healthy link: a newer message, or an answer, arrived earlier."""
_SMOOTHING = 16
"""Weight 1/16 of a new value, as a TCP's smoothed estimates have 1/8 and 1/4."""


SENT, RECEIVED, LOST, REFUSED, ROUND_TRIP, ROUND_TRIP_MIN, ONE_WAY, _WORDS = range(8)


@kernel
def note_round_trip(statistics: Whole, round_trip_ns: int) -> None:
    """Take in the length of a complete round trip [ns]."""
    statistics[ROUND_TRIP] = _smooth(statistics[ROUND_TRIP], round_trip_ns)
    if statistics[ROUND_TRIP_MIN] < 0 or round_trip_ns <= statistics[ROUND_TRIP_MIN]:
        statistics[ROUND_TRIP_MIN] = round_trip_ns


@kernel
def note_transit(statistics: Whole, transit_ns: int) -> None:
    """Take in how long a message was on its way [ns]."""
    statistics[ONE_WAY] = _smooth(statistics[ONE_WAY], max(transit_ns, 0))


@kernel
def _smooth(mean_ns: int, value_ns: int) -> int:
    """Return the mean moved towards a value; a negative mean is not known yet."""
    return value_ns if mean_ns < 0 else mean_ns + (value_ns - mean_ns) // _SMOOTHING


class Statistics:
    """Counters of one end; rejected packets are counted by reason.

    `overtaken` of them came after a newer one, too late to be of use; `refused` is the rest.
    `take_overs` counts how often another master opened a session while one was alive. `words` hold
    the numbers that kernels change.
    """

    def __init__(self) -> None:
        self.words = np.zeros(_WORDS, np.int64)
        self.words[ROUND_TRIP] = self.words[ROUND_TRIP_MIN] = self.words[ONE_WAY] = -1
        self._words = self.words.data
        self.rejected: dict[str, int] = {}
        self._accepted_before: dict[str, int] = {}
        self.overtaken = self.take_overs = 0

    @property
    def sent(self) -> int:
        """How many messages were sent."""
        return self._words[SENT]

    @property
    def received(self) -> int:
        """How many packets of the session were accepted."""
        return self._words[RECEIVED]

    @property
    def lost(self) -> int:
        """How many packets of the peer have not come."""
        return self._words[LOST]

    @property
    def refused(self) -> int:
        """How many packets were rejected, those that were overtaken left out."""
        return self._words[REFUSED]

    @property
    def round_trip_ns(self) -> int:
        """Smoothed round trip; -1 before the first."""
        return self._words[ROUND_TRIP]

    @property
    def round_trip_min_ns(self) -> int:
        """Least round trip seen; -1 before the first."""
        return self._words[ROUND_TRIP_MIN]

    @property
    def one_way_ns(self) -> int:
        """Smoothed delay from the peer to here, by the estimate of the peer's clock; -1 before."""
        return self._words[ONE_WAY]

    def is_rejecting(self, reason: str) -> bool:
        """Return whether packets were rejected for a reason, and none was accepted since."""
        return self._accepted_before.get(reason) == self.received

    def reject(self, reason: str) -> None:
        """Count a packet that was not accepted."""
        self.rejected[reason] = self.rejected.get(reason, 0) + 1
        self._accepted_before[reason] = self.received
        if reason in OVERTAKEN:
            self.overtaken += 1
        else:
            self._words[REFUSED] += 1
