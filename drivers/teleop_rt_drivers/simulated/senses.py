"""Values of a plant's sensors, and the plant's run to a time at which they are asked.

Everything is a kernel on the plant's arrays: a device's whole answer is one step of them
(`cycle.py`), and where Python asks for one value it comes from here, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from teleop_rt.kernels.jit import kernel, shared
from teleop_rt_drivers.simulated.hidden_motion import advance_hidden
from teleop_rt_drivers.simulated.motion import (
    DECELERATION,
    FORCE,
    IMPULSE,
    POSITION,
    REFERENCE,
    VELOCITY,
    advance,
    force_at,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from teleop_rt_drivers.simulated.hidden_motion import Matrix
    from teleop_rt_drivers.simulated.motion import Stamps, Vector

NOW, START, HEAD, MODE, NOTED, NEXT_DRAW, DRAWN = range(7)
"""Whole numbers of a plant: its time and its start [ns], the newest place of its history, the state
of its drive, how many impulses it has noted, and the next of the pairs of numbers that are drawn.
"""
NUMBERS = DRAWN + 1
LAG_MS, JITTER_US, OFFSET, DRIFT, NOISE, HUNG = range(6)
"""Constants of a force sensor; HUNG is the force of a weight that hangs at it."""
SENSOR_CONSTANTS = HUNG + 1
DRAWS = 128
"""Pairs of random numbers that are drawn at once: a sample takes one, for jitter and noise."""
REPORTED_NS = 1_000_000
"""Over so long an industrial drive averages the torque that it reports."""
LONGEST_ANSWERING_NS = 100_000_000
"""So long at most a kernel answers before Python looks whether it is to end, and the true motion
goes into its ring: Python takes as long as several answers each time."""
MOST_ROWS = 256
"""Rows of true motion that are kept: those of LONGEST_ANSWERING_NS at 2 kHz, and more."""
IMPULSES = 256
"""Times kept of the drive's impulse: more than 20 ms of the smallest steps of a bus."""


class PlantArrays(NamedTuple):
    """The arrays of a plant.

    `impulses` and `impulse_ns` (IMPULSES,) are a ring of the drive's impulse and its times,
    `draws` (DRAWS, 2) uniform and normal random numbers.
    """

    state: Vector
    constants: Vector
    numbers: NDArray[np.int64]
    stamps: Stamps
    forces: Vector
    impulse_ns: Stamps
    impulses: Vector
    sensor: Vector
    draws: Matrix


class TrueRows(NamedTuple):
    """Rows of `signals.TRUTH` (MOST_ROWS, columns), of which `new` (1,) were not taken yet."""

    rows: Matrix
    new: NDArray[np.int64]


class Hidden(NamedTuple):
    """Further arrays of a plant whose trial hides effects in it."""

    memories: Vector
    constants: Vector
    scratch: Matrix


@kernel
def run_to(plant: PlantArrays, hidden: Hidden | None, to_ns: int) -> None:
    """Integrate up to `to_ns`; nothing happens when that is not in the future."""
    if plant.numbers[NOTED] == 0:
        note_impulse(plant)
    # By an end a millisecond before, the mean over the last one is exact.
    for end_ns in (to_ns - REPORTED_NS, to_ns):
        if end_ns > plant.numbers[NOW]:
            integrate(plant, hidden, end_ns - plant.numbers[NOW])
            plant.numbers[NOW] = end_ns
            note_impulse(plant)


@kernel
def note_impulse(plant: PlantArrays) -> None:
    """Note the drive's impulse as of now."""
    place = plant.numbers[NOTED] % IMPULSES
    plant.impulse_ns[place] = plant.numbers[NOW]
    plant.impulses[place] = plant.state[IMPULSE]
    plant.numbers[NOTED] += 1


@kernel
def integrate(plant: PlantArrays, hidden: Hidden | None, span_ns: int) -> None:
    """Integrate over `span_ns`, with hidden effects where there are any."""
    numbers, constants = plant.numbers, plant.constants
    mode, deceleration = numbers[MODE], constants[DECELERATION]
    if hidden is None:
        numbers[HEAD] = advance(
            plant.state, constants, plant.stamps, plant.forces,
            mode, deceleration, numbers[HEAD], numbers[NOW], span_ns,
        )  # fmt: skip
    else:
        numbers[HEAD] = advance_hidden(
            plant.state, hidden.memories, constants, hidden.constants, mode, deceleration,
            plant.stamps, plant.forces, numbers[HEAD], numbers[NOW], span_ns,
            numbers[NOW] - numbers[START], hidden.scratch,
        )  # fmt: skip


@kernel
def mean_servo_force(plant: PlantArrays, span_ns: int) -> float:
    """Return the drive's mean force over this time, however often the plant was asked."""
    noted = plant.numbers[NOTED]
    if noted == 0:
        return 0.0
    place = (noted - 1) % IMPULSES
    newest_ns, newest = plant.impulse_ns[place], plant.impulses[place]
    begin_ns, later_ns, later = newest_ns - span_ns, newest_ns, newest
    for back in range(1, min(noted, IMPULSES) + 1):
        place = (noted - back) % IMPULSES
        earlier_ns, earlier = plant.impulse_ns[place], plant.impulses[place]
        if earlier_ns <= begin_ns:
            share = (begin_ns - earlier_ns) / max(1, later_ns - earlier_ns)
            return float((newest - earlier - share * (later - earlier)) / (span_ns * 1e-9))
        later_ns, later = earlier_ns, earlier
    return float((newest - later) / max(1e-9, (newest_ns - later_ns) * 1e-9))


@kernel
def measured_force(plant: PlantArrays) -> float:
    """Return the force sensor's present reading: the force of some time ago, and noise.

    It takes one of the pairs that are drawn; of outliers it knows nothing.
    """
    numbers, sensor = plant.numbers, plant.sensor
    draw = numbers[NEXT_DRAW]
    numbers[NEXT_DRAW] += 1
    # As `uniform(-1.0, 1.0)` draws it, which takes three times as long.
    jitter_us = (-1.0 + 2.0 * plant.draws[draw, 0]) * sensor[JITTER_US]
    lag_ns = max(0, round(1e6 * sensor[LAG_MS] + 1e3 * jitter_us))
    lagged = force_at(plant.stamps, plant.forces, numbers[HEAD], numbers[NOW] - lag_ns)
    age_s = (numbers[NOW] - numbers[START]) * 1e-9
    lagged += sensor[OFFSET] + sensor[DRIFT] * age_s + sensor[HUNG]
    return float(lagged + sensor[NOISE] * plant.draws[draw, 1])


@kernel
def note(true: TrueRows, plant: PlantArrays) -> None:
    """Note the plant's true motion, by the columns of `signals.TRUTH`."""
    row = true.rows[true.new[0]]
    row[0], row[1], row[2] = plant.numbers[NOW], plant.state[POSITION], plant.state[VELOCITY]
    row[3], row[4], row[5] = plant.state[FORCE], plant.state[REFERENCE], plant.numbers[MODE]
    true.new[0] += 1


@shared
def is_drawn(plant: PlantArrays, samples: int) -> bool:
    """Return whether the random numbers of so many samples are there."""
    return bool(plant.numbers[DRAWN] - plant.numbers[NEXT_DRAW] >= samples)


@shared
def in_counts(value: float, zero: float, step: float) -> float:
    """Return a value as a device counts it in its steps, not rounded."""
    return (value - zero) / step


@shared
def clamped(value: float, limit: int) -> int:
    """Return the nearest whole number within the range of a field."""
    return max(-limit, min(limit, round(value)))


@shared
def signed(number: int, bits: int) -> int:
    """Return the signed number that the lowest bits of another are."""
    low = number & ((1 << bits) - 1)
    return low - (1 << bits) if low >> (bits - 1) else low
