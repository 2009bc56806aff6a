"""Coupling of master and slave, also when news stay away.

WAITING: the master counts its own motion from where the slave stands, so that whenever the
slave begins to follow there is no jump. ENGAGED: the slave follows. FROZEN: no news for
`freeze_after_ms`; the hand still feels the last wall, and the slave is asked to stay: it is not
led, so that it draws back after its `retreat_after_ms` if the silence goes on.
DECLUTCHED: no news for `declutch_after_ms`, or a slave that will not follow, or another
session; the force fades to zero within `fade_ms` and then the wall is forgotten.
"""

from __future__ import annotations

from enum import IntEnum

from teleop_rt.config.master import MasterConfig
from teleop_rt.link.messages import StateMessage

NS_PER_MS = 1_000_000


class LinkState(IntEnum):
    """How far master and slave are coupled."""

    WAITING = 0
    ENGAGED = 1
    FROZEN = 2
    DECLUTCHED = 3


WAITING, ENGAGED, FROZEN, DECLUTCHED = LinkState
"""By these names a tick finds them at once: in Python 3.11 each look-up in an enum is a call."""


class Engagement:
    """The master's link state, advanced once a tick."""

    def __init__(self, config: MasterConfig) -> None:
        self._freeze_ns = round(config.freeze_after_ms * NS_PER_MS)
        self._declutch_ns = round(config.declutch_after_ms * NS_PER_MS)
        self._fade_ns = round(config.fade_ms * NS_PER_MS)
        self.reset()

    def reset(self) -> None:
        """Wait for the slave, as at the start."""
        self.state: LinkState = WAITING
        self.engagements = self.freezes = self.declutches = 0
        self._followed_ns = 0
        self._declutched_ns = 0
        self._session_id = 0

    @property
    def ever_engaged(self) -> bool:
        """Whether the slave has ever followed."""
        return self.engagements > 0

    @property
    def coupled(self) -> bool:
        """Whether the hand's motion is the slave's."""
        return self.state is ENGAGED or self.state is FROZEN

    def asks(self, slave: StateMessage | None, silence_ns: int) -> bool:
        """Return whether the slave is asked to follow; again only out of contact."""
        if self.state is not WAITING:
            return self.state is ENGAGED
        if slave is None or silence_ns > self._freeze_ns:
            return False
        return not (self.ever_engaged and slave.in_contact)

    def fade(self, now_ns: int) -> float:
        """Return the share of the force that is left."""
        if self.state is not DECLUTCHED:
            return 1.0
        return max(0.0, 1 - (now_ns - self._declutched_ns) / self._fade_ns)

    def update(
        self,
        now_ns: int,
        slave: StateMessage | None,
        silence_ns: int,
        round_trip_ns: int,
        session_id: int,
    ) -> None:
        """Advance the state; `slave` is the newest state received, `silence_ns` its silence."""
        if slave is not None and slave.following and silence_ns <= self._freeze_ns:
            self._followed_ns = now_ns
        state = self.state
        if state is WAITING:
            if self.asks(slave, silence_ns) and slave is not None and slave.following:
                self.state = ENGAGED
                self.engagements += 1
                self._session_id = session_id
        elif state is DECLUTCHED:
            if now_ns - self._declutched_ns >= self._fade_ns:
                self.state = WAITING
        else:
            self._watch(now_ns, silence_ns, max(0, round_trip_ns), session_id)

    def _watch(self, now_ns: int, silence_ns: int, round_trip_ns: int, session_id: int) -> None:
        refused_ns = now_ns - self._followed_ns - round_trip_ns
        if max(silence_ns, refused_ns) > self._declutch_ns or session_id != self._session_id:
            self.state = DECLUTCHED
            self.declutches += 1
            self._declutched_ns = now_ns
        else:
            frozen = silence_ns > self._freeze_ns
            self.freezes += frozen and self.state is not FROZEN
            self.state = FROZEN if frozen else ENGAGED
