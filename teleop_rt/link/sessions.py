"""The sessions of one end: the one that stands, and those whose packets may still come.

Keys are renewed within a conversation, so packets under the former ones come for a while. A
conversation that another master took over is not obeyed; its master gets a notice.
"""

from __future__ import annotations

from teleop_rt.link.handshake import Answerer
from teleop_rt.link.messages import MessageError
from teleop_rt.link.session import Session
from teleop_rt.link.statistics import Statistics

RECONNECT_AFTER_NS = 2_000_000_000
"""Silence, beside a round trip, after which a session is begun again."""
SLOWEST_LINK_NS = 10_000_000_000
"""Longest round trip waited for: a packet withheld for minutes must not delay a reconnection."""
REKEY_AFTER_NS = 120_000_000_000
"""New ephemeral keys are made for a session as old as this, while the old ones go on."""
REJECT_AFTER_NS = 600_000_000_000
"""Keys as old as this are not used any more, whatever came of the renewal."""
FORMER_NS = 30_000_000_000
"""Packets under the former keys are accepted for so long: slower than any link."""


class Sessions:
    """The session that stands, None without one, and which others are still known.

    `answerer` holds the handshakes granted and not yet confirmed. `accepted_ns` is when the last
    packet of `current` was accepted [ns], `lost_before` how many packets the sessions before it
    have lost. A peer that goes on under the former keys alone may have forgotten its grant: it
    counts as silent, so that the handshake is begun again. An end that is `called` notes a
    conversation that takes over another. Before `ages_ns` there is nothing for `age` to do.
    """

    def __init__(
        self, answerer: Answerer, statistics: Statistics, now_ns: int, *, called: bool
    ) -> None:
        self.current: Session | None = None
        self.accepted_ns = now_ns
        self.lost_before = 0
        self.ages_ns = 0
        self._former: Session | None = None
        self._retired: Session | None = None
        self._answerer = answerer
        self._statistics = statistics
        self._called = called

    @property
    def lost(self) -> int:
        """How many packets to this end have not come, over all of its sessions."""
        return self.lost_before + (0 if self.current is None else self.current.window.missing)

    def silent(self, now_ns: int) -> bool:
        """Return whether nothing was accepted for so long that the session is to be begun again."""
        silence_ns = now_ns - self.accepted_ns
        if silence_ns <= RECONNECT_AFTER_NS:  # however long a round trip takes
            return False
        round_trip_ns = min(max(0, self._statistics.round_trip_ns), SLOWEST_LINK_NS)
        return silence_ns > RECONNECT_AFTER_NS + round_trip_ns

    def stands(self, now_ns: int) -> bool:
        """Return whether there is a session, and not a silent one."""
        return self.current is not None and not self.silent(now_ns)

    def find(self, session_id: int) -> Session:
        """Return the session of this number, a pending one too. Raises MessageError for another."""
        for session in (self.current, self._former, self._retired):
            if session is not None and session.session_id == session_id:
                return session
        pending = self._answerer.pending_of(session_id)
        if pending is None:
            raise MessageError("session")
        return pending.session

    def is_taken_over(self, session: Session) -> bool:
        """Return whether another master has taken this one's place."""
        return session is self._retired

    def is_known(self, session: Session) -> bool:
        """Return whether this is the session that stands, or the keys before its own."""
        return session is self.current or session is self._former

    def move_to(self, session: Session, now_ns: int) -> bool:
        """Let another session stand; return whether a new conversation begins with it.

        One of the conversation that stands only brings its next keys.
        """
        before = self.current
        session.began_ns = self.accepted_ns = self.ages_ns = now_ns
        self._answerer.confirmed()
        self.current = session
        if before is not None:
            self.lost_before += before.window.missing
        if before is not None and before.chain_id == session.chain_id:
            session.epoch = before.epoch + 1
            self._former = before
            return False
        self._former = None
        if before is not None and self._called and not self.silent(now_ns):
            self._statistics.take_overs += 1
            self._retired = before
        return True

    def end(self) -> None:
        """Let none stand any more."""
        self.current = self._former = None

    def age(self, now_ns: int) -> None:
        """Leave keys behind that have served long enough."""
        session = self.current
        if session is None:
            return
        age_ns = now_ns - session.began_ns
        if self._former is not None and age_ns > FORMER_NS:
            self._former = None
        if age_ns > REJECT_AFTER_NS:
            self.current = None
        self.ages_ns = session.began_ns + (REJECT_AFTER_NS if self._former is None else FORMER_NS)

    def wants_keys(self, now_ns: int) -> bool:
        """Return whether a caller is to call: without a session, after a silence, or to renew."""
        session = self.current
        return session is None or self.silent(now_ns) or now_ns - session.began_ns > REKEY_AFTER_NS
