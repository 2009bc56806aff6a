"""Checks that a packet passes before it is news, as kernels: header, body, order, stamps, age.

`link` are the words of one end, of which the first hold the header that was read last. Stamps are
nanoseconds; whole numbers of 64 bits are read as signed ones, for a count never gets so far.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.kernels.jit import kernel, shared
from teleop_rt.link import codec
from teleop_rt.link.messages import Kind
from teleop_rt.link.noise import TAG_BYTES
from teleop_rt.link.peer_clock import FARTHEST_NS, TRANSIT, UNDATED, age_of, match_round_trip
from teleop_rt.link.session import add, problem_code
from teleop_rt.link.statistics import (
    LATE,
    LOST,
    RECEIVED,
    STALE,
    note_round_trip,
    note_transit,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Whole = NDArray[np.int64]
    Bytes = NDArray[np.uint8]

_KINDS = len(Kind) + 1
(
    KIND,
    SESSION,
    SEQUENCE,
    STAMP,
    _ECHO,
    _HELD,
    PEER_STAMP,
    PEER_STAMP_TAKEN,
    ARRIVED,
    NEWS,
    IS_STALE,
    _STALE_AFTER,
    _NEWEST,
) = range(13)
WORDS = _NEWEST + 2 * _KINDS

PROBLEMS = ("", "length", "magic", "version", "kind", "not finite", "flag", "echo", LATE, STALE)
(
    FINE,
    _LENGTH,
    _MAGIC,
    _VERSION,
    _KIND,
    _NOT_FINITE,
    _FLAG,
    _ECHO_PROBLEM,
    _LATE,
    _STALE,
) = range(len(PROBLEMS))
ECHO_SHIFT, REFUSED = 8, 0xFF
"""An impossible echo is reported above the bits of a refusal: the rest of a packet may be fine."""

_LEAST_BYTES = codec.HEADER_BYTES + TAG_BYTES
_HEADER_BYTES, _MAGIC_WORD, _VERSION_BYTE = (
    codec.HEADER_BYTES,
    int.from_bytes(codec.MAGIC, "little"),
    codec.VERSION,
)
_VERSION_AT, _KIND_AT = codec.VERSION_AT, codec.KIND_AT
_SESSION_AT, _SEQUENCE_AT = codec.SESSION_AT, codec.SEQUENCE_AT
_STAMP_AT, _ECHO_AT, _HELD_AT = codec.STAMP_AT, codec.ECHO_AT, codec.HELD_AT
_MOTION, _STATE, _TAKEN = int(Kind.MOTION), int(Kind.STATE), int(Kind.TAKEN)
_NUMBERS = 5
"""Floating-point numbers that a motion and a state begin with; a contact's number follows."""
_MOTION_BYTES, _STATE_BYTES = codec.MOTION_BYTES, codec.STATE_BYTES
_FLAGS_AT = 8 * (_NUMBERS + 1)
_STATE_CODES = (_FLAGS_AT + 2, _FLAGS_AT + 4)
"""Bytes of a state that are codes and no flags: safety state and fault."""


def new_words(now_ns: int, stale_after_ns: int) -> Whole:
    """Return the words of an end that begins now; messages older than this are not taken in."""
    link = np.zeros(WORDS, np.int64)
    link[ARRIVED] = link[NEWS] = now_ns
    link[_STALE_AFTER] = stale_after_ns
    return link


def forget_peer(link: Whole, now_ns: int) -> None:
    """Begin with another peer: its stamps, order and news are all to come."""
    link[_NEWEST:] = 0
    link[PEER_STAMP] = link[IS_STALE] = 0
    link[ARRIVED] = link[NEWS] = now_ns


def newest(link: Whole, kind: int) -> tuple[int, int]:
    """Return epoch and sequence of the newest message of a kind; zeros before the first."""
    at = _NEWEST + 2 * kind
    return int(link[at]), int(link[at + 1])


@shared
def silence_of(link: Whole | memoryview, now_ns: int) -> int:
    """Return the age of the newest message taken in, or the time since start before one.

    A message that arrives after the tick has read its clock is as old as the tick: 0.
    """
    return max(0, int(now_ns - min(link[ARRIVED], link[NEWS])))


@kernel
def _whole(packet: bytes | Bytes, at: int) -> int:
    """Return the signed number in eight bytes."""
    value = np.int64(0)
    for byte in range(8):
        value |= np.int64(packet[at + byte]) << np.int64(8 * byte)
    return int(value)


@kernel
def put_whole(memory: Bytes, at: int, value: int) -> None:
    """Write a number into eight bytes."""
    for byte in range(8):
        memory[at + byte] = value >> (8 * byte) & 0xFF


@kernel
def _stamp(packet: bytes | Bytes, at: int) -> int:
    return min(max(_whole(packet, at), -FARTHEST_NS), FARTHEST_NS)


@kernel
def read_header(link: Whole, packet: bytes | Bytes) -> int:
    """Read the header of a packet into the first words; return its error code, or FINE."""
    if len(packet) < _HEADER_BYTES:
        return _LENGTH
    if int(packet[0]) | int(packet[1]) << 8 != _MAGIC_WORD:
        return _MAGIC
    if packet[_VERSION_AT] != _VERSION_BYTE:
        return _VERSION
    if not 0 < packet[_KIND_AT] < _KINDS:
        return _KIND
    link[KIND] = packet[_KIND_AT]
    link[SESSION], link[SEQUENCE] = _whole(packet, _SESSION_AT), _whole(packet, _SEQUENCE_AT)
    link[STAMP], link[_ECHO], link[_HELD] = (
        _stamp(packet, _STAMP_AT),
        _stamp(packet, _ECHO_AT),
        _stamp(packet, _HELD_AT),
    )
    return FINE


@kernel
def is_expected(
    link: Whole, window: Whole, packet: bytes | Bytes, session: int, kinds: int
) -> bool:
    """Return whether a packet is one more of this session, of one of these kinds (bits).

    Whatever is wrong with another is found out by looking at it step by step.
    """
    if read_header(link, packet) != FINE or len(packet) < _LEAST_BYTES:
        return False
    return (
        link[SESSION] == session
        and kinds >> link[KIND] & 1 == 1
        and problem_code(window, link[SEQUENCE]) == 0
    )


@kernel
def accept(
    link: Whole,
    window: Whole,
    clock: Whole,
    statistics: Whole,
    motion: Bytes,
    body: bytes,
    epoch: int,
    lost_before: int,
    now_ns: int,
) -> int:
    """Take in the expected packet that verified: its number, and as `take_in` does.

    `motion` are the bytes of a `NewestMotion`, which a motion in order replaces.
    """
    missing = add(window, link[SEQUENCE])
    problem = take_in(link, clock, statistics, body, epoch, lost_before + missing, now_ns)
    if link[KIND] == _MOTION and problem & REFUSED == FINE:
        keep_motion(motion, body)
    return problem


@kernel
def keep_motion(motion: Bytes, body: bytes) -> None:
    """Write the body of a motion into the record of the newest one; its last byte is `known`."""
    for at in range(_MOTION_BYTES):
        motion[at] = body[at]
    motion[_MOTION_BYTES] = 1


@kernel
def _finite(body: bytes, at: int) -> bool:
    """Return whether the number in eight bytes is finite: its exponent is not all ones."""
    return not (body[at + 7] & 0x7F == 0x7F and body[at + 6] & 0xF0 == 0xF0)


@kernel
def _body_problem(kind: int, body: bytes) -> int:
    """Return the error code of the body of a motion or a state, or FINE."""
    if len(body) != (_MOTION_BYTES if kind == _MOTION else _STATE_BYTES):
        return _LENGTH
    for number in range(_NUMBERS):
        if not _finite(body, 8 * number):
            return _NOT_FINITE
    for at in range(_FLAGS_AT, len(body)):
        code = kind == _STATE and _STATE_CODES[0] <= at < _STATE_CODES[1]
        if body[at] > 1 and not code:
            return _FLAG
    return FINE


@kernel
def take_in(
    link: Whole,
    clock: Whole,
    statistics: Whole,
    body: bytes,
    epoch: int,
    lost: int,
    now_ns: int,
) -> int:
    """Take in the packet whose header was read last and that verified; return its code or FINE.

    `epoch` is that of its keys, `lost` how many of the peer's packets have not come. A message
    that was overtaken still informs about the clocks; one whose body is wrong does not.
    """
    statistics[RECEIVED] += 1
    statistics[LOST] = lost
    kind = link[KIND]
    if kind in (_MOTION, _STATE):
        problem = _body_problem(kind, body)
        if problem != FINE:
            return problem
    echo_problem = take_stamps(link, clock, statistics, now_ns)
    problem = _order(link, kind, epoch)
    if problem == FINE and kind != _TAKEN:
        problem = _date(link, clock, statistics, now_ns)
    return problem | echo_problem << ECHO_SHIFT


@kernel
def take_stamps(link: Whole, clock: Whole, statistics: Whole, now_ns: int) -> int:
    """Learn from a packet's stamps; return a problem where its echo cannot be, or FINE."""
    stamp_ns = link[STAMP]
    if stamp_ns > link[PEER_STAMP]:
        link[PEER_STAMP], link[PEER_STAMP_TAKEN] = stamp_ns, now_ns
    if link[_ECHO] == 0:
        return FINE
    received_ns = stamp_ns - link[_HELD]
    round_trip_ns = match_round_trip(clock, link[_ECHO], received_ns, stamp_ns, now_ns)
    if round_trip_ns < 0:
        return _ECHO_PROBLEM
    note_round_trip(statistics, round_trip_ns)
    return FINE


@kernel
def _order(link: Whole, kind: int, epoch: int) -> int:
    """Refuse a message older than the newest of its kind."""
    at = _NEWEST + 2 * kind
    newest, sequence = link[at], link[SEQUENCE]
    if epoch < newest or (epoch == newest and sequence <= link[at + 1]):
        return _LATE
    link[at], link[at + 1] = epoch, sequence
    return FINE


@kernel
def _date(link: Whole, clock: Whole, statistics: Whole, now_ns: int) -> int:
    """Refuse a message that is too old, or that cannot be dated; the rest is news."""
    age_ns = age_of(clock, link[STAMP], now_ns)
    link[IS_STALE] = age_ns == UNDATED or age_ns > link[_STALE_AFTER]
    if link[IS_STALE]:
        return _STALE
    note_transit(statistics, clock[TRANSIT])
    link[ARRIVED], link[NEWS] = now_ns, max(link[NEWS], now_ns - age_ns)
    return FINE
