"""Recordings from files: position and force over time, checked, evenly spaced, gaps counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.clock import jitter_of, ticks_of
from teleop_rt.recordings.column_names import NEEDED
from teleop_rt.recordings.layout import Column, Layout, columns_of, layout_of
from teleop_rt.recordings.resampling import GAP, SampleTimes, covered, resampled
from teleop_rt.recordings.rows import Stretch, quantisation_step, stretches
from teleop_rt.recordings.table_files import read_table
from teleop_rt.recordings.usable import (
    WITHOUT_TIMES,
    period_of,
    refuse_jump,
    refuse_mark,
    refuse_nothing_to_learn,
    refuse_other_lengths,
    usable,
)

_SLOWEST_HZ = 10.0  # Hz; below it no contact of a hand or a rig is resolved
_SLOWEST_STATED_HZ = 2.0  # Hz; a testing machine's, where the unit of time is stated
_ROUNDING = 1e-3  # periods; a lag of whole periods leads to a sample, not past it
_SHORT_GAP = 3  # samples that a cubic bridges better than a line, at the usual windows


@dataclass(frozen=True)
class Recording:
    """Position and force, evenly spaced; `mask` is 0 where samples were missing.

    Units are the rig's, `m` and `N` or `rad` and `Nm`; x > 0 points into the environment, f > 0
    presses on it. `surface` is the recording's own statement, None where it has none; `jitter`
    is how far samples were taken from where they lie now, as a share of their period;
    `units_stated` where the file or the user says the units of position and force; `force_step` is
    the step in which the force was read before it was resampled, 0 where none is seen; `start_s` is
    when a part of a longer recording begins in it; the force's lag was taken out up to an error of
    `force_lag_deviation_s`, and the surface is known up to one of `surface_deviation`; `run` is the
    file of a run, whose rig knows the signs, else empty; `columns` are the names of position and
    force in their table, with a minus where the sign was turned.
    """

    name: str
    dt: float
    position: Vector
    force: Vector
    mask: Vector
    units: tuple[str, str] = ("m", "N")
    surface: float | None = None
    reference: Vector | None = None
    gaps: int = 0
    missing: int = 0
    jitter: float = 0.0
    units_stated: bool = False
    force_step: float = 0.0
    start_s: float = 0.0
    force_lag_deviation_s: float = 0.0
    surface_deviation: float = 0.0
    run: str = ""
    columns: tuple[str, str] = ("NAME", "NAME")

    @property
    def seconds(self) -> float:
        """Length."""
        return self.dt * self.position.size

    @property
    def time_s(self) -> Vector:
        """Time of each sample, the first at 0."""
        return self.dt * np.arange(self.position.size, dtype=np.float64)

    def __repr__(self) -> str:
        lost = f", {self.missing} missing" if self.missing else ""
        return (
            f"<Recording {self.name}: {self.seconds:.4g} s, {self.position.size} samples"
            f" at {1.0 / self.dt:.4g} Hz{lost}, in {self.units[0]} and {self.units[1]}>"
        )


def load(path: Path, layout: Layout | None = None) -> Recording:
    """Return the recording in a CSV, MAT or NPZ file.

    Raises RecordingError with one clear message if the file cannot be used.
    """
    layout = layout or layout_of(path)
    table = read_table(path)
    found = columns_of(path, table, layout)
    position, force = found["position"], found["force"]
    stated = "time" not in found or found["time"].stated
    if "time" in found:
        if layout.rate_hz is not None:
            raise RecordingError(
                f"{path}: has a column with times: leave out --rate, or rate_hz in"
                f" {path.stem}.columns.yaml; or leave out the times: {WITHOUT_TIMES}"
            )
        time = found["time"].values - found["time"].values[:1]
    else:  # else `columns_of` has refused it
        assert layout.rate_hz is not None  # noqa: S101
        time = np.arange(position.values.size) / layout.rate_hz
    reference = found.get("reference")
    columns = {"time": time, "position": position.values, "force": force.values}
    columns |= {} if reference is None else {"reference": reference.values}
    refuse_other_lengths(path.name, columns)
    fresh = _fresh(path, table, layout, time)
    columns = {role: column[fresh] for role, column in columns.items()}
    for role in ("position", "force"):
        refuse_mark(path.name, role, columns[role], found[role].factor)
    units = ("rad", "Nm") if position.rotary else ("m", "N")
    refuse_jump(path.name, units[0], columns["time"], columns["position"])
    columns["force"] = without_lag(columns["time"], columns["force"], layout.force_lag_s)
    made = from_columns(
        path.name,
        columns,
        units=units,
        surface=_surface(found, layout),
        slowest_hz=_SLOWEST_STATED_HZ if stated else _SLOWEST_HZ,
    )
    return replace(
        made,
        units_stated=position.stated and force.stated,
        columns=(position.name, force.name),
        force_lag_deviation_s=layout.force_lag_deviation_s,
        surface_deviation=layout.surface_deviation * abs(found["position"].factor),
    )


def _surface(found: Mapping[str, Column], layout: Layout) -> float | None:
    """Return the surface [rig's unit] that the layout states or a column shows last, if any."""
    if layout.surface is not None:
        return layout.surface * found["position"].factor
    return last_known(found["surface"].values) if "surface" in found else None


def _fresh(
    path: Path, table: Mapping[str, Vector], layout: Layout, time: Vector
) -> NDArray[np.bool_]:
    """Return which rows contain a new sample: all, without a column that states it."""
    if layout.valid is None:
        return np.ones(time.size, dtype=np.bool_)
    if layout.valid not in table or table[layout.valid].size != time.size:
        raise RecordingError(
            f"{path}: no column {layout.valid!r} of its length, which {path.stem}.columns.yaml"
            f" names as valid; there are: {', '.join(table)}"
        )
    return np.asarray((table[layout.valid] > 0.0) & (np.diff(time, prepend=-1.0) > 0.0))


def without_lag(time: Vector, force: Vector, lag_s: float) -> Vector:
    """Return the force (n,) as it was at the times [s], where it is known to come late.

    Not a number where it would have come in a gap that a line does not bridge.
    """
    if not lag_s:
        return force
    found = np.interp(time + lag_s, time, force)
    steps = np.diff(time)
    period = np.median(steps)
    for before in np.flatnonzero(steps > (_SHORT_GAP + GAP) * period):
        at_ends = time[before : before + 2] - lag_s + _ROUNDING * period
        first, past = np.searchsorted(time, at_ends)
        found[first : min(past, before + 1)] = np.nan
    return found


def last_known(surface: Vector) -> float | None:
    """Return the last surface that was known, None where there was none."""
    known = surface[np.isfinite(surface)]
    return float(known[-1]) if known.size else None


def from_arrays(
    name: str,
    time: Vector,
    position: Vector,
    force: Vector,
    *,
    units: tuple[str, str] = ("m", "N"),
    surface: float | None = None,
    reference: Vector | None = None,
    slowest_hz: float = _SLOWEST_HZ,
) -> Recording:
    """Return a recording of arrays [s, rig's units] of one length, resampled where needed.

    Samples that come slower than `slowest_hz` are taken for times in a wrong unit.
    Raises RecordingError where nothing can be found out from them.
    """
    columns = {"time": time, "position": position, "force": force}
    columns |= {} if reference is None else {"reference": reference}
    return from_columns(name, columns, units=units, surface=surface, slowest_hz=slowest_hz)


def from_columns(
    name: str,
    columns: dict[str, Vector],
    *,
    units: tuple[str, str] = ("m", "N"),
    surface: float | None = None,
    slowest_hz: float = _SLOWEST_HZ,
) -> Recording:
    """Return the same of columns by their role, which are taken out: an hour's would be held twice.

    Raises RecordingError where nothing can be found out from them.
    """
    good = usable(name, *(columns[role] for role in NEEDED))
    if not good.all():  # else no copies
        columns |= {role: column[good] for role, column in columns.items()}
    dt = period_of(name, columns["time"], slowest_hz)
    refuse_nothing_to_learn(name, columns["position"], columns["force"], units[1])
    t, dt = ticks_of(columns.pop("time"), dt, columns["position"])
    grid = SampleTimes(float(t[0]), dt, round(float(t[-1] - t[0]) / dt) + 1)
    mask = covered(grid, t)
    if float(np.mean(mask)) < 0.5:
        raise RecordingError(
            f"{name}: gaps make up more than half of the recording; record again, or keep only a"
            " part without them"
        )
    gaps = stretches(mask == 0.0)
    jitter, force_step = jitter_of(t, dt), quantisation_step(columns["force"])
    even = {role: resampled(grid, t, columns.pop(role)) for role in tuple(columns)}
    _bend(even["position"], mask)
    _read_in_steps(even["position"], mask)
    return Recording(
        name,
        dt,
        even["position"],
        even["force"],
        mask,
        units,
        surface,
        even.get("reference"),
        gaps=len(gaps),
        missing=sum(past - first for first, past in gaps),
        jitter=jitter,
        force_step=force_step,
    )


def refuse_other_units(test: Recording, recording: Recording) -> None:
    """Raise RecordingError if one is in lengths and forces, the other in angles and torques."""
    if test.units != recording.units:
        raise RecordingError(
            f"{recording.name}: in {' and '.join(recording.units)}, but {test.name}, on which its"
            f" error is to be computed, in {' and '.join(test.units)}: give the units with --units"
        )


def _bend(position: Vector, mask: Vector) -> None:
    """Bridge short gaps of the position by a cubic, as movement bends, not by a line."""
    for first, past in short_gaps(mask):
        around = np.array([first - 2, first - 1, past, past + 1])
        cubic = np.polyfit(around - first, position[around], 3)
        position[first:past] = np.polyval(cubic, np.arange(past - first))


def _read_in_steps(position: Vector, mask: Vector) -> None:
    """Round bridged positions to the steps of the readings, if these have any.

    One value between two steps would hide them, and with them the encoder's resolution.
    """
    missing, readings = mask == 0.0, position[mask > 0.0]
    if missing.any() and (step := quantisation_step(readings)):
        first = float(readings[0])
        position[missing] = first + step * np.round((position[missing] - first) / step)


def short_gaps(mask: Vector) -> list[Stretch]:
    """Return the gaps of at most `_SHORT_GAP` samples with two samples at each side."""
    return [
        (first, past)
        for first, past in stretches(mask == 0.0)
        if past - first <= _SHORT_GAP
        and first >= 2
        and past + 2 <= mask.size
        and np.all(mask[[first - 2, first - 1, past, past + 1]] > 0.0)
    ]
