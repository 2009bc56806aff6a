"""The kernels that a packet passes against the readable form of the same rules."""

from __future__ import annotations

import math
from struct import Struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teleop_rt.link import intake
from teleop_rt.link.codec import decode, decode_header, encode_header
from teleop_rt.link.messages import Header, Kind, MessageError
from teleop_rt.link.peer_clock import FARTHEST_NS, FUTURE_NS, PeerClock
from teleop_rt.link.statistics import Statistics

NOW = 10**15
STALE_NS = 100_000_000
LAYOUTS = {Kind.MOTION: Struct("<dddddQBBBB"), Kind.STATE: Struct("<dddddQBBBBB")}
STAMPS = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.integers(NOW - 2 * STALE_NS, NOW + 2 * FUTURE_NS),
    st.sampled_from([-(2**63), 2**63 - 1, NOW - STALE_NS, NOW + FUTURE_NS]),
)
NUMBERS = st.one_of(st.just(0.0), st.floats(), st.sampled_from([math.nan, math.inf, -math.inf]))


def taken(kind: Kind, body: bytes, header: Header) -> tuple[int, int]:
    """Return the kernels' results for a packet that verified: for its body, and for its echo."""
    link, clock = intake.new_words(NOW, STALE_NS), PeerClock()
    clock.exchange(NOW, NOW, NOW, NOW)  # clocks alike, and a link without delay
    clock.fix()
    assert intake.read_header(link, encode_header(header)) == intake.FINE
    found = intake.take_in(link, clock.words, Statistics().words, body, 0, 0, NOW)
    return found & intake.REFUSED, found >> intake.ECHO_SHIFT


def news(kind: Kind, body: bytes) -> str:
    """Why a body is refused that has just come, empty where it is not."""
    return intake.PROBLEMS[taken(kind, body, Header(kind, 1, 1, NOW))[0]]


@settings(deadline=None)  # the first call may compile
@given(
    st.sampled_from([Kind.MOTION, Kind.STATE]),
    st.lists(NUMBERS, min_size=5, max_size=5),
    st.lists(st.sampled_from([0, 1, 2, 255]), min_size=5, max_size=5),
    st.integers(0, 2**64 - 1),
)
def test_a_body_is_refused_for_what_its_reader_refuses(
    kind: Kind, numbers: list[float], codes: list[int], contact: int
) -> None:
    layout = LAYOUTS[kind]
    body = layout.pack(*numbers, contact, *codes[: 4 if kind is Kind.MOTION else 5])
    try:
        decode(kind, body)
    except MessageError as error:
        assert news(kind, body) == error.reason
    else:
        assert news(kind, body) == ""


@pytest.mark.parametrize("kind", [Kind.MOTION, Kind.STATE])
def test_a_body_of_another_length_is_refused(kind: Kind) -> None:
    size = LAYOUTS[kind].size
    assert news(kind, bytes(size)) == ""
    assert {news(kind, bytes(length)) for length in (0, size - 1, size + 1)} == {"length"}


@settings(deadline=None)  # the first call may compile
@given(st.binary(max_size=60) | st.binary(max_size=57).map(lambda rest: b"TR\x07" + rest))
def test_a_header_is_refused_for_what_its_reader_refuses(packet: bytes) -> None:
    link = intake.new_words(NOW, STALE_NS)
    problem = intake.PROBLEMS[intake.read_header(link, packet)]
    try:
        header = decode_header(packet)
    except MessageError as error:
        assert problem == error.reason
        return
    assert problem == ""
    assert (link[intake.KIND], link.view("u8")[intake.SESSION]) == (header.kind, header.session)
    assert link.view("u8")[intake.SEQUENCE] == header.sequence
    assert link[intake.STAMP] == min(max(header.stamp_ns, -FARTHEST_NS), FARTHEST_NS)


@settings(deadline=None)  # the first call may compile
@given(STAMPS, STAMPS, STAMPS)
def test_no_stamp_is_so_large_that_its_age_becomes_small(stamp: int, echo: int, held: int) -> None:
    body = bytes(LAYOUTS[Kind.MOTION].size)
    problem, wrong_echo = taken(Kind.MOTION, body, Header(Kind.MOTION, 1, 1, stamp, echo, held))
    received = stamp - held
    round_trip = (NOW - echo) - (stamp - received)
    if abs(stamp) < FARTHEST_NS and abs(held) < FARTHEST_NS and abs(echo) < FARTHEST_NS and echo:
        assert bool(wrong_echo) == (round_trip < 0)
    if not echo:
        refused = not -STALE_NS < stamp - NOW <= FUTURE_NS
        assert intake.PROBLEMS[problem] == ("stale" if refused else "")
