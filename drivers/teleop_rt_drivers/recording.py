"""An axis that plays a measured file: the motion is the recording's, commands are not executed."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from teleop_rt.axis import AxisError, AxisFault, EndOfRecording, Sample
from teleop_rt.config.rig import AxisConfig, RigConfig
from teleop_rt.config.section import AnySize, Quantity
from teleop_rt.config.supervision import UnsafeWord
from teleop_rt_drivers.bounded_file import refuse_huge

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Vector = NDArray[np.float64]

RATE_TOLERANCE = 1e-3
"""Relative deviation of a recording's mean period from the rig's that is accepted."""
LONGEST_GAP_PERIODS = 1.5
"""A longer step between two stamps is a missing sample."""


class RecordingAxisConfig(AxisConfig):
    """A CSV file with a header line, and role of a column.

    A scale is rig units per unit of the column, with the sign that makes penetration and
    pressing positive; an offset is in rig units.
    """

    driver: Literal["recording"] = Field(
        description=(
            "A measured file in the place of devices; commands are computed and recorded, not "
            "executed."
        )
    )
    file: str = Field(
        min_length=1,
        description="CSV file with a header line; ${VARIABLE} of the environment is filled in.",
    )
    time_column: str = Field("t_s", description="Header of the column with time.")
    time_scale_s: float = Field(
        1.0, gt=0, le=1e6, description="Seconds per unit of the time column: 1e-3 for milliseconds."
    )
    position_column: str = Field(description="Header of the column with position.")
    position_scale: AnySize = Field(
        1.0,
        description=(
            "Rig units of position per unit of the column, with the sign that makes penetration "
            "positive."
        ),
    )
    position_offset: Annotated[float, Quantity("{x}")] = Field(
        0.0, description="Position added after scaling."
    )
    force_column: str = Field(description="Header of the column with force.")
    force_scale: AnySize = Field(
        1.0,
        description=(
            "Rig units of force per unit of the column, with the sign that makes pressing positive."
        ),
    )
    force_offset: Annotated[float, Quantity("{f}")] = Field(
        0.0, description="Force added after scaling."
    )

    @property
    def executes(self) -> bool:
        """False: a recording executes no commands."""
        return False

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return no safeguard that is missing: nothing moves."""
        return {}


class RecordingAxis:
    """Plays one sample per cycle, stamped on the file's own time from the first cycle on."""

    def __init__(
        self, config: RecordingAxisConfig, rig: RigConfig, now_ns: Callable[[], int]
    ) -> None:
        self._config = config
        self._period_s = 1.0 / rig.rate_hz
        self._now_ns = now_ns
        self._stamps_ns = np.zeros(0, dtype=np.int64)
        self._position = self._force = np.zeros(0)
        self._next = 0
        self._start_ns = 0
        self.counters: dict[str, int] = {"samples_played": 0, "commands_ignored": 0}

    def __len__(self) -> int:
        """Return the number of samples; 0 before `configure`."""
        return len(self._position)

    def configure(self) -> None:
        """Read and check the file. Raises AxisError that names its problem."""
        config = self._config
        columns = columns_of(config)
        path = recording_path(config.file, columns)
        time, position, force = read_columns(path, columns)
        time_s = config.time_scale_s * time
        check_time(path, time_s, self._period_s)
        self._stamps_ns = np.rint(1e9 * (time_s - time_s[0])).astype(np.int64)
        self._position = config.position_scale * position + config.position_offset
        self._force = config.force_scale * force + config.force_offset
        self._next = 0

    def arm(self) -> None:
        """Do nothing: there is no drive."""

    def read_into(self, sample: Sample) -> None:
        """Play the next sample; raises EndOfRecording after the last."""
        index = self._next
        if index == 0:
            self._start_ns = self._now_ns()
        if index >= len(self._position):
            raise EndOfRecording(f"all {index} samples of {self._config.file} were played")
        self._next += 1
        self.counters["samples_played"] += 1
        stamp_ns = self._start_ns + int(self._stamps_ns[index])
        sample.stamp_ns = sample.position_stamp_ns = sample.force_stamp_ns = stamp_ns
        sample.device_stamp_ns = int(self._stamps_ns[index])
        sample.position = float(self._position[index])
        sample.force = float(self._force[index])
        sample.valid = sample.enabled = True
        sample.missing = sample.rejected = 0
        sample.fault = AxisFault.NONE

    def write(self, position: float) -> None:  # noqa: ARG002 - the motion is the recording's
        """Count the command and ignore it."""
        self.counters["commands_ignored"] += 1

    def stop(self) -> None:
        """Do nothing: nothing moves."""

    def close(self) -> None:
        """Do nothing: the file was read by `configure`."""


def columns_of(config: RecordingAxisConfig) -> tuple[str, str, str]:
    """Return the columns of time, position and force."""
    return config.time_column, config.position_column, config.force_column


def recording_path(file: str, columns: tuple[str, ...]) -> Path:
    """Return the path with ${VARIABLES} filled in; raises AxisError naming one that is unset.

    It states which file with which columns is expected, and where its source is named.
    """
    wanted = f"a table with the columns {', '.join(columns)} in its first line"
    if "${TELEOP_RT_DATA}" in file:
        wanted += "; docs/measured.md names its source"
    for name in re.findall(r"\$\{(\w+)\}", file):
        if name not in os.environ:
            raise AxisError(
                f"recording {file}: the environment variable {name} is not set; set it to the"
                f" folder that holds {file.rpartition('}')[2].lstrip('/')}, {wanted}"
            )
        file = file.replace(f"${{{name}}}", os.environ[name])
    path = Path(file)
    if not path.is_file():
        raise AxisError(f"recording {path}: no such file; check `file`: it names {wanted}")
    refuse_huge(path, f"recording {path}")
    return path


def read_columns(path: Path, names: tuple[str, ...]) -> list[Vector]:
    """Return columns of a CSV file by name; raises AxisError naming file and column or line."""
    try:
        with path.open(encoding="utf-8") as file:
            header = [name.strip() for name in file.readline().split(",")]
            for name in names:
                if name not in header:
                    raise AxisError(
                        f"recording {path}: no column {name!r}; it has: {', '.join(header)}"
                    )
            wanted = [header.index(name) for name in names]
            table = np.loadtxt(file, delimiter=",", usecols=wanted, ndmin=2)
    except (ValueError, UnicodeDecodeError) as error:
        raise AxisError(
            f"recording {path}: not a table of numbers: {error}: correct it, or name another file"
        ) from error
    if len(table) < 2:
        raise AxisError(f"recording {path}: it has fewer than two samples: give a longer one")
    bad = ~np.isfinite(table)
    if bad.any():
        row, column = (int(places[0]) for places in np.nonzero(bad))
        raise AxisError(
            f"recording {path}: line {row + 2}, column {names[column]!r}: not a number"
            ": correct it, or remove the line"
        )
    return [np.ascontiguousarray(column) for column in table.T]


def check_time(path: Path, time_s: Vector, period_s: float) -> None:
    """Refuse time that does not increase, has gaps, or runs at another rate than the rig."""
    steps = np.diff(time_s)
    if (steps <= 0).any():
        line = int(np.argmax(steps <= 0)) + 3
        raise AxisError(
            f"recording {path}: line {line}: time does not increase"
            ": remove the line, or cut the file there"
        )
    mean = float(time_s[-1] - time_s[0]) / len(steps)
    if abs(mean / period_s - 1.0) > RATE_TOLERANCE:
        raise AxisError(
            f"recording {path}: it was sampled at {1 / mean:.6g} Hz, the rig's rate is "
            f"{1 / period_s:.6g} Hz: set rate_hz to the file's"
        )
    if steps.max() > LONGEST_GAP_PERIODS * period_s:
        line = int(np.argmax(steps)) + 3
        raise AxisError(
            f"recording {path}: line {line}: a gap of {1e3 * steps.max():.4g} ms"
            ": cut the file there"
        )
