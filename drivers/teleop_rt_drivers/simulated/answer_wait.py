"""The wait of CANopen devices for the frames of every cycle, as kernels: each is answered at once.

Meanwhile nodes send their heartbeats, and sensors on lines the frames that are due. `answer` does
the devices' part in each frame.
"""

from __future__ import annotations

import select
from typing import TYPE_CHECKING, Any

from teleop_rt.kernels.jit import kernel
from teleop_rt.realtime.system_calls import FOUND_BITS, monotonic_ns, send_bytes, wait_ready
from teleop_rt_drivers.can_door import DESCRIPTOR_BITS
from teleop_rt_drivers.simulated.answer import AGAIN, DATA, HEAD, MORE, STAMP, WORD, go_on, take
from teleop_rt_drivers.simulated.line_answer import (
    LONGEST_SILENCE_NS,
    NEVER_NS,
    NOTHING,
    is_late,
    send_due,
)
from teleop_rt_drivers.simulated.senses import MOST_ROWS, note

if TYPE_CHECKING:
    from teleop_rt_drivers.can_door import Doors, Lengths
    from teleop_rt_drivers.can_frames import Slots
    from teleop_rt_drivers.simulated.answer import Answer, Whole
    from teleop_rt_drivers.simulated.line_answer import Lines
    from teleop_rt_drivers.simulated.senses import Hidden, PlantArrays

HEARTBEAT_LATE_NS = 1_000_000
"""So long a heartbeat that is due waits for a frame that ends the wait in any case."""
_BUS, _RING = range(2)
"""Places of the descriptors that are waited for."""
_READABLE = select.POLLIN << DESCRIPTOR_BITS


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
            beat[HEAD], beat[DATA], beat[STAMP] = b.head, b.state, now_ns
            c.unsent += send_bytes(c.descriptor, c.beating, beat.size * WORD) == -AGAIN
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
