"""Samples of a recording that can be used, or its refusal with the reason and the next step."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.section import LEAST, MOST
from teleop_rt.contact.effect import Vector
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.rows import lone
from teleop_rt.recordings.units import factor_of

MIN_SAMPLES = 300  # fewer cannot separate noise and effect
WITHOUT_TIMES = "--columns position=NAME force=NAME --rate HZ"
"""By which a column of times is not read: options name all columns that are."""
_PERIOD_ROUNDING = 1.05  # a period of 0.1 s may be stamped as 0.10002 s
_SHORTEST_S = 0.2  # s: ten of the windows of 20 ms in which velocities are found
_DAY_S = 86400.0
_JOINED = 50  # samples behind the latest time for each step backwards: more are no disorder
_MARKED, _MARK_RANGES = 3, 20.0
"""Samples that share a mark for missing values, and its distance in ranges of all others: what
moves or presses is in between, also where a converter cuts it off."""
_JUMP, _MOVES = 10.0, 10.0
"""A jump is so many of the largest step elsewhere, and each side of it moves so many of these."""
_MOST_GRID_SHARE, _MOST_GRID = 10, 1_000_000
"""An even grid has at most so many points for each sample, and so many more: gaps are few."""


def refuse_other_lengths(name: str, columns: Mapping[str, Vector]) -> None:
    """Raise RecordingError where columns differ in length."""
    if len({column.size for column in columns.values()}) > 1:
        sizes = ", ".join(f"{role} {column.size}" for role, column in columns.items())
        raise RecordingError(
            f"{name}: columns of different length: {sizes}; export all from one table"
        )


def usable(name: str, time: Vector, position: Vector, force: Vector) -> NDArray[np.bool_]:
    """Return which samples can be used; raises RecordingError if they are too few."""
    refuse_other_lengths(name, {"time": time, "position": position, "force": force})
    if time.size < MIN_SAMPLES:
        raise RecordingError(
            f"{name}: too short: {time.size} samples, at least {MIN_SAMPLES} are needed"
        )
    sense = {"time": _of_sense(time), "position": _of_sense(position), "force": _of_sense(force)}
    good = sense["time"] & sense["position"] & sense["force"]
    if np.count_nonzero(good) < max(MIN_SAMPLES, time.size // 2):
        bad = {role: int(np.sum(~here)) for role, here in sense.items() if not here.all()}
        next_step = "check the columns and their units"
        if bad.get("time") == time.size:
            next_step = "export times in seconds, or as 2026-01-31 14:05:09.250"
        raise RecordingError(
            f"{name}: of {time.size} samples {_listed(bad)} are not a number, or beyond"
            f" {MOST:g}: {next_step}"
        )
    good[good] = ~lone(position[good])
    return good


def refuse_mark(name: str, role: str, row: Vector, factor: float) -> None:
    """Raise RecordingError where one value, far beyond all others, marks missing samples.

    `factor` is that from the file's values to the row's: the message has the file's.
    """
    ends = (float(np.fmin.reduce(row, initial=np.inf)), float(np.fmax.reduce(row, initial=-np.inf)))
    mark = max(ends, key=abs)
    marked = row == mark
    count = int(np.count_nonzero(marked))
    if count < _MARKED or 2 * count > row.size or not abs(mark) <= MOST:
        return
    rest = row[~marked & _of_sense(row)]
    if rest.size == 0 or np.ptp(rest) <= LEAST:
        return
    largest = float(np.max(np.abs(rest)))
    times = float(f"{abs(mark) / largest:.2g}")
    if abs(mark) - largest > _MARK_RANGES * np.ptp(rest):
        raise RecordingError(
            f"{name}: the {role} is exactly {mark / factor:.6g} in {count} of {row.size} samples,"
            f" {times:g} times the largest of the rest: if it marks missing values, remove"
            " these cells: empty ones count as missing"
        )


def refuse_jump(name: str, unit: str, time: Vector, position: Vector) -> None:
    """Raise RecordingError where the position leaps once between two motions, as no tool can.

    Single bad counts return, so they leap twice; a tool that is moved by one step rests before it;
    and the way that is gone while samples are missing is no leap.
    """
    known = _of_sense(time) & _of_sense(position)
    t, x = time[known], position[known]
    if x.size < MIN_SAMPLES or np.any(np.diff(t) <= 0.0):  # which are refused for themselves
        return
    steps = np.abs(np.diff(x))
    place = int(np.argmax(steps))
    jump = float(steps[place])
    steps[place] = 0.0
    largest = float(np.max(steps))
    if largest <= 0.0 or jump < _JUMP * largest:
        return
    gap = t[place + 1] - t[place] > 1.5 * np.median(np.diff(t))
    if gap or min(np.ptp(x[: place + 1]), np.ptp(x[place + 1 :])) < _MOVES * largest:
        return
    raise RecordingError(
        f"{name}: the position jumps by {jump:.3g} {unit} at t = {t[place + 1]:.6g} s (sample"
        f" {place + 2}), {jump / largest:.0f} times its largest step elsewhere, as where two"
        " recordings are in one file: cut it there"
    )


def _listed(counts: Mapping[str, int]) -> str:
    """Return how many samples of which columns: 4 of position and 12 of force."""
    *first, last = (f"{count} of {role}" for role, count in counts.items())
    return f"{', '.join(first)} and {last}" if first else last


def _of_sense(row: Vector) -> NDArray[np.bool_]:
    """Return which values are numbers, and such as a machine has: squares of others overflow."""
    return np.asarray(np.abs(row) <= MOST, dtype=np.bool_)


def _backwards(t: Vector, place: int) -> str:
    """Return the cause and the next step where times run backwards after a place.

    Rows in disorder go back often, or soon catch up; a second recording begins once.
    """
    backwards = np.count_nonzero(np.diff(t) < 0.0)
    behind = np.count_nonzero(t[place + 1 :] < t[place])
    if behind <= _JOINED * backwards:
        return "sort the rows by time"
    if 0.5 * _DAY_S < t[place] - t[place + 1] <= _DAY_S:
        return f"a clock past midnight? Add {_DAY_S:g} s to the later times, or stamp with the date"
    return "two recordings in one file? Save each in a file of its own"


def period_of(name: str, t: Vector, slowest_hz: float) -> float:
    """Return the median period [s]; raises RecordingError if the times are no recording's."""
    steps = np.diff(t)
    if np.any(steps <= 0.0):
        back = steps < 0.0
        place = int(np.argmax(back if back.any() else steps == 0.0))
        repeated = np.count_nonzero(steps == 0.0)
        next_step = _backwards(t, place)
        if not back.any():
            next_step = (
                f"{repeated} of {t.size} times are the same as those before: export finer times,"
                " or only rows with new ones; or, if the rows are evenly spaced, leave out the"
                f" times: {WITHOUT_TIMES}"
            )
        raise RecordingError(
            f"{name}: time does not increase at sample {place + 1}: {t[place]:.6g} s is followed"
            f" by {t[place + 1]:.6g} s; {next_step}"
        )
    dt = float(np.median(steps))
    if not (t[-1] - t[0]) / dt <= _MOST_GRID_SHARE * t.size + _MOST_GRID:
        place = int(np.argmax(steps))
        raise RecordingError(
            f"{name}: time jumps by {steps[place]:.3g} s after sample {place + 1}, and samples are"
            f" {dt:.3g} s apart: cut the recording there"
        )
    if dt > _PERIOD_ROUNDING / slowest_hz:
        fitting = (unit for unit in ("ms", "us") if factor_of("time", unit) * dt < 1.0 / slowest_hz)
        unit = next(fitting, "ns")
        raise RecordingError(
            f"{name}: wrong unit? samples are {dt:.3g} s apart, too far to see a contact; if time"
            f" is in {unit}, say so with --units time={unit}"
        )
    if t[-1] - t[0] < _SHORTEST_S:
        raise RecordingError(
            f"{name}: wrong unit? the recording lasts {t[-1] - t[0]:.3g} s, at least"
            f" {_SHORTEST_S:g} s are needed; if time is in s, say so with --units time=s"
        )
    return dt


def refuse_nothing_to_learn(name: str, position: Vector, force: Vector, unit: str) -> None:
    """Raise RecordingError where nothing presses, or nothing moves; `unit` is the force's."""
    if np.ptp(force) <= LEAST:
        raise RecordingError(
            f"{name}: the force is constant ({force[0]:.6g} {unit}): check sensor and column"
        )
    if np.ptp(position) <= LEAST:
        raise RecordingError(
            f"{name}: no excitation: the position never changes: record a motion that presses"
        )
