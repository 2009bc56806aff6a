"""An authenticated end of the link: the newest message of each kind, and refused packets.

A packet that does not verify is dropped in silence and counted by its reason. Of those that verify,
the newest wins: a message older than the newest of its kind is not applied, and neither is one
whose age, by its sender's clock and beyond the link's own delay, is above a bound. Silence is the
age of the newest message taken in, or the time since it came, whichever is longer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from teleop_rt.link import intake
from teleop_rt.link.budget import Budget
from teleop_rt.link.codec import (
    HEADER_BYTES,
    decode,
    decode_header,
    encode,
    kind_of,
    pack_header,
)
from teleop_rt.link.expected import ExpectedPackets
from teleop_rt.link.handshake import Answerer, Caller
from teleop_rt.link.keys import PeerKeys
from teleop_rt.link.messages import (
    Kind,
    MessageError,
    ModelMessage,
    MotionMessage,
    StateMessage,
    TakenOver,
)
from teleop_rt.link.noise import TAG_BYTES, Body
from teleop_rt.link.outgoing import Outgoing
from teleop_rt.link.packet_kernels import load_kernels
from teleop_rt.link.peer_clock import PeerClock
from teleop_rt.link.session import Session
from teleop_rt.link.sessions import Sessions
from teleop_rt.link.statistics import SENT, Statistics
from teleop_rt.link.transport import Address, Transport

Role = Literal["master", "slave"]

PACKETS_PER_POLL = 128
"""Packets read in one tick, so that a flood cannot hold it up."""
MOST_WAITING = 20_000
"""More than a socket's buffer holds: so many are dropped at most, also while others come."""
HELLO_PERIOD_NS = 100_000_000
"""Time between two Hellos without an answer."""
NOTICES_PER_S = 10
"""Rate of messages about refused packets: a flood must not fill the log."""
_DATA: dict[Role, frozenset[int]] = {
    "master": frozenset(map(int, (Kind.MODEL, Kind.STATE, Kind.TAKEN))),
    "slave": frozenset({int(Kind.MOTION)}),
}


# By these names a tick finds them at once.
_MODEL, _TAKEN = map(int, (Kind.MODEL, Kind.TAKEN))
_PEER_STAMP, _PEER_STAMP_TAKEN = intake.PEER_STAMP, intake.PEER_STAMP_TAKEN


class Endpoint(ExpectedPackets):
    """One end of the link over a transport, in the role of master or slave.

    `poll()` drains all arrived packets, then `motion`, `model` and `state` hold the newest of
    each or None, and the `fresh_...` flags say which came in this poll. `send()` before the
    session stands does nothing. `stale_after_ns` bounds the age of messages taken in. `clock` is
    the peer's, fixed by its follower. For kernels `newest_motion` is `motion`, and `words`
    are the arrays of `intake`.
    """

    def __init__(
        self,
        role: Role,
        transport: Transport,
        keys: PeerKeys,
        now_ns: Callable[[], int],
        *,
        rate_hz: int,
        accepted_rates_hz: tuple[int, int] = (100, 4000),
        one_way_max_ns: int | None = None,
        stale_after_ns: int = 100_000_000,
    ) -> None:
        now = now_ns()
        load_kernels()
        data = _DATA[role]
        callers, statistics = keys if role == "slave" else (), Statistics()
        self._answerer = Answerer(callers, rate_hz, accepted_rates_hz, now)
        super().__init__(
            transport,
            Sessions(self._answerer, statistics, now, called=role == "slave"),
            PeerClock(one_way_max_ns),
            statistics,
            words=intake.new_words(now, stale_after_ns),
            now_ns=now_ns,
            kinds=sum(1 << kind for kind in data - {_TAKEN}),
        )
        self._data = data
        self._rate_hz = rate_hz
        self._rates_hz = accepted_rates_hz
        self._caller = Caller(keys[0]) if role == "master" else None
        self._notices = Budget(NOTICES_PER_S, now)
        self._hello_due_ns = now
        self._unsigned = self._numbers.cast("B").cast("Q")
        self.taken_by: str | None = None
        self._outgoing: Outgoing | None = None
        if self._udp is not None:
            self._outgoing = Outgoing(self._udp, self.words, statistics.words)
        self._sent = statistics.words.data[SENT : SENT + 1]

    def poll(self) -> None:
        """Take in arrived packets, a bounded number of them, and keep the session alive.

        Where one packet waits and is expected, or none waits, a kernel finds that out. The
        `fresh_...` flags show packets that were taken in ahead of it, too.
        """
        if not self._is_ahead:
            self.fresh_motion = self.fresh_state = False
        self._is_ahead = False
        now_ns, sessions = self._now_ns(), self.sessions
        if not self._take_waiting(now_ns):
            self._poll_transport(now_ns)
        if now_ns >= sessions.ages_ns:
            sessions.age(now_ns)
        if self._caller is not None:
            self._call(self._caller, now_ns)

    def _poll_transport(self, now_ns: int) -> None:
        """Take in arrived packets, one by one."""
        self._answerer.new_poll()
        sessions, receive = self.sessions, self.transport.receive
        for _ in range(PACKETS_PER_POLL):
            packet = receive()
            if packet is None:
                break
            session = sessions.current
            if session is not None and self._is_expected(packet, session.signed_id, self._kinds):
                self._try_expected(session, packet, now_ns)
                continue
            try:
                self._take(packet, now_ns)
            except MessageError as error:
                self.statistics.reject(error.reason)

    def fix_clock(self) -> None:
        """Hold the peer's clock and the link's own delay from now on, if messages come."""
        if self.sessions.stands(self._now_ns()):
            self.clock.fix()

    def forget_waiting(self) -> None:
        """Drop packets that arrived while nobody polled: a peer may have left thousands."""
        for _ in range(MOST_WAITING):
            if self.transport.receive() is None:
                return

    def send(self, message: MotionMessage | ModelMessage | StateMessage) -> None:
        """Send a message to the peer; without a session it is dropped."""
        if self.connected:
            self.send_body(kind_of(message), encode(message))

    def send_body(self, kind: Kind, body: Body) -> None:
        """Send a message of this kind, of which the body is written already, as by `encode`."""
        session, outgoing = self.sessions.current, self._outgoing
        if session is None:
            return
        now_ns = self._now_ns()
        if outgoing is None:
            self._send(session, kind, body, now_ns)
            self._sent[0] += 1
        else:
            session.sequence = sequence = session.sequence + 1  # each is used once
            outgoing.write_head(kind, session.signed_id, sequence, now_ns)
            sealed = session.outgoing.aead.encrypt(outgoing.nonce, body, outgoing.clear)
            if not outgoing.send_sealed(sealed):
                self.transport.send(bytes(outgoing.clear) + sealed)

    def close(self) -> None:
        """Close the transport."""
        self.transport.close()

    def _send(
        self, session: Session, kind: Kind, body: Body, now_ns: int, to: Address | None = None
    ) -> None:
        numbers = self._numbers
        session.sequence = sequence = session.sequence + 1  # each is used once
        stamp_ns, held_ns = numbers[_PEER_STAMP], now_ns - numbers[_PEER_STAMP_TAKEN]
        clear = pack_header(kind, session.session_id, sequence, now_ns, stamp_ns, held_ns)
        self.transport.send(session.seal(clear, body, sequence), to)

    def _take(self, packet: bytes, now_ns: int) -> None:
        """Take in a packet of any kind: a few in a session, all others before one stands."""
        if problem := intake.read_header(self.words, packet):
            raise MessageError(intake.PROBLEMS[problem])
        kind, caller = self._numbers[intake.KIND], self._caller
        if kind in self._data:
            self._take_data(kind, packet, now_ns)
        elif kind == Kind.HELLO and caller is None:
            sender = self.transport.sender
            header = decode_header(packet)
            standing = self.sessions.current
            led = standing is not None and not self.sessions.silent(now_ns)
            answer = self._answerer.answer(header, packet, sender, standing, now_ns, led=led)
            self.transport.send(answer, sender)
        elif kind == Kind.WELCOME and caller is not None:
            session = caller.take_welcome(packet, self._rates_hz, now_ns)
            self.transport.confirm_sender()
            self._move_to(session, now_ns)
            self._count_problem(
                intake.take_stamps(self.words, self.clock.words, self.statistics.words, now_ns)
            )
        elif kind == Kind.RETRY and caller is not None:
            caller.take_retry(packet, now_ns)
            self._hello_due_ns = now_ns
        else:
            raise MessageError("kind")

    def _take_data(self, kind: int, packet: bytes, now_ns: int) -> None:
        """Take in a packet of the session; the steps are in the order of their cost."""
        if len(packet) < HEADER_BYTES + TAG_BYTES:
            raise MessageError("length")
        sessions = self.sessions
        session = sessions.find(self._unsigned[intake.SESSION])
        sequence = self._numbers[intake.SEQUENCE]
        session.window.check(sequence)
        body = session.open(packet, sequence)
        session.window.add(sequence)
        if sessions.is_taken_over(session):
            self._say_taken(session, now_ns)
        if not sessions.is_known(session):
            self._move_to(session, now_ns)
        self.transport.confirm_sender()
        session.address = self.transport.sender
        if session is sessions.current:  # under its former keys a peer may not know these
            sessions.accepted_ns = now_ns
        # A model is read before it counts as news; of the rest the kernel looks at the body.
        read = decode(Kind(kind), body) if kind in (_MODEL, _TAKEN) else None
        self._count_problem(
            intake.take_in(
                self.words,
                self.clock.words,
                self.statistics.words,
                body,
                session.epoch,
                sessions.lost,
                now_ns,
            )
        )
        if isinstance(read, TakenOver):
            self._give_way(read)
        else:
            self.store(kind, body, read)

    def _move_to(self, session: Session, now_ns: int) -> None:
        """Move to another session; with a new conversation nothing of the last one is valid."""
        self._bind(session.window)
        if self.sessions.move_to(session, now_ns):
            self.forget()
            intake.forget_peer(self.words, now_ns)
            self.clock.forget()

    def _say_taken(self, retired: Session, now_ns: int) -> None:
        """Answer a peer that continues a session that was taken over; it is not obeyed."""
        if self._notices.take(now_ns):
            body = encode(TakenOver(self.peer))
            self._send(retired, Kind.TAKEN, body, now_ns, self.transport.sender)
        raise MessageError("taken over")

    def _give_way(self, message: TakenOver) -> None:
        """End the session that another master has taken over, and do not take it back."""
        self.taken_by = message.peer
        self.sessions.end()
        self.forget()

    def _call(self, caller: Caller, now_ns: int) -> None:
        """Send Hello while no session stands, after a long silence, or to renew the keys."""
        if self.taken_by is not None or now_ns < self._hello_due_ns:
            return
        if not self.sessions.wants_keys(now_ns):
            return
        self._hello_due_ns = now_ns + HELLO_PERIOD_NS
        self.transport.send(caller.hello(self._rate_hz, self.session_id, now_ns))
