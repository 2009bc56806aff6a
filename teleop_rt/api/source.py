"""Recordings from files and from arrays, checked before anything is computed from them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.samples.implausible import refuse_wrong_units
from teleop_rt.diagnosis.samples.surface import refuse_turned
from teleop_rt.errors import RecordingError
from teleop_rt.offline.load import load_any
from teleop_rt.offline.table import Table
from teleop_rt.recordings import recording as checked
from teleop_rt.recordings.recording import Recording
from teleop_rt.trial.folder import recording_of

File = str | PathLike[str]
Source = Recording | str | PathLike[str]
"""A recording, or the file or run folder that holds one."""
Roles = Mapping[str, str] | None
Row = ArrayLike
Units = tuple[str, str]
Surface = float | None
UNITS = (("m", "N"), ("rad", "Nm"))
_IN_PYTHON = {
    "read": "in Python these options are the arguments columns, units and rate_hz",
    "from_arrays": "from_arrays takes arrays as these options make them: in s, m, N and that sign",
}
"""The hint for a Python caller where a message names an option, by function."""


def read(
    file: File, *, columns: Roles = None, units: Roles = None, rate_hz: float | None = None
) -> Recording:
    """Return the recording in an MCAP, CSV, MAT or NPZ file, or in the folder of a run.

    `columns` and `units` give column and unit of each role (`time`, `position`, `force`, `surface`,
    `reference`), where the column's name does not; `rate_hz` stands in for a column of
    time. Raises ExpectedError where the file cannot be used.
    """
    with _options_named("read"):
        return load_any(
            recording_of(Path(file)), Table(dict(columns or {}), dict(units or {}), rate_hz)
        )


def from_arrays(
    time_s: Row,
    position: Row,
    force: Row,
    units: Units = ("m", "N"),
    surface: Surface = None,
) -> Recording:
    """Return the recording of three arrays of one length.

    `units` are ("m", "N") or ("rad", "Nm"); a position grows into the environment, a force is
    positive where the tool presses. `surface` is the position of the surface, None where it has to
    be found. Samples that are not a number count as missing. Raises RecordingError for a wrong
    shape, for time that does not increase, and where too little is left.

    >>> import teleop_rt
    >>> teleop_rt.from_arrays([0.0, 0.1], [0.0, 0.1], [1.0, 2.0])
    Traceback (most recent call last):
        ...
    teleop_rt.errors.RecordingError: arrays: too short: 2 samples, at least 300 are needed
    """
    if tuple(units) not in UNITS:
        raise RecordingError(
            f"arrays: units {tuple(units)!r}: give ('m', 'N') or ('rad', 'Nm'), and the arrays in"
            " these units"
        )
    rows = [_row(*pair) for pair in (("time_s", time_s), ("position", position), ("force", force))]
    with _options_named("from_arrays"):
        found = checked.from_arrays("arrays", *rows, units=(units[0], units[1]), surface=surface)
        refuse_wrong_units(found, None)
        refuse_turned(found)
        return found


@contextmanager
def _options_named(function: str) -> Iterator[None]:
    """Add the hint for a Python caller to an error that names an option of the command line."""
    try:
        yield
    except RecordingError as error:
        if re.search(r"--(columns|units|surface|rate)\b", str(error)) is None:
            raise
        raise RecordingError(f"{error}; {_IN_PYTHON[function]}") from None


def _row(name: str, values: Row) -> Vector:
    """Return an array as numbers (samples,). Raises RecordingError."""
    try:
        row = np.asarray(values)
        numbers = np.array(row.real, dtype=np.float64)
    except (TypeError, ValueError):
        raise RecordingError(
            f"arrays: {name}: not an array of numbers: give one number per sample"
        ) from None
    if np.iscomplexobj(row):
        raise RecordingError(f"arrays: {name}: complex numbers: give real ones")
    if numbers.ndim != 1:
        raise RecordingError(
            f"arrays: {name}: has the shape {row.shape}: give one value per sample, (samples,)"
        )
    return numbers


def opened(source: Source) -> Recording:
    """Return the recording of a source."""
    return source if isinstance(source, Recording) else read(source)
