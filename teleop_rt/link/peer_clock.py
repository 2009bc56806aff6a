"""How old a message is when it comes: by its sender's clock, beyond the link's own delay.

The offset of the peer's clock comes from the exchange with the least round trip of the last
seconds (NTP, RFC 5905 section 8), so it is off by at most half of that round trip. While the clock
is fixed, the offset moves by at most 100 ppm and the link's own delay not at all: packets that
somebody withholds and lets go late are old, whatever the link looks like meanwhile.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.kernels.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Whole = NDArray[np.int64]

WINDOW_NS = 10_000_000_000
"""Two such windows are remembered: crystals of 100 ppm part by 1 ms within one."""
PEAK_NS = 1_000_000_000
"""Two such windows of transits give the link's own delay, with its jitter."""
SLEW_PPM = 100
"""Twice the drift of a crystal oscillator; the offset of a fixed clock follows no faster."""
FUTURE_NS = 50_000_000
"""How far from the future a stamp may come: errors of the offset beyond half a round trip."""
UNDATED = -(2**63)
"""In place of an age: the message cannot be dated."""
FARTHEST_NS = 1 << 60
"""36 years: stamps beyond it are taken for it, so that no sum of them overflows."""

(
    _KNOWN,
    FIXED,
    _DECLARED,
    _OFFSET,
    _LEAST,  # round trip, of this window and of the one before
    _LEAST_BEFORE,
    _OFFSET_OF_LEAST,
    _OFFSET_BEFORE,
    _WINDOW,
    _SLEWED,
    _PEAKS,
    _TRANSIT_PEAK,
    _TRANSIT_PEAK_BEFORE,
    _TOLERANCE,
    _OWN,
    TRANSIT,
    _WORDS,
) = range(17)


@kernel
def match_round_trip(
    clock: Whole, sent_ns: int, peer_received_ns: int, peer_sent_ns: int, now_ns: int
) -> int:
    """Take in a round trip, as `PeerClock.exchange` does."""
    round_trip_ns = (now_ns - sent_ns) - (peer_sent_ns - peer_received_ns)
    if round_trip_ns < 0:
        return round_trip_ns
    if now_ns - clock[_WINDOW] > WINDOW_NS or not clock[_KNOWN]:
        clock[_WINDOW] = now_ns
        clock[_LEAST_BEFORE], clock[_OFFSET_BEFORE] = clock[_LEAST], clock[_OFFSET_OF_LEAST]
        clock[_LEAST] = -1
    if clock[_LEAST] < 0 or round_trip_ns <= clock[_LEAST]:
        clock[_LEAST] = round_trip_ns
        offset_ns = (peer_received_ns - sent_ns) + (peer_sent_ns - now_ns)
        clock[_OFFSET_OF_LEAST] = offset_ns // 2
    _follow(clock, now_ns)
    return round_trip_ns


@kernel
def _follow(clock: Whole, now_ns: int) -> None:
    """Move the offset to that of the least round trip."""
    reach_ns = (now_ns - clock[_SLEWED]) // (1_000_000 // SLEW_PPM)
    if clock[FIXED] and not reach_ns:
        return  # so little time has passed that it would be rounded to nothing
    older = 0 <= clock[_LEAST_BEFORE] < clock[_LEAST]
    wanted_ns = clock[_OFFSET_BEFORE] if older else clock[_OFFSET_OF_LEAST]
    if clock[FIXED]:
        clock[_OFFSET] += min(max(wanted_ns - clock[_OFFSET], -reach_ns), reach_ns)
    else:
        clock[_OFFSET] = wanted_ns
        least_ns = clock[_LEAST_BEFORE] if older else clock[_LEAST]
        clock[_TOLERANCE] = FUTURE_NS + least_ns // 2
    clock[_SLEWED] = now_ns
    clock[_KNOWN] = 1


@kernel
def age_of(clock: Whole, stamp_ns: int, now_ns: int) -> int:
    """Return the age of a message [ns], or UNDATED; as `PeerClock.age_ns`."""
    if not clock[_KNOWN]:
        return UNDATED
    transit_ns = now_ns - stamp_ns + clock[_OFFSET]
    clock[TRANSIT] = transit_ns
    if transit_ns < -clock[_TOLERANCE]:
        return UNDATED
    if not clock[FIXED] and clock[_DECLARED] < 0:
        _note_transit(clock, transit_ns, now_ns)
    return int(transit_ns - _one_way(clock))


@kernel
def _note_transit(clock: Whole, transit_ns: int, now_ns: int) -> None:
    if now_ns - clock[_PEAKS] > PEAK_NS:
        clock[_PEAKS] = now_ns
        clock[_TRANSIT_PEAK_BEFORE], clock[_TRANSIT_PEAK] = clock[_TRANSIT_PEAK], transit_ns
    elif transit_ns > clock[_TRANSIT_PEAK]:
        clock[_TRANSIT_PEAK] = transit_ns


@kernel
def _one_way(clock: Whole) -> int:
    """Return the link's own one-way time: declared, fixed, or the longest of the last second."""
    if clock[_DECLARED] >= 0:
        return int(clock[_DECLARED])
    if clock[FIXED]:
        return int(clock[_OWN])
    return int(max(clock[_TRANSIT_PEAK], clock[_TRANSIT_PEAK_BEFORE]))


class PeerClock:
    """Offset of the peer's clock [ns, theirs minus ours] and the link's own one-way time [ns].

    `words` hold its state, for the kernels.
    """

    def __init__(self, one_way_max_ns: int | None = None) -> None:
        self.words = np.zeros(_WORDS, np.int64)
        self.words[_DECLARED] = -1 if one_way_max_ns is None else one_way_max_ns
        self._words = self.words.data
        self.forget()

    @property
    def known(self) -> bool:
        """Whether an exchange has determined the offset."""
        return bool(self._words[_KNOWN])

    @property
    def fixed(self) -> bool:
        """Whether offset and one-way time are held."""
        return bool(self._words[FIXED])

    @property
    def offset_ns(self) -> int:
        """The peer's clock minus ours."""
        return self._words[_OFFSET]

    @property
    def one_way_ns(self) -> int:
        """The link's own one-way time: declared, or the longest transit of the last second."""
        return _one_way(self.words)

    def forget(self) -> None:
        """Reset for an unknown peer; a fixed clock is kept."""
        if self.fixed:
            return
        declared_ns = self._words[_DECLARED]
        self.words[:] = 0
        self._words[_DECLARED], self._words[_TOLERANCE] = declared_ns, FUTURE_NS
        for word in (_LEAST, _LEAST_BEFORE, _TRANSIT_PEAK, _TRANSIT_PEAK_BEFORE):
            self._words[word] = -1

    def fix(self) -> None:
        """Hold offset and one-way time from now on, as far as they are known."""
        if self.known and not self.fixed:
            self._words[_OWN] = self.one_way_ns
            self._words[FIXED] = 1

    def release(self) -> None:
        """Let them follow the link again."""
        self._words[FIXED] = 0

    def exchange(self, sent_ns: int, peer_received_ns: int, peer_sent_ns: int, now_ns: int) -> int:
        """Take in a round trip: our stamp, the peer's two, our arrival; return its length [ns].

        A negative length is no round trip, and nothing was learnt from it.
        """
        return match_round_trip(self.words, sent_ns, peer_received_ns, peer_sent_ns, now_ns)

    def age_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """Return how old a message is beyond the link's own time; None where it cannot be.

        It cannot be dated before the first exchange, and must not come from the future.
        """
        age_ns = age_of(self.words, stamp_ns, now_ns)
        return None if age_ns == UNDATED else age_ns
