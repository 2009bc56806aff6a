"""An authenticated end of the link: the newest message of each kind, and what was refused.

Whatever does not verify is dropped in silence and counted by its reason. Of what verifies, the
newest wins: a message older than the newest of its kind is not applied. Silence is the time
since the last accepted packet, whatever its age.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Literal

from teleop_rt.link.handshake import open_handshake, seal_handshake
from teleop_rt.link.messages import (
    SALT_BYTES,
    Header,
    Hello,
    Kind,
    Message,
    MessageError,
    Model,
    Motion,
    State,
    Welcome,
    decode,
    decode_header,
    encode,
    encode_header,
    kind_of,
)
from teleop_rt.link.security import Session
from teleop_rt.link.statistics import LATE, LATE_WELCOME, Statistics
from teleop_rt.link.transport import Address, Transport
from teleop_rt.link.troubles import TROUBLES

Role = Literal["master", "slave"]

PACKETS_PER_POLL = 128
MOST_WAITING = 20_000
"""More than a socket's buffer holds: so many are dropped at most, also while others come."""
HELLO_PERIOD_NS = 100_000_000
RECONNECT_AFTER_NS = 2_000_000_000
HANDSHAKES_PER_S = 50
CANDIDATES = 4
_HANDSHAKE: dict[Role, Kind] = {"master": Kind.WELCOME, "slave": Kind.HELLO}
_DATA: dict[Role, tuple[Kind, ...]] = {
    "master": (Kind.MODEL, Kind.STATE),
    "slave": (Kind.MOTION,),
}
NOTHING_AFTER_NS = 2_000_000_000


class Endpoint:
    """One end of the link over a transport, in the role of master or slave.

    `poll()` drains what has arrived, then `motion`, `model` and `state` hold the newest of
    each or None, and the `fresh_...` flags tell which came in this poll. `send()` before the
    session stands does nothing. `random_bytes` makes salts; a seeded one makes runs repeatable.
    """

    def __init__(
        self,
        role: Role,
        transport: Transport,
        key: bytes,
        now_ns: Callable[[], int],
        *,
        rate_hz: int,
        accepted_rates_hz: tuple[int, int] = (100, 4000),
        random_bytes: Callable[[int], bytes] = os.urandom,
    ) -> None:
        self._role: Role = role
        self._handshake, self._data = _HANDSHAKE[role], _DATA[role]
        self._transport = transport
        self._key = key
        self._now_ns = now_ns
        self._rate_hz = rate_hz
        self._accepted_rates_hz = accepted_rates_hz
        self._random_bytes = random_bytes
        self._session: Session | None = None
        self._candidates: dict[bytes, Session] = {}
        self._salt = self._former_salt = random_bytes(SALT_BYTES)
        self._handshakes_sent = 0
        self._hello_due_ns = now_ns()
        self._handshake_budget = float(HANDSHAKES_PER_S)
        self._budget_ns = now_ns()
        self._newest: dict[Kind, int] = {}
        self._peer_stamp_ns = self._peer_stamp_taken_ns = 0
        self._accepted_ns = now_ns()
        self._lost_before = 0
        self.peer_rate_hz = 0
        self.statistics = Statistics()
        self.motion: Motion | None = None
        self.model: Model | None = None
        self.state: State | None = None
        self.fresh_motion = self.fresh_model = self.fresh_state = False

    @property
    def connected(self) -> bool:
        """Whether a session stands."""
        return self._session is not None

    @property
    def session_id(self) -> int:
        """The number of the session, another one after each handshake; 0 while none stands."""
        return 0 if self._session is None else self._session.session_id

    @property
    def trouble(self) -> str | None:
        """What keeps the link from standing, as a sentence; None while it stands."""
        if self.connected:
            return None
        return TROUBLES[self._rejection() or len(TROUBLES) - 1][1]

    def trouble_code(self, now_ns: int) -> int:
        """Return the index of the trouble in TROUBLES; 0 while there is none, or none yet."""
        if self.connected:
            return 0
        silent = self.silence_ns(now_ns) > NOTHING_AFTER_NS
        return self._rejection() or (len(TROUBLES) - 1 if silent else 0)

    def _rejection(self) -> int:
        """Return the index of the first trouble for which packets were rejected, or 0."""
        for index, (reason, _) in enumerate(TROUBLES):
            if self.statistics.rejected.get(reason):
                return index
        return 0

    def silence_ns(self, now_ns: int) -> int:
        """Return the time since the last accepted packet, or since start before the first."""
        return now_ns - self._accepted_ns

    def poll(self) -> None:
        """Take in what has arrived, a bounded number of packets, and keep the session alive."""
        self.fresh_motion = self.fresh_model = self.fresh_state = False
        now_ns = self._now_ns()
        for _ in range(PACKETS_PER_POLL):
            packet = self._transport.receive()
            if packet is None:
                break
            try:
                self._take(packet, now_ns)
            except MessageError as error:
                self.statistics.reject(error.reason)
        if self._role == "master":
            self._call(now_ns)

    def forget_waiting(self) -> None:
        """Drop what has come while nobody polled: a peer that called for minutes left thousands."""
        for _ in range(MOST_WAITING):
            if self._transport.receive() is None:
                return

    def send(self, message: Motion | Model | State) -> None:
        """Send a message to the peer; without a session it is dropped."""
        session = self._session
        if session is None:
            return
        now_ns = self._now_ns()
        sequence = session.next_sequence()
        held_ns = now_ns - self._peer_stamp_taken_ns
        header = Header(
            kind_of(message), session.session_id, sequence, now_ns, self._peer_stamp_ns, held_ns
        )
        packet = session.outgoing.seal(encode_header(header), encode(message), sequence)
        self._transport.send(packet)
        self.statistics.sent += 1

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()

    def _take(self, packet: bytes, now_ns: int) -> None:
        header = decode_header(packet)
        if header.kind in self._data:
            self._take_data(header, packet, now_ns)
        elif header.kind is self._handshake:
            self._take_handshake(header, packet, now_ns)
        else:
            raise MessageError("kind")

    def _take_data(self, header: Header, packet: bytes, now_ns: int) -> None:
        session = self._session_of(header.session)
        session.window.check(header.sequence)
        body = session.incoming.open(packet, header.sequence)
        if session is not self._session:
            self._begin(session)
        session.window.add(header.sequence)
        self._transport.confirm_sender()
        self._accepted_ns = now_ns
        self.statistics.received += 1
        self.statistics.lost = self._lost_before + session.window.missing
        message = decode(header.kind, body)
        self._take_echo(header, now_ns)
        if header.sequence <= self._newest.get(header.kind, 0):
            raise MessageError(LATE)
        self._newest[header.kind] = header.sequence
        self._store(message)

    def _session_of(self, session_id: int) -> Session:
        session = self._session
        if session is not None and session.session_id == session_id:
            return session
        for candidate in self._candidates.values():
            if candidate.session_id == session_id:
                return candidate
        raise MessageError("session")

    def _begin(self, session: Session) -> None:
        """Move to a new session; messages, sequence numbers, losses and stamps start again."""
        self._session = session
        self.motion = self.model = self.state = None
        self._candidates.clear()
        self._newest.clear()
        self._lost_before = self.statistics.lost
        self._peer_stamp_ns = 0

    def _take_echo(self, header: Header, now_ns: int) -> None:
        stamp_ns = header.stamp_ns
        if stamp_ns > self._peer_stamp_ns:
            self._peer_stamp_ns, self._peer_stamp_taken_ns = stamp_ns, now_ns
        if header.echo_ns:
            self.statistics.exchange(header.echo_ns, stamp_ns - header.held_ns, stamp_ns, now_ns)

    def _store(self, message: Message) -> None:
        match message:
            case Motion():
                self.motion, self.fresh_motion = message, True
            case Model():
                self.model, self.fresh_model = message, True
            case State():
                self.state, self.fresh_state = message, True

    def _take_handshake(self, header: Header, packet: bytes, now_ns: int) -> None:
        self._handshake_budget += (now_ns - self._budget_ns) * HANDSHAKES_PER_S / 1e9
        self._handshake_budget = min(self._handshake_budget, float(HANDSHAKES_PER_S))
        self._budget_ns = now_ns
        if self._handshake_budget < 1:
            raise MessageError("handshake rate")
        self._handshake_budget -= 1
        message, salt = open_handshake(self._key, header, packet)
        lowest, highest = self._accepted_rates_hz
        if not lowest <= message.rate_hz <= highest:
            raise MessageError("rate")
        if isinstance(message, Welcome):
            self._take_welcome(message, salt, now_ns)
        else:
            self._grant(salt, now_ns)
        self.peer_rate_hz = message.rate_hz

    def _take_welcome(self, message: Welcome, slave_salt: bytes, now_ns: int) -> None:
        """Begin the session asked for, unless it has begun or the old one has come back."""
        if message.salt != self._salt:
            late = message.salt == self._former_salt
            raise MessageError(LATE_WELCOME if late else "foreign welcome")
        if self.connected and not self._silent(now_ns):
            raise MessageError(LATE_WELCOME)
        self._transport.confirm_sender()
        self._begin(Session.derive(self._key, self._salt, slave_salt, self._role))
        self._accepted_ns = now_ns

    def _grant(self, master_salt: bytes, now_ns: int) -> None:
        """Answer a Hello; the same Hello gets the same answer, so that repeats are harmless."""
        session = self._candidates.get(master_salt)
        if session is None and self._session and self._session.peer_salt == master_salt:
            session = self._session
        if session is None:
            slave_salt = self._random_bytes(SALT_BYTES)
            session = Session.derive(self._key, master_salt, slave_salt, self._role)
            if len(self._candidates) >= CANDIDATES:
                del self._candidates[next(iter(self._candidates))]
            self._candidates[master_salt] = session
        welcome = Welcome(self._rate_hz, master_salt)
        self._send_handshake(welcome, session.own_salt, now_ns, self._transport.sender)

    def _silent(self, now_ns: int) -> bool:
        return now_ns - self._accepted_ns > RECONNECT_AFTER_NS

    def _call(self, now_ns: int) -> None:
        """Send Hello while no session stands, or with a new salt after a long silence."""
        if now_ns < self._hello_due_ns or not (self._session is None or self._silent(now_ns)):
            return
        if self._session is not None and self._session.own_salt == self._salt:
            self._former_salt = self._salt
            self._salt = self._random_bytes(SALT_BYTES)
        self._hello_due_ns = now_ns + HELLO_PERIOD_NS
        self._send_handshake(Hello(self._rate_hz), self._salt, now_ns)

    def _send_handshake(
        self, message: Hello | Welcome, salt: bytes, now_ns: int, to: Address | None = None
    ) -> None:
        self._handshakes_sent += 1
        packet = seal_handshake(self._key, message, salt, self._handshakes_sent, now_ns)
        self._transport.send(packet, to)
