"""The answers of CANopen devices to the frames of every cycle, as kernels: received, done, sent.

The frames of every cycle are SYNC, the daemon's heartbeat, and a command that differs from the one
before in its target alone. `Answering` says when devices stand so that nothing else happens, and
`answer_wait` waits for the frames.
"""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel, shared
from teleop_rt.kernels.record import record_type
from teleop_rt.realtime.system_calls import monotonic_ns, send_bytes
from teleop_rt_drivers.can_door import LENGTH_SHIFT, UNUSUAL, take_packets
from teleop_rt_drivers.simulated.motion import POSITION, REFERENCE, VELOCITY, follow
from teleop_rt_drivers.simulated.senses import (
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
    from teleop_rt_drivers.simulated.senses import Hidden, PlantArrays, TrueRows

LONGEST_WAIT_NS = 50_000_000
"""A longer apparent wait of a frame means that the clock was set."""
INT16, INT32 = 2**15 - 1, 2**31 - 1
PER_THOUSAND = 1000.0  # of the rated torque, which CiA 402 counts in
MORE, UNSENT, DRY, STRANGE = 1, 2, 4, 8
"""Bits of events: frames are left, the answer was not taken, random numbers are to be drawn before
the next SYNC, and these frames are Python's: none of them has been done anything with.
"""
PLACES, SPEEDS, FORCES, TORQUES = range(4)
"""Kinds of measured objects: position, speed, force in steps, the drive's in thousandths."""
# Layout of a waiting frame in bytes.
_ID_BYTES, _LENGTH_AT, _DATA_AT, _STAMP_AT = 4, 4, 8, 16
WORD = 8
"""Bytes of a word of a frame, which has three: head, data and stamp."""
HEAD, DATA, STAMP = range(3)
_TARGET_BITS = 32  # of a target position
AGAIN = errno.EAGAIN
"""Number of the error where a program's queue takes no frame."""


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
    return bool(number_at(slots, row, _DATA_AT, WORD) & c.same_mask == c.same)


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
        age_ns = here_ns - number_at(slots, row, _STAMP_AT, WORD)
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
        packet[frame, DATA], packet[frame, STAMP] = answer.constant[frame], now_ns
    for index in range(answer.measured.size):
        m: Any = answer.measured[index]
        value = np.int64(measured(m.kind, m.zero, m.step, plant)) & np.int64(m.mask)
        packet[m.frame, DATA] |= value << np.int64(m.at)
    failed = send_bytes(c.descriptor, c.sending, packet.size * WORD)
    return UNSENT if failed == -AGAIN else 0  # of who has left nothing more is heard


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
