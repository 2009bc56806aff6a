"""The frames of simulated devices on serial lines, cycle after cycle, as kernels.

Sensors send on a grid of their own, and the drive answers commands that are as the one before but
for their target. `LineAnswering` says when devices stand so that nothing else happens.
"""

from __future__ import annotations

import select
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.record import record_type
from teleop_rt.realtime.system_calls import (
    monotonic_ns,
    read_bytes,
    set_timer,
    wait_event,
    write_bytes,
)
from teleop_rt_drivers.simulated.line_frames import (
    COMMAND_BYTES,
    DRIVE,
    WRENCH,
    crc16_of,
    number_of,
    write_frame,
)
from teleop_rt_drivers.simulated.motion import POSITION, follow
from teleop_rt_drivers.simulated.senses import (
    MOST_ROWS,
    in_counts,
    is_drawn,
    measured_force,
    note,
    run_to,
    signed,
)
from teleop_rt_drivers.simulated.servo import FOLLOW

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.line_frames import Bytes
    from teleop_rt_drivers.simulated.senses import Hidden, PlantArrays, TrueRows

LONGEST_SILENCE_NS = 5_000_000
"""Without a frame for so long Python is asked again, for the plant that runs on, and for a stop."""
NEVER_NS = 2**62
"""A time that does not come [ns]."""
FOR_DRIVE = select.EPOLLRDNORM
"""The event that bytes wait for the drive; all others are EPOLLIN."""
NOTHING, SENT, STRANGE = range(3)
"""Events: of these, STRANGE bytes lie in the memory, and are Python's."""
_COMMAND_FIRST = 0xC3
"""First byte of a command to a position drive."""
_CONTROL_AT, _TARGET_AT, _SUM_AT = 2, 3, 7  # bytes of a command where its fields begin
_TARGET_BYTES, _SUM_BYTES = 4, 2  # lengths of its fields


class SensorFields:
    """Fields of a sensor: its line, its frame's kind, address and length, and its grid.

    `zero` and `step` are those of the edges that a counter board counts.
    """

    descriptor: int
    kind: int
    place: int
    length: int
    due_ns: int
    period_ns: int
    zero: float
    step: float


class DriveFields:
    """Fields of a drive, and of the lines together.

    Commands are read to the address `memory`, `received` bytes last; the answer with the drive's
    `state` lies at `place`. `control` is that of every command, `heard_ns` the last one's time;
    `zero` and `step` are those of its counts, and a target is reached after `period_s`. On all
    lines `lost` frames were not taken, and a round takes so many `samples` of force. A clock
    is read to the address `clock`, and an event to `event`. The descriptor `timer` is readable from
    `ring_ns` on, which is set at the address `ring`.
    """

    descriptor: int
    memory: int
    place: int
    received: int
    control: int
    state: int
    heard_ns: int
    zero: float
    step: float
    period_s: float
    lost: int
    samples: int
    clock: int
    event: int
    timer: int
    ring_ns: int
    ring: int


SENSOR, LINES_DRIVE = record_type(SensorFields), record_type(DriveFields)
Records = NDArray[np.record]
Whole = NDArray[np.int64]
Words = NDArray[np.uint32]


class Lines(NamedTuple):
    """The arrays of lines: SENSOR (n,), LINES_DRIVE (1,), and frames (n + 1, LONGEST).

    The last frame is the drive's answer. `memory` holds commands, `clock` (2,) and `event`
    (EVENT_WORDS,) are written by the system, and `ring` (TIMER_WORDS,) is read by it.
    """

    sensors: Records
    drive: Records
    frames: Bytes
    memory: Bytes
    clock: Whole
    event: Words
    ring: Whole


@kernel
def is_late(lines: Lines, now_ns: int) -> bool:
    """Return whether a sensor is to send now; else its timer is set to when the next one is."""
    drive: Any = lines.drive[0]
    due_ns = NEVER_NS
    for row in range(lines.sensors.size):
        sensor: Any = lines.sensors[row]
        due_ns = min(due_ns, sensor.due_ns)
    if due_ns <= now_ns:
        return True
    if drive.ring_ns != due_ns:
        drive.ring_ns = due_ns
        set_timer(drive.timer, lines.ring, drive.ring, due_ns)
    return False


@kernel
def send(lines: Lines, descriptor: int, place: int, length: int) -> None:
    """Send a frame that lies at an address; one that the line does not take is lost."""
    drive: Any = lines.drive[0]
    if write_bytes(descriptor, place, length) != length:
        drive.lost += 1


@kernel
def send_due(lines: Lines, plant: PlantArrays, hidden: Hidden | None, now_ns: int) -> int:
    """Send the measurements that are due; return SENT where there was one, or NOTHING.

    They wait until the random numbers of a round are drawn.
    """
    drive: Any = lines.drive[0]
    happened = NOTHING
    if not is_drawn(plant, drive.samples):
        return NOTHING
    for row in range(lines.sensors.size):
        sensor: Any = lines.sensors[row]
        if now_ns < sensor.due_ns:
            continue
        run_to(plant, hidden, now_ns)
        late = now_ns - sensor.due_ns > sensor.period_ns
        sensor.due_ns = (now_ns if late else sensor.due_ns) + sensor.period_ns
        if sensor.kind == WRENCH:
            value = measured_force(plant)
        else:
            value = in_counts(plant.state[POSITION], sensor.zero, sensor.step)
        write_frame(lines.frames[row], sensor.kind, value, 0, now_ns)
        send(lines, sensor.descriptor, sensor.place, sensor.length)
        happened = SENT
    return happened


@kernel
def is_usual(lines: Lines, at: int) -> bool:
    """Return whether the command that lies there is one of every cycle."""
    drive: Any = lines.drive[0]
    memory = lines.memory
    if memory[at] != _COMMAND_FIRST or memory[at + _CONTROL_AT] != drive.control:
        return False
    return number_of(memory, at + _SUM_AT, _SUM_BYTES) == crc16_of(memory, at + 1, at + _SUM_AT)


@kernel
def take_commands(lines: Lines, plant: PlantArrays, hidden: Hidden | None, now_ns: int) -> int:
    """Obey and answer the commands that wait: SENT. Return STRANGE for any other bytes.

    Return NOTHING where nothing waits. It is called when bytes have come: even a read that must not
    wait does so on a terminal on which nothing is (`read_delivered`).
    """
    drive: Any = lines.drive[0]
    drive.received = read_bytes(drive.descriptor, drive.memory, len(lines.memory))
    if drive.received <= 0:
        return NOTHING
    if drive.received % COMMAND_BYTES != 0:
        return STRANGE
    for at in range(0, drive.received, COMMAND_BYTES):
        if not is_usual(lines, at):
            return STRANGE
    run_to(plant, hidden, now_ns)
    drive.heard_ns = now_ns
    for at in range(0, drive.received, COMMAND_BYTES):
        if drive.control == FOLLOW:
            target = signed(
                number_of(lines.memory, at + _TARGET_AT, _TARGET_BYTES), 8 * _TARGET_BYTES
            )
            follow(plant.state, drive.zero + target * drive.step, drive.period_s)
        place = in_counts(plant.state[POSITION], drive.zero, drive.step)
        row = lines.sensors.size
        write_frame(lines.frames[row], DRIVE, place, drive.state, now_ns)
        send(lines, drive.descriptor, drive.place, COMMAND_BYTES)
    return SENT


@kernel
def answer_lines(
    lines: Lines, plant: PlantArrays, hidden: Hidden | None, true: TrueRows, epoll: int,
    until_ns: int,
) -> int:  # fmt: skip
    """Send and answer cycle after cycle until then; return NOTHING, or STRANGE at strange bytes.

    It returns before its time where the epoll has an event other than bytes for the drive, and
    where Python has something to do.
    """
    drive: Any = lines.drive[0]
    silent_ns = monotonic_ns(lines.clock, drive.clock) + LONGEST_SILENCE_NS
    while true.new[0] < MOST_ROWS:
        now_ns = monotonic_ns(lines.clock, drive.clock)
        end_ns = min(until_ns, silent_ns)
        if now_ns >= end_ns:
            break
        wait_ns = 0 if is_late(lines, now_ns) else end_ns - now_ns
        found = wait_event(epoll, lines.event, drive.event, lines.clock, drive.clock, wait_ns)
        asked = found & FOR_DRIVE
        now_ns = monotonic_ns(lines.clock, drive.clock)
        if asked:
            happened = take_commands(lines, plant, hidden, now_ns)
            if happened != SENT:
                return happened
            silent_ns = now_ns + LONGEST_SILENCE_NS
        if send_due(lines, plant, hidden, now_ns) == SENT:
            note(true, plant)
        elif not asked:  # the end, a signal, another line, or numbers to draw
            break
    return NOTHING
