"""A row of a recorded table, written by name: columns come from `signals`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.signals import Signal

StoredRow = NDArray[np.record]


class NamedRow:
    """One row of a table: `stored` as kernels take it, with a field per signal, `values` by column.

    Whoever writes a column finds its place once, by `columns(table)`.
    """

    def __init__(self, table: tuple[Signal, ...]) -> None:
        fields = np.dtype([(signal.name, np.float64) for signal in table])
        kind = np.dtype((np.record, fields))
        self.stored: StoredRow = np.full(len(table), math.nan).view(kind)
        self.values = self.stored.view(np.uint8).data.cast("d")
