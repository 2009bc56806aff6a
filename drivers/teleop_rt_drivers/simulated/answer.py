"""The answers of CANopen devices to the frames of every cycle, as kernels: received, done, sent.

The frames of every cycle are SYNC, the daemon's heartbeat, and a command that differs from the one
before in its target alone. `Answering` says when devices stand so that nothing else happens.
"""

from __future__ import annotations

import errno
import select
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel, shared
from teleop_rt.kernels.record import record_type
from teleop_rt.realtime.system_calls import FOUND_BITS, monotonic_ns, send_bytes, wait_ready
from teleop_rt_drivers.can_door import DESCRIPTOR_BITS, LENGTH_SHIFT, UNUSUAL, take_packets
from teleop_rt_drivers.simulated.line_answer import (
    LONGEST_SILENCE_NS,
    NEVER_NS,
    NOTHING,
    is_late,
    send_due,
)
from teleop_rt_drivers.simulated.motion import POSITION, REFERENCE, VELOCITY, follow
from teleop_rt_drivers.simulated.senses import (
    MOST_ROWS,
    REPORTED_NS,
    clamped,
    in_counts,
    is_drawn,
    mean_servo_force,
    measured_force,
    note,
    run_to,
    signed,
)

if TYPE_CHECKING:
    from teleop_rt_drivers.can_door import Doors, Lengths
    from teleop_rt_drivers.can_frames import Slots
    from teleop_rt_drivers.simulated.line_answer import Lines
    from teleop_rt_drivers.simulated.senses import Hidden, PlantArrays, TrueRows

LONGEST_WAIT_NS = 50_000_000
"""A longer apparent wait of a frame means that the clock was set."""
HEARTBEAT_LATE_NS = 1_000_000
"""So long a heartbeat that is due waits for a frame that ends the wait in any case."""
INT16, INT32 = 2**15 - 1, 2**31 - 1
PER_THOUSAND = 1000.0  # of the rated torque, which CiA 402 counts in
MORE, UNSENT, DRY, STRANGE = 1, 2, 4, 8
"""Bits of events: frames are left, the answer was not taken, random numbers are to be drawn before
the next SYNC, and these frames are Python's: none of them has been done anything with.
"""
PLACES, SPEEDS, FORCES, TORQUES = range(4)
"""Kinds of measured objects: position, speed, force in steps, the drive's in thousandths."""
# Layout of a waiting frame in bytes, then in words.
_ID_BYTES, _LENGTH_AT, _DATA_AT, _STAMP_AT, _WORD = 4, 4, 8, 16, 8
_HEAD, _DATA, _STAMP = range(3)
_BUS, _RING = range(2)
"""Places of the descriptors that are waited for."""
_READABLE = select.POLLIN << DESCRIPTOR_BITS
_TARGET_BITS = 32  # of a target position
_AGAIN = errno.EAGAIN


class CycleFields:
    """Fields of a network's process data while nothing but the frames of every cycle comes.

    A command has `command_bytes`; those of its bits that are in `same_mask` are as in `same`, and
    its target begins at bit `target_at`. The drive follows it if it `follows`, between the counts
    `lowest` and `highest`, over `period_s` and no farther than `reach`. `pending` is a command that
    waits for SYNC, with the bytes `last`; `obeyed` are those of the last that did not. `commands`
    and `syncs` count. A heartbeat came at `heard_ns`, 0 once Python has taken it. An answer holds
    so many `samples` of force. A heartbeat to send lies at the address `beating`, and `unsent` were
    not taken.
    """

    descriptor: int
    sending: int
    beating: int
    unsent: int
    clock: int
    frames: int
    next_frame: int
    sync_id: int
    heartbeat_id: int
    heard_ns: int
    command_id: int
    command_bytes: int
    same_mask: int
    same: int
    target_at: int
    follows: int
    lowest: int
    highest: int
    pending: int
    last: int
    commands: int
    obeyed: int
    syncs: int
    samples: int
    reach: float
    period_s: float
    zero: float
    step: float


class MeasuredFields:
    """Fields of a measured object in an answer: its frame, its bits there, and its quantity.

    `zero` and `step` are those of its counts; a torque's step is the drive's rated force, and a
    force's the reciprocal of its step.
    """

    frame: int
    at: int
    mask: int
    kind: int
    zero: float
    step: float


class BeatFields:
    """Fields of a node's heartbeats: when the next one is due, their period, and the frame."""

    due_ns: int
    period_ns: int
    head: int
    state: int


CYCLE, MEASURED = record_type(CycleFields), record_type(MeasuredFields)
BEAT = record_type(BeatFields)
Records = NDArray[np.record]
Whole = NDArray[np.int64]


class Answer(NamedTuple):
    """A network's arrays: CYCLE (1,), MEASURED (objects,), and its packet of answers.

    `packet` (frames, 3) holds head, bytes and stamp of each frame, `constant` (frames,) those of
    its bytes that are not measured; `clock` (2,) is where the clock is read to. `true` is
    the motion at the last SYNCs. `beats` is BEAT (nodes,), and `beat` (3,) a heartbeat's frame.
    """

    cycle: Records
    measured: Records
    packet: Whole
    constant: Whole
    beats: Records
    beat: Whole
    clock: Whole
    true: TrueRows


@kernel
def number_at(slots: Slots, row: int, place: int, length: int) -> int:
    """Return the number of so many bytes of a frame, the lowest first."""
    number = np.int64(0)
    for byte in range(length):
        number |= np.int64(slots[row, place + byte]) << np.int64(8 * byte)
    return int(number)


@kernel
def is_usual(answer: Answer, slots: Slots, row: int) -> bool:
    """Return whether a frame is one of every cycle."""
    c: Any = answer.cycle[0]
    can_id = number_at(slots, row, 0, _ID_BYTES)
    if can_id in (c.sync_id, c.heartbeat_id):
        return True
    if can_id != c.command_id or slots[row, _LENGTH_AT] != c.command_bytes:
        return False
    return bool(number_at(slots, row, _DATA_AT, _WORD) & c.same_mask == c.same)


@kernel
def take(
    answer: Answer, plant: PlantArrays, hidden: Hidden | None, door: Doors, lengths: Lengths,
    slots: Slots,
) -> int:  # fmt: skip
    """Receive and answer the waiting frames up to the first SYNC; return the events, or UNUSUAL."""
    c: Any = answer.cycle[0]
    d: Any = door[0]
    c.next_frame, c.frames, c.descriptor = 0, 0, d.descriptor  # whoever is there now
    count = take_packets(door, lengths, slots)
    if count == UNUSUAL:
        return UNUSUAL
    c.frames = count
    for row in range(count):
        if not is_usual(answer, slots, row):
            return STRANGE
    return go_on(answer, plant, hidden, slots)


@kernel
def go_on(answer: Answer, plant: PlantArrays, hidden: Hidden | None, slots: Slots) -> int:
    """Carry the next frames out, up to a SYNC; return the events."""
    c: Any = answer.cycle[0]
    here_ns = monotonic_ns(answer.clock, c.clock)
    happened = 0
    while c.next_frame < c.frames:
        row = c.next_frame
        can_id = number_at(slots, row, 0, _ID_BYTES)
        if can_id == c.sync_id and not is_drawn(plant, c.samples):
            return happened | DRY | MORE
        c.next_frame += 1
        age_ns = here_ns - number_at(slots, row, _STAMP_AT, _WORD)
        stamp_ns = here_ns - min(max(0, age_ns), LONGEST_WAIT_NS)
        if can_id == c.heartbeat_id:
            c.heard_ns = stamp_ns
        else:
            run_to(plant, hidden, stamp_ns)
            if can_id == c.sync_id:
                happened |= sync(answer, plant)
                note(answer.true, plant)
                break
            c.last = number_at(slots, row, _DATA_AT, c.command_bytes)
            c.pending = 1
    return happened | MORE if c.next_frame < c.frames else happened


@kernel
def answer_until(
    answer: Answer, plant: PlantArrays, hidden: Hidden | None, door: Doors, lengths: Lengths,
    slots: Slots, polls: Whole, lines: Lines | None, place: int, until_ns: int,
) -> int:  # fmt: skip
    """Answer cycle after cycle until then; return the events as `take` does, 0 at the end.

    Sensors on `lines`, if there are any, send meanwhile, and nodes their heartbeats.

    Until 0 it is `take`. It returns before its time where another of the `polls`, which lie at
    `place`, is ready than the first, which is the bus's, and the second, the timer of lines; and
    where Python has something to do.
    """
    c: Any = answer.cycle[0]
    d: Any = door[0]
    c.descriptor = d.descriptor
    if until_ns == 0:
        send_heartbeats(answer, monotonic_ns(answer.clock, c.clock))
        return take(answer, plant, hidden, door, lengths, slots)
    polls[_BUS] = d.descriptor | _READABLE  # of the program that is there now
    happened, true = 0, answer.true
    silent_ns = monotonic_ns(answer.clock, c.clock) + LONGEST_SILENCE_NS
    while happened == 0 and true.new[0] < MOST_ROWS:
        now_ns = monotonic_ns(answer.clock, c.clock)
        end_ns, beat_ns = min(until_ns, silent_ns), send_heartbeats(answer, now_ns)
        if now_ns >= end_ns:
            break
        end_ns = min(end_ns, beat_ns + HEARTBEAT_LATE_NS)
        wait_ns = 0 if lines is not None and is_late(lines, now_ns) else end_ns - now_ns
        found = wait_ready(place, polls.size, answer.clock, c.clock, wait_ns)
        asked = found > 0 and polls[_BUS] >> FOUND_BITS != 0
        rings = found > 0 and lines is not None and polls[_RING] >> FOUND_BITS != 0
        if found != asked + rings:
            break
        if asked:
            happened = take(answer, plant, hidden, door, lengths, slots)
            if c.frames == 0:  # no frame: somebody comes or goes
                break
            while happened == MORE and true.new[0] < MOST_ROWS:
                happened = go_on(answer, plant, hidden, slots)
            silent_ns = monotonic_ns(answer.clock, c.clock) + LONGEST_SILENCE_NS
        if not is_due(answer, plant, hidden, lines) and not asked:
            break
    return happened


@kernel
def send_heartbeats(answer: Answer, now_ns: int) -> int:
    """Send the heartbeats that are due; return when the next one is."""
    c: Any = answer.cycle[0]
    beat = answer.beat
    next_ns = NEVER_NS
    for node in range(answer.beats.size):
        b: Any = answer.beats[node]
        if b.due_ns <= now_ns:
            late = now_ns - b.due_ns > b.period_ns
            b.due_ns = (now_ns if late else b.due_ns) + b.period_ns
            beat[_HEAD], beat[_DATA], beat[_STAMP] = b.head, b.state, now_ns
            c.unsent += send_bytes(c.descriptor, c.beating, beat.size * _WORD) == -_AGAIN
        next_ns = min(next_ns, b.due_ns)
    return next_ns


@kernel
def is_due(
    answer: Answer, plant: PlantArrays, hidden: Hidden | None, lines: Lines | None
) -> bool:  # fmt: skip
    """Send the measurements that are due on lines; return whether there was one."""
    c: Any = answer.cycle[0]
    true = answer.true
    if lines is None or true.new[0] == MOST_ROWS:
        return False
    now_ns = monotonic_ns(answer.clock, c.clock)
    if send_due(lines, plant, hidden, now_ns) == NOTHING:
        return False
    note(true, plant)
    return True


@kernel
def sync(answer: Answer, plant: PlantArrays) -> int:
    """Act on the waiting command, and send the present measurements; return UNSENT or 0."""
    c: Any = answer.cycle[0]
    c.syncs += 1
    if c.pending:
        c.pending, c.commands, c.obeyed = 0, c.commands + 1, c.last
        if c.follows:
            counts = signed(c.last >> c.target_at, _TARGET_BITS)
            here = plant.state[REFERENCE]
            goal = goal_of(counts, here, c.lowest, c.highest, c.reach, c.zero, c.step)
            follow(plant.state, goal, c.period_s)
    packet = answer.packet
    now_ns = monotonic_ns(answer.clock, c.clock)
    for frame in range(packet.shape[0]):
        packet[frame, _DATA], packet[frame, _STAMP] = answer.constant[frame], now_ns
    for index in range(answer.measured.size):
        m: Any = answer.measured[index]
        value = np.int64(measured(m.kind, m.zero, m.step, plant)) & np.int64(m.mask)
        packet[m.frame, _DATA] |= value << np.int64(m.at)
    failed = send_bytes(c.descriptor, c.sending, packet.size * _WORD)
    return UNSENT if failed == -_AGAIN else 0  # of who has left nothing more is heard


@kernel
def measured(kind: int, zero: float, step: float, plant: PlantArrays) -> int:
    """Return the present value of an object."""
    if kind == PLACES:
        return clamped(in_counts(plant.state[POSITION], zero, step), INT32)
    if kind == SPEEDS:
        return clamped(plant.state[VELOCITY] / step, INT16)
    if kind == FORCES:
        return clamped(measured_force(plant) * step, INT32)
    return thousandths(mean_servo_force(plant, REPORTED_NS), step)


@shared
def thousandths(force: float, rated: float) -> int:
    """Return a force in thousandths of the rated one."""
    return clamped(PER_THOUSAND * force / rated, INT16)


@shared
def goal_of(
    counts: int, here: float, lowest: int, highest: int, reach: float, zero: float, step: float
) -> float:
    """Return where a drive runs to within a period, for a target in counts."""
    goal = zero + max(lowest, min(highest, counts)) * step
    return max(here - reach, min(here + reach, goal))


def head_of(can_id: int, length: int) -> int:
    """Return the first word of a frame in a packet."""
    return can_id | length << LENGTH_SHIFT
