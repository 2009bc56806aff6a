"""The end of a tick's row as one kernel: its last values, and the row into its ring."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from teleop_rt.kernels.jit import bound, kernel
from teleop_rt.realtime.ring_kernel import put, ring_words

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from teleop_rt.realtime.ring import RingWriter, Row
    from teleop_rt.realtime.row import NamedRow, StoredRow
    from teleop_rt.slave.sending import StoredSending


@kernel
def record_row(
    header: NDArray[np.int64],
    words: Row,
    row: Row,
    rows: StoredRow,
    sending: StoredSending,
    trouble: int,
    work_us: float,
    wake_us: float,
) -> None:
    """Complete a row with the tick's last values, and write it into its ring.

    `row` (columns,) are the numbers of `rows` (1,); `sending` knows the model last sent.
    """
    named: Any = rows[0]
    named.model_sequence, named.trouble = sending[0].sequence, trouble
    named.work_us, named.wake_latency_us = work_us, wake_us
    put(header, words, row)


def row_recorder(
    ring: RingWriter, row: NamedRow, sending: StoredSending
) -> Callable[[int, float, float], None]:
    """Return the function that completes and writes a row: with trouble, work and wake-up."""
    arrays = *ring_words(ring), row.stored.view(np.float64), row.stored, sending
    return bound(record_row, arrays, 0, 0.0, 0.0)
