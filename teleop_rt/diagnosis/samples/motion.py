"""From the recorded position to penetration, velocity and acceleration, and their scales."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Scale, Vector
from teleop_rt.kernels.jit import kernel
from teleop_rt.recordings.filters import local_polynomial
from teleop_rt.recordings.rows import quantisation_step, robust_deviation, stretches

SMOOTHING_ORDER = 5  # of the local polynomial: a mass is off by 0.3 %, by 8 % at order 3
MOST_REMEMBERED = 1_000_000  # values (8 MB) of rows kept for the next fit; more saves no time
_STRIDE_OCTAVES = 6  # strides between samples, each twice the last, that are compared
_LONGEST_STRIDE_S = 0.011  # s; over longer strides differences show the motion
_MOTION_GROWTH = 16.0  # of differences per doubled stride; those of motion grow 32 times
_CORRELATED_GROWTH = 4.0  # of the same; correlated noise grows less than that
_ROUNDING = 1e-10  # of the largest derivative; sums over a recording add up to that
_REST_CHANGE_RATIO = 1e-9  # of the position's range; a smaller difference is a rest
_LEAST_NOISE_STEPS = 0.45  # of the step; less noise may be the steps alone (0.28 to 0.37)
_MOST_NOISE_STEPS = 2.0  # of the step; with more, the steps are digits of a number
_REST_SAMPLES = 200  # equal readings in a row that exclude noise before the steps
_BAND = 4.0  # deviations of the position's noise; a tool at rest stays within such a band
_TO_AND_FRO = 3.0  # times the range that noise moves it there; a tool that turns over moves 2 times
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """The input of the model: evenly spaced in time, penetration positive into the environment.

    Arrays have one value per sample, in the rig's units; `dt` in s. Bounds of shape parameters are
    multiples of `scales`. A derivative uses `half` samples on either side. `moves` is 0 at rest,
    where a memory of the way would creep by the noise of the position, and 1 elsewhere; None if the
    tool never rests.
    """

    t: Vector
    x: Vector
    v: Vector
    a: Vector
    dt: float
    scales: Mapping[Scale, float] = field(default_factory=dict)
    half: int = 0
    moves: Vector | None = None
    memory: OrderedDict[Hashable, Vector] = field(
        default_factory=OrderedDict, init=False, repr=False, compare=False
    )
    kept: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def remembered(self, key: Hashable, make: Callable[[], Vector]) -> Vector:
        """Return the result of `make` for this motion, from a cache of the most recent ones.

        A fit needs the same rows many times while it changes one parameter of another term.
        """
        if key in self.memory:
            self.memory.move_to_end(key)
            return self.memory[key]
        found = self.memory[key] = make()
        if len(self.memory) * found.size > MOST_REMEMBERED:
            self.memory.popitem(last=False)
        return found

    def made(self, key: Hashable, make: Callable[[], _T]) -> _T:
        """Return the result of `make` for this motion, computed once and kept with the motion."""
        if key not in self.kept:
            self.kept[key] = make()
        found: _T = self.kept[key]
        return found

    def every(self, number: int) -> RecordedMotion:
        """Return every so many samples, of as many as are a multiple; made once."""

        def make() -> RecordedMotion:
            whole = self.x.size - self.x.size % number
            rows = (self.t, self.x, self.v, self.a)
            t, x, v, a = (np.ascontiguousarray(row[:whole:number]) for row in rows)
            moves = None if self.moves is None else self.moves[:whole:number]
            return RecordedMotion(t, x, v, a, number * self.dt, dict(self.scales), moves=moves)

        return self.made(("every", number), make)


def differentiate(position: Vector, dt: float, half: int) -> tuple[Vector, Vector, Vector]:
    """Return position, velocity and acceleration by a local polynomial of order 5, twiced.

    Of one row of samples, or of several at once, which saves most of the time at the edges.
    Zero-phase (Savitzky and Golay). The polynomial's loss of a tone (0.3 % of the acceleration at
    10 Hz and a window of 41 ms) is measured by smoothing its own result once more, and added again
    (Tukey's twicing): then it is 1e-5.
    """

    def smooth(row: Vector, order: int) -> Vector:
        return local_polynomial(row, half, SMOOTHING_ORDER, order, dt)

    x, v, a = (smooth(position, order) for order in range(3))
    # Integrals exact to the fourth order; their drift is a polynomial that the filter keeps.
    bent = dt**2 / 12.0 * a
    moved = -bent
    moved[..., 1:] += np.cumsum(v[..., 1:] + v[..., :-1], axis=-1) * (0.5 * dt)
    bent[..., 1:] += np.cumsum(np.cumsum(a[..., :-1], axis=-1), axis=-1) * dt**2
    return (
        np.ascontiguousarray(2.0 * x - smooth(x, 0)),
        _still(2.0 * v - smooth(moved, 1)),
        _still(2.0 * a - smooth(bent, 2)),
    )


def _still(derivative: Vector) -> Vector:
    """Return a derivative that is 0 at rest, where only rounding errors are left of it.

    A fit would divide a force by them where a recording only holds.
    """
    largest = np.max(np.abs(derivative), axis=-1, keepdims=True)
    return np.where(np.abs(derivative) > _ROUNDING * largest, derivative, 0.0)


def _moves(x: Vector, v: Vector, dt: float, half: int, noise: float) -> Vector | None:
    """Return 0 where the position moves to and fro within the band of its noise, 1 elsewhere.

    It does so for longer than the window of a derivative: in less, a slow motion may turn over.
    A rest lasts from the first to the last sample within a deviation of its median: within the band
    the tool already moves on, further than a friction may need to slide. None without a rest.
    """
    within = np.zeros(x.size, dtype=np.bool_)
    _find_rests(x, np.abs(v) * dt, _BAND * noise, _TO_AND_FRO, within)
    moves = np.ones(x.size)
    for first, past in stretches(within):
        row = x[first:past]
        near = first + np.flatnonzero(np.abs(row - np.median(row)) <= noise)
        if near.size and near[-1] - near[0] > 2 * half:
            moves[near[0] : near[-1] + 1] = 0.0
    return None if np.all(moves) else moves


@kernel
def _find_rests(x: Vector, way: Vector, band: float, ratio: float, out: NDArray[np.bool_]) -> None:
    first, low, high, moved = 0, x[0], x[0], 0.0
    for i in range(1, x.size + 1):
        here = x[min(i, x.size - 1)]
        if i == x.size or max(high, here) - min(low, here) > band:
            out[first:i] = moved > ratio * (high - low)
            first, low, high, moved = i, here, here, 0.0
        else:
            low, high, moved = min(low, here), max(high, here), moved + way[i]


def motion_of(
    position: Vector, force: Vector, dt: float, surface: float, half: int, *, touches: bool = True
) -> RecordedMotion:
    """Return the motion relative to `surface`, with the scales of this recording.

    The travel is the deepest penetration, and the whole stroke of a body that does not touch: its
    positions count from an arbitrary zero.
    """
    x, v, a = differentiate(position - surface, dt, half)
    t = dt * np.arange(x.size, dtype=np.float64)
    travel = float(np.max(x)) if touches and np.max(x) > 0 else float(np.ptp(x))
    level = float(np.quantile(np.abs(force), 0.999))
    lowest, highest = np.quantile(force, (0.001, 0.999))
    scales: dict[Scale, float] = {
        "": 1.0,
        "travel": travel,
        "speed": float(np.quantile(np.abs(v), 0.99)),
        "duration": float(t[-1]),
        "compliance": travel / level,
        "force": float(np.max(np.abs(force))),
        "place": 0.5 * float(np.min(x) + np.max(x)),
        "middle": 0.5 * float(lowest + highest),
        "range": 0.5 * float(highest - lowest),
    }
    moves = _moves(x, v, dt, half, position_noise(position, dt))
    return RecordedMotion(t, x, v, a, dt, scales, half, moves)


def position_noise(position: Vector, dt: float) -> float:
    """Return the deviation of white noise with the position noise's density in the motion band."""
    deviation, apart = _noise_apart(position, dt)
    return float(max(deviation * np.sqrt(apart), quantisation_step(position) / np.sqrt(12.0)))


def reading_noise(position: Vector, dt: float) -> float:
    """Return the deviation of the noise that an encoder adds before it reads in steps, 0 if none.

    Steps alone appear as white noise of 0.28 of a step, in slow motion of 0.37. With noise of two
    steps or more, the steps are digits of a number, and the noise may be vibration. An encoder
    whose reading stays constant at rest adds no noise, which would change every tenth reading.
    """
    step = quantisation_step(position)
    deviation, _ = _noise_apart(position, dt)
    if _longest_rest(position) >= _REST_SAMPLES:
        return 0.0
    if not _LEAST_NOISE_STEPS * step < deviation < _MOST_NOISE_STEPS * step:
        return 0.0
    return float(np.sqrt(deviation**2 - step**2 / 12.0))


def _longest_rest(position: Vector) -> int:
    """Return the largest number of equal readings in a row."""
    still = stretches(np.diff(position) == 0.0)
    return 1 + max((past - first for first, past in still), default=0)


def resolution_step(position: Vector, dt: float) -> float:
    """Return the encoder's step, or for a filtered position the step with the same noise."""
    return quantisation_step(position) or float(np.sqrt(12.0)) * position_noise(position, dt)


def settling(position: Vector, dt: float) -> int:
    """Return the samples over which the channels' filters spread a jump, 0 without a filter.

    Both channels have equal anti-aliasing filters, so the position noise also shows the force's.
    """
    apart = 1 if quantisation_step(position) > 0.0 else _noise_apart(position, dt)[1]
    return apart if apart > 1 else 0


def _noise_apart(position: Vector, dt: float) -> tuple[float, int]:
    """Return the deviation of the position's noise, and samples from one value to an independent.

    They follow from fifth differences over growing strides. Differences of low-passed noise grow
    until the values are independent and then stay constant; differences of the motion grow with
    the fifth power and end the search. A position with visible steps was not filtered after it was
    read.
    """
    if quantisation_step(position) > 0.0:
        return _fifth_differences(position, 1), 1
    strides = [2**i for i in range(_STRIDE_OCTAVES) if i == 0 or 2**i * dt < _LONGEST_STRIDE_S]
    levels = [_fifth_differences(position, s) for s in (*strides, 2 * strides[-1])]
    deviation = levels[0]
    for near, far in pairwise(levels):
        if far > _MOTION_GROWTH * near:
            break
        if far < _CORRELATED_GROWTH * near:
            deviation = near
    apart = next(s for s, n in zip(strides, levels, strict=False) if n >= 0.5 * deviation)
    return deviation, apart


def _fifth_differences(position: Vector, stride: int) -> float:
    """Return the deviation of white noise with the same fifth differences, without rests."""
    change = position
    for _ in range(5):
        change = change[stride:] - change[:-stride]
    least = _REST_CHANGE_RATIO * float(np.ptp(position))
    moving = change[np.abs(change) > least]
    typical = robust_deviation(moving if moving.size else np.array([least]))
    return typical / float(np.sqrt(252.0))
