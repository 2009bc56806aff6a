"""The trace of a run: its signals and estimates over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_rt.estimation.rows import RowSpec

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]
Codes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Trace:
    """States kept of a run, `period_s` apart: see `cycle.run_ticks` for shapes and columns.

    `values` has of each row the parameters that were kept of it, each (kept,), in rig units.
    """

    signals: Matrix
    values: tuple[dict[str, Vector], ...]
    status: Codes
    period_s: float
    rows: tuple[RowSpec, ...]

    def names(self, row: int) -> list[str]:
        """Return the names of the parameters that the trace has of a row."""
        return list(self.values[row])

    def physical(self, row: int, name: str) -> Vector:
        """Return a parameter of a row over time (kept,), in the rig's unit."""
        return self.values[row][name]
