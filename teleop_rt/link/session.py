"""One session of the link, seen from one side: its keys, counters and replay window."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from cryptography.exceptions import InvalidTag

from teleop_rt.kernels.jit import kernel
from teleop_rt.link import noise
from teleop_rt.link.codec import HEADER_BYTES
from teleop_rt.link.messages import MessageError
from teleop_rt.link.noise import Body, CipherState, pack_nonce
from teleop_rt.link.transport import Address

if TYPE_CHECKING:
    from numpy.typing import NDArray

REPLAY_WINDOW = 1024
"""Packets that may overtake one another: a second at 1 kHz."""


NOT_AUTHENTIC = "authentication"
"""Reason for which a packet is refused whose tag is not that of its key."""
_NEWEST, _COUNT, _SEEN = range(3)


@kernel
def problem_code(window: NDArray[np.int64], sequence: int) -> int:
    """Return 0, or the place in _PROBLEMS of a number's error."""
    if sequence < 0 or sequence <= window[_NEWEST] - REPLAY_WINDOW:
        return 1  # one that reads as negative is 2^63 or more: no sender counts so far
    if sequence == 0 or window[_SEEN + sequence % REPLAY_WINDOW] == sequence:
        return 2
    return 0


_SIGN = 1 << 63
"""Sign bit of 64: a recording's columns hold the number as a signed one."""
_PROBLEMS = ("", "too old", "replay")


@kernel
def add(window: NDArray[np.int64], sequence: int) -> int:
    """Remember a number; return how many up to the newest have not come."""
    window[_SEEN + sequence % REPLAY_WINDOW] = sequence
    window[_NEWEST] = max(window[_NEWEST], sequence)
    window[_COUNT] += 1
    return int(window[_NEWEST] - window[_COUNT])


class ReplayWindow:
    """Remembers the sequence numbers seen, so that none is accepted twice."""

    def __init__(self) -> None:
        self.words = np.zeros(_SEEN + REPLAY_WINDOW, np.int64)
        self._words = self.words.data

    @property
    def missing(self) -> int:
        """How many numbers up to the newest have not come."""
        return self._words[_NEWEST] - self._words[_COUNT]

    @property
    def count(self) -> int:
        """How many numbers have come."""
        return self._words[_COUNT]

    def check(self, sequence: int) -> None:
        """Raise MessageError for a number seen before, or too old to know."""
        if problem := problem_code(self.words, sequence):
            raise MessageError(_PROBLEMS[problem])

    def add(self, sequence: int) -> None:
        """Remember a number; only those of verified packets may come here."""
        add(self.words, sequence)


@dataclass(slots=True)
class Session:
    """The keys of one handshake, with counters and replay window.

    `chain_id` names the conversation: the session itself, or the one whose keys it renews.
    `peer` holds the name of whose key opened it.
    """

    session_id: int
    chain_id: int
    peer: str
    outgoing: CipherState
    incoming: CipherState
    began_ns: int
    peer_rate_hz: int
    epoch: int = 0
    window: ReplayWindow = field(default_factory=ReplayWindow)
    sequence: int = 0
    address: Address | None = None
    signed_id: int = field(init=False)

    def __post_init__(self) -> None:
        """Keep the session's number as kernels read it, too: a signed one of 64 bits."""
        self.signed_id = (self.session_id ^ _SIGN) - _SIGN

    @classmethod
    def of(
        cls, keys: noise.SessionKeys, peer: str, now_ns: int, rate_hz: int, continues: int = 0
    ) -> Session:
        """Return the session of a handshake; `continues` is the chain whose keys it renews."""
        session_id = int.from_bytes(keys.handshake_hash[:8], "little")
        return cls(
            session_id, continues or session_id, peer, keys.sending, keys.receiving, now_ns, rate_hz
        )

    def seal(self, clear: bytes, body: Body, sequence: int) -> bytes:
        """Return `clear | sealed body | tag`; `clear` is authenticated."""
        return clear + self.outgoing.aead.encrypt(pack_nonce(sequence), body, clear)

    def open(self, packet: Body, sequence: int) -> bytes:
        """Return the body of a packet. Raises MessageError where it does not verify."""
        try:
            sealed, clear = packet[HEADER_BYTES:], packet[:HEADER_BYTES]
            return self.incoming.aead.decrypt(pack_nonce(sequence), sealed, clear)
        except InvalidTag:
            raise MessageError(NOT_AUTHENTIC) from None
