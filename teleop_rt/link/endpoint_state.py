"""The state of one end of the link: its session and peer, its silence and its trouble."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.link import intake
from teleop_rt.link.mailbox import Mailbox
from teleop_rt.link.messages import Kind
from teleop_rt.link.sessions import RECONNECT_AFTER_NS, Sessions
from teleop_rt.link.statistics import Statistics
from teleop_rt.link.troubles import (
    CLOCK_TROUBLE,
    TAKEN_TROUBLE,
    TROUBLES,
    first_refusal,
    silent_trouble,
)

NOTHING_AFTER_NS = 2_000_000_000
"""Silence after which the master reports that nothing comes."""


class EndpointState(Mailbox):
    """Session, peer, silence and trouble of one end of the link, beside its newest messages.

    `taken_by` names the master that took the session over.
    """

    sessions: Sessions
    statistics: Statistics
    words: NDArray[np.int64]
    taken_by: str | None
    _numbers: memoryview
    """`words` by a way that is faster for single numbers."""

    @property
    def connected(self) -> bool:
        """Whether a session stands."""
        return self.sessions.current is not None

    @property
    def session_id(self) -> int:
        """The number of the session, another one after each break; 0 while none stands.

        New keys for the same conversation leave it as it is.
        """
        session = self.sessions.current
        return 0 if session is None else session.chain_id

    @property
    def peer(self) -> str:
        """The name of whose key opened the session; empty while none stands."""
        session = self.sessions.current
        return "" if session is None else session.peer

    @property
    def peer_rate_hz(self) -> int:
        """The rate that the peer stated; 0 while no session stands."""
        session = self.sessions.current
        return 0 if session is None else session.peer_rate_hz

    @property
    def trouble(self) -> str | None:
        """The reason why the link is not connected, as a sentence; None while it is."""
        if self.connected:
            return TROUBLES[CLOCK_TROUBLE][1] if self._numbers[intake.IS_STALE] else None
        return TROUBLES[self._refusal() or silent_trouble(self.statistics)][1]

    def trouble_code(self, now_ns: int) -> int:
        """Return the index of the trouble in TROUBLES; 0 while there is none, or none yet.

        A session that nobody answers any more, as after a reload without this key, is none.
        """
        sessions = self.sessions
        is_recent = now_ns - sessions.accepted_ns <= RECONNECT_AFTER_NS  # nearly always
        if (is_recent and sessions.current is not None) or sessions.stands(now_ns):
            return CLOCK_TROUBLE if self._numbers[intake.IS_STALE] else 0
        silent = self.silence_ns(now_ns) > NOTHING_AFTER_NS
        return self._refusal() or (silent_trouble(self.statistics) if silent else 0)

    def _refusal(self) -> int:
        """Return the index of the trouble for which packets are refused, or 0."""
        return TAKEN_TROUBLE if self.taken_by is not None else first_refusal(self.statistics)

    def silence_ns(self, now_ns: int) -> int:
        """Return the age of the newest message taken in, or the time since start before one."""
        return intake.silence_of(self._numbers, now_ns)

    def newest(self, kind: Kind) -> tuple[int, int]:
        """Return epoch and sequence of the newest message of a kind; zeros before the first."""
        return intake.newest(self.words, kind)
