"""Handshake and window against an attacker who owns the wire, as a state machine.

The attacker sees every packet and decides which arrives, when, how often, in which order and at
which end. Under every attack: no nonce comes twice under one key, news that is taken in was sent by
the genuine peer, in order and once, no motion older than its bound is followed, and once the wire
is honest again, both ends talk.
"""

from __future__ import annotations

from collections import deque

from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from teleop_rt.link.channel import Endpoint
from teleop_rt.link.codec import decode_header
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import MotionMessage, StateMessage
from teleop_rt.link.sessions import RECONNECT_AFTER_NS, SLOWEST_LINK_NS
from teleop_rt_dev.link.pair import KEY, MS

BOUND_MS = 100


class AttackedEnd:
    """A transport whose other end is the attacker."""

    sender = None

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.arriving: deque[bytes] = deque()

    def send(self, packet: bytes, to: object = None) -> None:
        self.sent.append(packet)

    def receive(self) -> bytes | None:
        return self.arriving.popleft() if self.arriving else None

    def confirm_sender(self) -> None:
        pass

    def close(self) -> None:
        pass


class Attacker(RuleBasedStateMachine):
    """Messages of motion and state carry the time at which they were said, in milliseconds."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 10**12
        self.wires = {"master": AttackedEnd(), "slave": AttackedEnd()}
        self.ends: dict[str, Endpoint] = {}
        self.passed = {"master": 0, "slave": 0}
        self.applied = {"master": 0.0, "slave": 0.0}
        self.fixed = False
        for role in self.wires:
            self.start(role)

    def start(self, role: str) -> None:
        self.ends[role] = Endpoint(
            role, self.wires[role], shared_key(KEY), lambda: self.now,
            rate_hz=1000, stale_after_ns=BOUND_MS * MS,
        )  # fmt: skip

    @initialize()
    def meet(self) -> None:
        self.honest(60)

    def talk(self) -> None:
        """Let both ends take in all packets, and state the time."""
        now_ms = self.now / MS
        self.ends["master"].poll()
        self.ends["master"].send(MotionMessage(now_ms, 0.0, 0, engaged=True))
        self.ends["slave"].poll()
        self.ends["slave"].send(StateMessage(now_ms, 0.0, 0, in_contact=False))
        self.check_news()
        self.now += MS

    def check_news(self) -> None:
        for role, end in self.ends.items():
            if role == "slave":
                fresh, said = end.fresh_motion, end.motion and end.motion.target
            else:
                fresh, said = end.fresh_state, end.state and end.state.position
            if fresh:
                assert said > self.applied[role], "old or repeated words were taken for news"
                self.applied[role] = said
                if role == "slave" and self.fixed:
                    assert self.now / MS - said <= BOUND_MS + 50, "old motion was followed"

    def pass_on(self, sender: str) -> None:
        wire, other = self.wires[sender], self.wires["slave" if sender == "master" else "master"]
        other.arriving.extend(wire.sent[self.passed[sender] :])
        self.passed[sender] = len(wire.sent)

    @rule(ticks=st.integers(1, 60))
    def honest(self, ticks: int) -> None:
        for _ in range(ticks):
            for sender in self.wires:
                self.pass_on(sender)
            self.talk()

    @rule(ticks=st.integers(1, 60), sender=st.sampled_from(["master", "slave"]))
    def drop(self, ticks: int, sender: str) -> None:
        for _ in range(ticks):
            self.pass_on("slave" if sender == "master" else "master")
            self.talk()
        self.passed[sender] = len(self.wires[sender].sent)

    @rule(ticks=st.integers(1, 400))
    def withhold(self, ticks: int) -> None:
        for _ in range(ticks):
            self.talk()

    @rule(seconds=st.integers(1, 130))
    def wait(self, seconds: int) -> None:
        self.now += seconds * 1000 * MS

    @rule(sender=st.sampled_from(["master", "slave"]))
    def backwards(self, sender: str) -> None:
        wire, other = self.wires[sender], self.wires["slave" if sender == "master" else "master"]
        other.arriving.extend(reversed(wire.sent[self.passed[sender] :]))
        self.passed[sender] = len(wire.sent)
        self.talk()

    @rule(
        sender=st.sampled_from(["master", "slave"]),
        to=st.sampled_from(["master", "slave"]),
        picks=st.lists(st.integers(0, 10**6), min_size=1, max_size=20),
    )
    def repeat_or_reflect(self, sender: str, to: str, picks: list[int]) -> None:
        """Play recorded packets, of either end, of any session, to either end."""
        sent = self.wires[sender].sent
        self.wires[to].arriving.extend(sent[pick % len(sent)] for pick in picks)
        self.talk()

    @rule(to=st.sampled_from(["master", "slave"]))
    def play_every_handshake_again(self, to: str) -> None:
        recorded = self.wires["slave" if to == "master" else "master"].sent
        handshakes = [packet for packet in recorded if decode_header(packet).session == 0]
        self.wires[to].arriving.extend(handshakes[-50:])
        self.talk()

    @rule(role=st.sampled_from(["master", "slave"]))
    def restart(self, role: str) -> None:
        self.start(role)
        if role == "slave":
            self.fixed = False

    @precondition(lambda self: self.ends["slave"].silence_ns(self.now) < 5 * MS)
    @rule()
    def arm(self) -> None:
        self.ends["slave"].fix_clock()
        if self.ends["slave"].clock.fixed:
            self.fixed = self.ends["slave"].clock.one_way_ns < 50 * MS

    @invariant()
    def no_nonce_comes_twice(self) -> None:
        for wire in self.wires.values():
            headers = [decode_header(packet) for packet in wire.sent]
            nonces = [(h.session, h.sequence) for h in headers if h.session]
            assert len(set(nonces)) == len(nonces)

    def teardown(self) -> None:
        """The wire is honest again: both ends talk once an armed axis is armed again."""
        self.ends["slave"].clock.release()
        self.fixed = False
        for wire in self.wires.values():
            wire.arriving.clear()
        for _ in range(2):
            self.now += RECONNECT_AFTER_NS + SLOWEST_LINK_NS
            self.honest(2500)
        for end in self.ends.values():
            assert end.connected
            assert end.silence_ns(self.now) < 5 * MS


TestAttacker = Attacker.TestCase


def test_a_welcome_withheld_for_minutes_does_not_keep_the_master_from_calling_again():
    attacker = Attacker()
    attacker.meet()
    attacker.backwards("master")
    attacker.wait(40)
    attacker.restart("master")
    attacker.play_every_handshake_again("slave")
    attacker.wait(93)
    attacker.restart("slave")
    attacker.play_every_handshake_again("slave")
    attacker.wait(82)
    attacker.drop(7, "slave")
    attacker.wait(37)
    attacker.play_every_handshake_again("slave")
    attacker.withhold(224)
    attacker.play_every_handshake_again("master")
    attacker.teardown()


def test_a_master_that_moved_to_keys_the_slave_has_forgotten_calls_again():
    attacker = Attacker()
    attacker.meet()
    attacker.wait(111)
    attacker.play_every_handshake_again("slave")
    attacker.play_every_handshake_again("slave")
    attacker.wait(19)
    attacker.teardown()


# Shrinking a history of thousands of packets takes minutes: only generated.
TestAttacker.settings = settings(
    max_examples=15,
    stateful_step_count=20,
    deadline=None,
    phases=[Phase.generate],
)


def test_a_message_of_a_session_that_ended_in_the_same_poll_is_not_fresh():
    attacker = Attacker()
    attacker.meet()
    attacker.honest(17)
    attacker.withhold(160)
    attacker.backwards("master")
    attacker.wait(123)
    attacker.restart("slave")
    attacker.play_every_handshake_again("master")
    attacker.arm()
    attacker.wait(111)
    attacker.wait(33)
    attacker.play_every_handshake_again("master")
    attacker.honest(55)
    attacker.teardown()
