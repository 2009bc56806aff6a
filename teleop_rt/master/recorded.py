"""An operator that plays a recorded motion."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np

from teleop_rt.config.operator import RecordedOperator
from teleop_rt.errors import ExpectedError

_WINDOW = 21
"""Samples and order of the Savitzky-Golay filter that gives the velocity."""
_ORDER = 2  # a parabola: its slope has no lag


class OperatorError(ExpectedError):
    """The operator cannot be opened as configured; the message gives cause, place and next step."""


class Recorded:
    """Plays one column of a CSV file by its time, linearly interpolated, and stays at its end.

    Velocity is the derivative of a parabola through 21 samples (Savitzky and Golay 1964): it
    has no lag, for the recording is known before and after. `folder` is where a relative path
    starts; a path may contain ${TELEOP_RT_DATA}. Raises OperatorError.
    """

    def __init__(self, config: RecordedOperator, folder: Path) -> None:
        path = locate(config.file, folder)
        t_s, column = _read(path, config.time_column, config.position_column)
        if len(t_s) < _WINDOW or not np.all(np.diff(t_s) > 0):
            raise OperatorError(
                f"{path}: {config.time_column} must increase over at least {_WINDOW} samples"
                ": correct time_column or the file"
            )
        self._t_s = t_s - t_s[0]
        self._position = column * config.position_scale
        step_s = float(self._t_s[-1]) / (len(t_s) - 1)
        from scipy.signal import savgol_filter  # noqa: PLC0415 - no other operator needs scipy

        self._velocity = savgol_filter(self._position, _WINDOW, _ORDER, deriv=1, delta=step_s)
        self.duration_s = float(self._t_s[-1])

    def reset(self) -> None:
        """Go back to the start: nothing to do, time alone decides."""

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:  # noqa: ARG002 - a recording feels nothing
        """Return position and velocity at `t_s`."""
        position = float(np.interp(t_s, self._t_s, self._position))
        if t_s >= self.duration_s:
            return position, 0.0
        return position, float(np.interp(t_s, self._t_s, self._velocity))


def locate(file: str, folder: Path) -> Path:
    """Return the path of an operator's recording. Raises OperatorError if it is not there."""
    expanded = os.path.expandvars(file)
    if "$" in expanded:
        raise OperatorError(
            f"operator.file: {file} names an environment variable that is not set: "
            "set TELEOP_RT_DATA to the folder of the measured data"
        )
    path = folder / expanded
    if not path.is_file():
        raise OperatorError(
            f"{path}: cannot read the recording: no such file"
            "; check operator.file and the folder that it names"
        )
    return path


def _read(path: Path, *names: str) -> list[np.ndarray]:
    """Return the named columns of a CSV file with a header line."""
    try:
        with path.open(newline="") as file:
            header = next(csv.reader(file), [])
            missing = [name for name in names if name not in header]
            if missing:
                raise OperatorError(
                    f"{path}: no column {missing[0]!r}; it has: {', '.join(header)}"
                )
            usecols = [header.index(name) for name in names]
            table = np.loadtxt(file, delimiter=",", usecols=usecols, ndmin=2)
    except OSError as error:
        raise OperatorError(
            f"{path}: cannot read the recording: {error.strerror}: let this user read it"
        ) from error
    except (ValueError, csv.Error) as error:
        raise OperatorError(
            f"{path}: not a table of numbers: {error}: correct the file, or name another one"
        ) from error
    if not np.isfinite(table).all():
        raise OperatorError(f"{path}: a value is not finite: remove its line")
    return list(table.T)
