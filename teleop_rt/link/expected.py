"""Packets of a session that stands, nearly all of them: each is taken in by a few kernels.

A packet is expected where header, session, window and kind are those of a message that belongs to
the session that stands. `Endpoint` takes in all others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from cryptography.exceptions import InvalidTag

from teleop_rt.kernels.jit import bound
from teleop_rt.link import intake
from teleop_rt.link.codec import decode
from teleop_rt.link.door import OTHER, PacketDoor, receive_expected
from teleop_rt.link.endpoint_state import EndpointState
from teleop_rt.link.messages import Kind, Message, MessageError
from teleop_rt.link.session import NOT_AUTHENTIC, ReplayWindow, Session
from teleop_rt.link.transport import Transport, UdpTransport

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from teleop_rt.link.noise import Body
    from teleop_rt.link.peer_clock import PeerClock
    from teleop_rt.link.sessions import Sessions
    from teleop_rt.link.statistics import Statistics

_PAIR = 2
"""Packets of a slave's tick with a model: it sends that and a state."""
# By these names a tick finds them at once.
_KIND, _SEQUENCE = intake.KIND, intake.SEQUENCE
_MOTION, _MODEL = map(int, (Kind.MOTION, Kind.MODEL))


class ExpectedPackets(EndpointState):
    """Takes in the packets of the session that stands, whose `kinds` are bits.

    `words` are the arrays of `intake`, and `clock` is the peer's.
    """

    def __init__(
        self,
        transport: Transport,
        sessions: Sessions,
        clock: PeerClock,
        statistics: Statistics,
        *,
        words: NDArray[np.int64],
        now_ns: Callable[[], int],
        kinds: int,
    ) -> None:
        super().__init__()
        self.transport, self.sessions, self.clock = transport, sessions, clock
        self.statistics, self.words, self._numbers = statistics, words, words.data
        self._now_ns, self._kinds = now_ns, kinds
        self._is_ahead = False
        self._udp = transport if isinstance(transport, UdpTransport) else None
        self._door: PacketDoor | None = None
        if self._udp is not None:
            self._door = PacketDoor(self._udp.packets, self._udp.descriptor)
        self._bind(ReplayWindow())

    def take_ahead(self) -> None:
        """Take in the one packet that nearly always waits, or a state and a model, before a poll.

        Whatever else has come is that poll's.
        """
        if not self._is_ahead:
            self.fresh_motion = self.fresh_state = False
        self._is_ahead, now_ns = True, self._now_ns()
        if not self._take_waiting(now_ns):
            self._take_pair(now_ns)

    def _take_waiting(self, now_ns: int) -> bool:
        """Take in the only packet that waits, if it is expected; false where more is to be done."""
        udp, door, session = self._udp, self._door, self.sessions.current
        if udp is None or door is None or session is None or not udp.is_empty:
            return False
        length = self._receive_expected(udp.name, session.signed_id, self._kinds)
        if length > 0:
            sealed = door.newest if length == door.length else door.sealed(length)  # nearly always
            try:
                body = session.incoming.aead.decrypt(door.nonce, sealed, door.clear)
            except InvalidTag:
                self.statistics.reject(NOT_AUTHENTIC)
            else:
                self._take_expected(session, body, now_ns)
        elif length == OTHER:
            udp.take_up(door.received)
            return False
        return True

    def _take_pair(self, now_ns: int) -> None:
        """Take in two packets, if no more wait, up to one that is not expected."""
        udp, session = self._udp, self.sessions.current
        if udp is None or session is None or udp.held != _PAIR:
            return
        for _ in range(_PAIR):
            packet = udp.next_held()
            if not self._is_expected(packet, session.signed_id, self._kinds):
                return
            udp.receive()
            self._try_expected(session, packet, now_ns)
        udp.receive()  # nothing: it learns that it is empty

    def _try_expected(self, session: Session, packet: Body, now_ns: int) -> None:
        """Open a packet that is expected, and take it in."""
        try:
            body = session.open(packet, self._numbers[_SEQUENCE])
        except MessageError as error:
            self.statistics.reject(error.reason)
        else:
            self._take_expected(session, body, now_ns)

    def _take_expected(self, session: Session, body: bytes, now_ns: int) -> None:
        """Take in one more motion, state or model of the session that stands."""
        sessions, sender = self.sessions, self.transport.sender
        model, kind = None, self._numbers[_KIND]
        if session.address is not sender:
            self.transport.confirm_sender()
            session.address = sender
        sessions.accepted_ns = now_ns
        if kind == _MODEL and (model := self._read_model(session, body)) is None:
            return
        if problem := self._accept(body, session.epoch, sessions.lost_before, now_ns):
            try:
                self._count_problem(problem)
            except MessageError as error:
                self.statistics.reject(error.reason)
                return
        if model is not None:
            self.store(kind, body, model)
        elif kind == _MOTION:
            self._motion, self.fresh_motion = body, True
        else:
            self._state, self.fresh_state = body, True

    def _read_model(self, session: Session, body: bytes) -> Message | None:
        """Read a model before it counts as news; None for one that is refused, which is counted."""
        try:
            return decode(Kind.MODEL, body)
        except MessageError as error:
            session.window.add(self._numbers[_SEQUENCE])
            self.statistics.reject(error.reason)
            return None

    def _count_problem(self, problem: int) -> None:
        """Raise MessageError for a kernel's error code; a wrong echo is only counted."""
        if problem >> intake.ECHO_SHIFT:
            self.statistics.reject(intake.PROBLEMS[problem >> intake.ECHO_SHIFT])
        if refused := problem & intake.REFUSED:
            raise MessageError(intake.PROBLEMS[refused])

    def _bind(self, window: ReplayWindow) -> None:
        """Connect the kernels of nearly every packet to the window of the open session."""
        words = self.words, window.words
        self._is_expected = bound(intake.is_expected, words, b"", 0, 0)
        if self._door is not None:
            self._receive_expected = bound(receive_expected, (*self._door.arrays, *words), 0, 0, 0)
        more = self.clock.words, self.statistics.words, self.newest_motion.words
        self._accept = bound(intake.accept, (*words, *more), b"", 0, 0, 0)
