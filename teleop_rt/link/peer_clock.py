"""How old a message is when it comes: by its sender's clock, beyond the link's own delay.

The offset of the peer's clock comes from the exchange with the least round trip of the last
seconds (NTP, RFC 5905 section 8), so it is off by at most half of that round trip. While the clock
is fixed, the offset moves by at most 100 ppm and the link's own delay not at all: packets that
somebody withholds and lets go late are old, whatever the link looks like meanwhile.
"""

from __future__ import annotations

WINDOW_NS = 10_000_000_000
"""Two such windows are remembered: crystals of 100 ppm part by 1 ms within one."""
PEAK_NS = 1_000_000_000
"""Two such windows of transits give the link's own delay, with its jitter."""
SLEW_PPM = 100
"""Twice what a crystal oscillator drifts; the offset of a fixed clock follows no faster."""
FUTURE_NS = 50_000_000
"""How far from the future a stamp may come: errors of the offset beyond half a round trip."""


class PeerClock:
    """Offset of the peer's clock [ns, theirs minus ours] and the link's own one-way time [ns]."""

    def __init__(self, one_way_max_ns: int | None = None) -> None:
        self._declared_ns = one_way_max_ns
        self.fixed = False
        self.forget()

    def forget(self) -> None:
        """Reset for an unknown peer; a fixed clock is kept."""
        if self.fixed:
            return
        self.known = False
        self.offset_ns = 0
        self._least_ns = [-1, -1]  # round trip, of this window and of the one before
        self._offsets_ns = [0, 0]
        self._window_ns = self._slewed_ns = self._peaks_ns = 0
        self._transit_ns = [-1, -1]
        self._tolerance_ns = FUTURE_NS
        self._own_ns = self.transit_ns = 0

    def fix(self) -> None:
        """Hold offset and one-way time from now on, as far as they are known."""
        if self.known and not self.fixed:
            self._own_ns = self.one_way_ns
            self.fixed = True

    def release(self) -> None:
        """Let them follow the link again."""
        self.fixed = False

    @property
    def one_way_ns(self) -> int:
        """The link's own one-way time: declared, or the longest transit of the last second."""
        if self._declared_ns is not None:
            return self._declared_ns
        return self._own_ns if self.fixed else max(self._transit_ns)

    def exchange(self, sent_ns: int, peer_received_ns: int, peer_sent_ns: int, now_ns: int) -> int:
        """Take in a round trip: our stamp, the peer's two, our arrival; return its length [ns].

        A negative length is no round trip, and nothing was learnt from it.
        """
        round_trip_ns = (now_ns - sent_ns) - (peer_sent_ns - peer_received_ns)
        if round_trip_ns < 0:
            return round_trip_ns
        if now_ns - self._window_ns > WINDOW_NS or not self.known:
            self._window_ns = now_ns
            self._least_ns[1], self._offsets_ns[1] = self._least_ns[0], self._offsets_ns[0]
            self._least_ns[0] = -1
        if self._least_ns[0] < 0 or round_trip_ns <= self._least_ns[0]:
            self._least_ns[0] = round_trip_ns
            self._offsets_ns[0] = ((peer_received_ns - sent_ns) + (peer_sent_ns - now_ns)) // 2
        self._follow(now_ns)
        return round_trip_ns

    def age_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """Return how old a message is beyond the link's own time; None where it cannot be.

        It cannot be dated before the first exchange, and must not come from the future.
        """
        if not self.known:
            return None
        self.transit_ns = transit_ns = now_ns - stamp_ns + self.offset_ns
        if transit_ns < -self._tolerance_ns:
            return None
        if not self.fixed and self._declared_ns is None:
            self._note_transit(transit_ns, now_ns)
        return transit_ns - self.one_way_ns

    def _follow(self, now_ns: int) -> None:
        """Move the offset to that of the least round trip."""
        reach_ns = (now_ns - self._slewed_ns) * SLEW_PPM // 1_000_000
        if self.fixed and not reach_ns:
            return  # so little time has passed that it would be rounded to nothing
        newest, before = self._least_ns
        older = 0 <= before < newest
        wanted_ns = self._offsets_ns[older]
        if self.fixed:
            self.offset_ns += min(max(wanted_ns - self.offset_ns, -reach_ns), reach_ns)
        else:
            self.offset_ns = wanted_ns
            self._tolerance_ns = FUTURE_NS + (before if older else newest) // 2
        self._slewed_ns = now_ns
        self.known = True

    def _note_transit(self, transit_ns: int, now_ns: int) -> None:
        transits = self._transit_ns
        if now_ns - self._peaks_ns > PEAK_NS:
            self._peaks_ns = now_ns
            transits[1], transits[0] = transits[0], transit_ns
        elif transit_ns > transits[0]:
            transits[0] = transit_ns
