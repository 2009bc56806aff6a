"""An authenticated end of the link: the newest message of each kind, and what was refused.

Whatever does not verify is dropped in silence and counted by its reason. Of what verifies, the
newest wins: a message older than the newest of its kind is not applied, and neither is one whose
age, by its sender's clock and beyond the link's own delay, is above a bound. Silence is the age of
the newest message taken in, or the time since it came, whichever is longer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from teleop_rt.link.handshake import Answerer, Budget, Caller
from teleop_rt.link.keys import Keys
from teleop_rt.link.messages import (
    HEADER_BYTES,
    Header,
    Kind,
    Message,
    MessageError,
    Model,
    Motion,
    State,
    Taken,
    decode,
    decode_header,
    encode,
    encode_header,
    kind_of,
)
from teleop_rt.link.noise import TAG_BYTES
from teleop_rt.link.peer_clock import PeerClock
from teleop_rt.link.session import Session
from teleop_rt.link.statistics import LATE, STALE, Statistics
from teleop_rt.link.transport import Address, Transport
from teleop_rt.link.troubles import CLOCK_TROUBLE, NOTHING_TROUBLE, TAKEN_TROUBLE, TROUBLES

Role = Literal["master", "slave"]

PACKETS_PER_POLL = 128
MOST_WAITING = 20_000
"""More than a socket's buffer holds: so many are dropped at most, also while others come."""
HELLO_PERIOD_NS = 100_000_000
RECONNECT_AFTER_NS = 2_000_000_000
SLOWEST_LINK_NS = 10_000_000_000
"""Longest round trip waited for: a packet withheld for minutes must not delay a reconnection."""
REKEY_AFTER_NS = 120_000_000_000
"""New ephemeral keys are made for a session as old as this, while the old ones go on."""
REJECT_AFTER_NS = 600_000_000_000
"""Keys as old as this are not used any more, whatever came of the renewal."""
FORMER_NS = 30_000_000_000
"""Packets under the former keys are accepted for so long: slower than any link."""
NOTICES_PER_S = 10
NOTHING_AFTER_NS = 2_000_000_000
_DATA: dict[Role, frozenset[Kind]] = {
    "master": frozenset({Kind.MODEL, Kind.STATE, Kind.TAKEN}),
    "slave": frozenset({Kind.MOTION}),
}


class Endpoint:
    """One end of the link over a transport, in the role of master or slave.

    `poll()` drains what has arrived, then `motion`, `model` and `state` hold the newest of
    each or None, and the `fresh_...` flags say which came in this poll. `send()` before the
    session stands does nothing. `stale_after_ns` bounds the age of what is taken in. `clock` is
    the peer's, fixed by whoever follows it.
    """

    def __init__(
        self,
        role: Role,
        transport: Transport,
        keys: Keys,
        now_ns: Callable[[], int],
        *,
        rate_hz: int,
        accepted_rates_hz: tuple[int, int] = (100, 4000),
        one_way_max_ns: int | None = None,
        stale_after_ns: int = 100_000_000,
    ) -> None:
        self._role: Role = role
        self._data = _DATA[role]
        self._transport = transport
        self._now_ns = now_ns
        self._rate_hz = rate_hz
        self._rates_hz = accepted_rates_hz
        self._stale_after_ns = stale_after_ns
        now = now_ns()
        self._caller = Caller(keys[0]) if role == "master" else None
        callers = keys if role == "slave" else ()
        self._answerer = Answerer(callers, rate_hz, accepted_rates_hz, now)
        self._session: Session | None = None
        self._former: Session | None = None
        self._retired: Session | None = None
        self._notices = Budget(NOTICES_PER_S, now)
        self._hello_due_ns = now
        self._newest: dict[Kind, tuple[int, int]] = {}
        self._peer_stamp_ns = self._peer_stamp_taken_ns = 0
        self._accepted_ns = self._arrived_ns = self._news_ns = now
        self._stale = False
        self._lost_before = 0
        self.clock = PeerClock(one_way_max_ns)
        self.taken_by: str | None = None
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
        """The number of the session, another one after each break; 0 while none stands.

        New keys for the same conversation leave it as it is.
        """
        return 0 if self._session is None else self._session.chain_id

    @property
    def peer(self) -> str:
        """The name of whose key opened the session; empty while none stands."""
        return "" if self._session is None else self._session.peer

    @property
    def peer_rate_hz(self) -> int:
        """The rate that the peer stated; 0 while no session stands."""
        return 0 if self._session is None else self._session.peer_rate_hz

    @property
    def trouble(self) -> str | None:
        """The reason why the link is not connected, as a sentence; None while it is."""
        if self.connected:
            return TROUBLES[CLOCK_TROUBLE][1] if self._stale else None
        return TROUBLES[self._rejection() or NOTHING_TROUBLE][1]

    def trouble_code(self, now_ns: int) -> int:
        """Return the index of the trouble in TROUBLES; 0 while there is none, or none yet."""
        if self.connected:
            return CLOCK_TROUBLE if self._stale else 0
        silent = self.silence_ns(now_ns) > NOTHING_AFTER_NS
        return self._rejection() or (NOTHING_TROUBLE if silent else 0)

    def _rejection(self) -> int:
        """Return the index of the first trouble for which packets were rejected, or 0."""
        if self.taken_by is not None:
            return TAKEN_TROUBLE
        for index, (reason, _) in enumerate(TROUBLES):
            if self.statistics.rejected.get(reason):
                return index
        return 0

    def silence_ns(self, now_ns: int) -> int:
        """Return the age of the newest message taken in, or the time since start before one."""
        return now_ns - min(self._arrived_ns, self._news_ns)

    def poll(self) -> None:
        """Take in what has arrived, a bounded number of packets, and keep the session alive."""
        self.fresh_motion = self.fresh_model = self.fresh_state = False
        self._answerer.new_poll()
        now_ns = self._now_ns()
        for _ in range(PACKETS_PER_POLL):
            packet = self._transport.receive()
            if packet is None:
                break
            try:
                self._take(packet, now_ns)
            except MessageError as error:
                self.statistics.reject(error.reason)
        if self._session is not None:
            self._age(self._session, now_ns)
        if self._caller is not None:
            self._call(self._caller, now_ns)

    def fix_clock(self) -> None:
        """Hold the peer's clock and the link's own delay from now on, if messages come."""
        if self.connected and not self._silent(self._now_ns()):
            self.clock.fix()

    def forget_waiting(self) -> None:
        """Drop what has come while nobody polled: a peer that called for minutes left thousands."""
        for _ in range(MOST_WAITING):
            if self._transport.receive() is None:
                return

    def send(self, message: Motion | Model | State) -> None:
        """Send a message to the peer; without a session it is dropped."""
        if self._session is not None:
            self._send(self._session, message, self._now_ns())
            self.statistics.sent += 1

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()

    def _send(
        self, session: Session, message: Message, now_ns: int, to: Address | None = None
    ) -> None:
        sequence = session.next_sequence()
        held_ns = now_ns - self._peer_stamp_taken_ns
        header = Header(
            kind_of(message), session.session_id, sequence, now_ns, self._peer_stamp_ns, held_ns
        )
        self._transport.send(session.seal(encode_header(header), encode(message), sequence), to)

    def _take(self, packet: bytes, now_ns: int) -> None:
        header = decode_header(packet)
        kind, caller = header.kind, self._caller
        if kind in self._data:
            self._take_data(header, packet, now_ns)
        elif kind is Kind.HELLO and caller is None:
            sender = self._transport.sender
            answer = self._answerer.answer(header, packet, sender, self._session, now_ns)
            self._transport.send(answer, sender)
        elif kind is Kind.WELCOME and caller is not None:
            session = caller.take_welcome(packet, self._rates_hz, now_ns)
            self._transport.confirm_sender()
            self._move_to(session, now_ns)
            self._take_stamps(header, now_ns)
        elif kind is Kind.RETRY and caller is not None:
            caller.take_retry(packet, now_ns)
            self._hello_due_ns = now_ns
        else:
            raise MessageError("kind")

    def _take_data(self, header: Header, packet: bytes, now_ns: int) -> None:
        """Take in a packet of the session; the steps are in the order of what they cost."""
        if len(packet) < HEADER_BYTES + TAG_BYTES:
            raise MessageError("length")
        session = self._session_of(header.session)
        session.window.check(header.sequence)
        body = session.open(packet, header.sequence)
        session.window.add(header.sequence)
        if session is self._retired:
            self._say_taken(session, now_ns)
        if session is not self._session and session is not self._former:
            self._move_to(session, now_ns)
        self._transport.confirm_sender()
        session.address = self._transport.sender
        self._accepted_ns = now_ns
        self.statistics.received += 1
        self._count_lost()
        message = decode(header.kind, body)
        self._take_stamps(header, now_ns)
        self._order(header, session)
        self._store(message, header.stamp_ns, now_ns)

    def _order(self, header: Header, session: Session) -> None:
        """Raise MessageError for a message older than the newest of its kind."""
        order = (session.epoch, header.sequence)
        if order <= self._newest.get(header.kind, (0, 0)):
            raise MessageError(LATE)
        self._newest[header.kind] = order

    def _session_of(self, session_id: int) -> Session:
        session = self._session
        if session is not None and session.session_id == session_id:
            return session
        for session in (self._former, self._retired):
            if session is not None and session.session_id == session_id:
                return session
        candidate = self._answerer.candidate(session_id)
        if candidate is None:
            raise MessageError("session")
        return candidate.session

    def _move_to(self, session: Session, now_ns: int) -> None:
        """Move to another session, or to the next keys of the one that stands."""
        before = self._session
        session.began_ns = self._accepted_ns = now_ns
        self._answerer.confirmed()
        self._session = session
        if before is not None:
            self._lost_before += before.window.missing
        if before is not None and before.chain_id == session.chain_id:
            session.epoch = before.epoch + 1
            self._former = before
            return
        self._former = None
        if before is not None and self._caller is None and not self._silent(now_ns):
            self.statistics.take_overs += 1
            self._retired = before
        self._forget_messages()
        self._newest.clear()
        self._peer_stamp_ns = 0
        self._arrived_ns = self._news_ns = now_ns
        self._stale = False
        self.clock.forget()

    def _say_taken(self, retired: Session, now_ns: int) -> None:
        """Answer whoever goes on in the session that was taken over; it is not obeyed."""
        if self._notices.take(now_ns):
            self._send(retired, Taken(self.peer), now_ns, self._transport.sender)
        raise MessageError("taken over")

    def _count_lost(self) -> None:
        missing = 0 if self._session is None else self._session.window.missing
        self.statistics.lost = self._lost_before + missing

    def _take_stamps(self, header: Header, now_ns: int) -> None:
        stamp_ns = header.stamp_ns
        if stamp_ns > self._peer_stamp_ns:
            self._peer_stamp_ns, self._peer_stamp_taken_ns = stamp_ns, now_ns
        if header.echo_ns:
            received_ns = stamp_ns - header.held_ns
            self.statistics.round_trip(
                self.clock.exchange(header.echo_ns, received_ns, stamp_ns, now_ns)
            )

    def _store(self, message: Message, stamp_ns: int, now_ns: int) -> None:
        """Keep a message that is news. Raises MessageError for one that is too old."""
        if isinstance(message, Taken):
            self._give_way(message)
            return
        age_ns = self.clock.age_ns(stamp_ns, now_ns)
        self._stale = age_ns is None or age_ns > self._stale_after_ns
        if age_ns is None or self._stale:
            raise MessageError(STALE)
        self.statistics.transit(self.clock.transit_ns)
        self._arrived_ns, self._news_ns = now_ns, max(self._news_ns, now_ns - age_ns)
        match message:
            case Motion():
                self.motion, self.fresh_motion = message, True
            case Model():
                self.model, self.fresh_model = message, True
            case State():
                self.state, self.fresh_state = message, True

    def _give_way(self, message: Taken) -> None:
        """End the session that another master has taken over, and do not take it back."""
        self.taken_by = message.peer
        self._session = self._former = None
        self._forget_messages()

    def _forget_messages(self) -> None:
        """Forget all of a session that has ended, also those of this very poll."""
        self.motion = self.model = self.state = None
        self.fresh_motion = self.fresh_model = self.fresh_state = False

    def _silent(self, now_ns: int) -> bool:
        round_trip_ns = min(max(0, self.statistics.round_trip_ns), SLOWEST_LINK_NS)
        return now_ns - self._accepted_ns > RECONNECT_AFTER_NS + round_trip_ns

    def _age(self, session: Session, now_ns: int) -> None:
        """Leave keys behind that have served long enough."""
        age_ns = now_ns - session.began_ns
        if self._former is not None and age_ns > FORMER_NS:
            self._former = None
        if age_ns > REJECT_AFTER_NS:
            self._session = None

    def _call(self, caller: Caller, now_ns: int) -> None:
        """Send Hello while no session stands, after a long silence, or to renew the keys."""
        session = self._session
        due = session is None or self._silent(now_ns)
        renew = session is not None and now_ns - session.began_ns > REKEY_AFTER_NS
        if self.taken_by is not None or now_ns < self._hello_due_ns or not (due or renew):
            return
        self._hello_due_ns = now_ns + HELLO_PERIOD_NS
        continues = 0 if session is None else session.chain_id
        self._transport.send(caller.hello(self._rate_hz, continues, now_ns))
