"""Record the state of every estimator, one of them a tick, so that no tick pays for all."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.estimation.estimates import write_logged
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import OFFSET, RowSpec
from teleop_rt.kernels.jit import bound, kernel
from teleop_rt.realtime.ring import RingWriter
from teleop_rt.realtime.ring_kernel import put, ring_words
from teleop_rt.signals import Signal

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from teleop_rt.contact.effect import Vector
    from teleop_rt.estimation.estimates import Matrix, StoredPlaces
    from teleop_rt.estimation.state import StateArray

Publish = Callable[[str, Sequence[Signal]], RingWriter]

_LEADING = (
    Signal("stamp_ns", "ns", "slave clock"),
    Signal("status", "count", "0 warming up, 1 estimated, 2 held, 3 restarted"),
    Signal("forgetting_factor", "1", "lambda"),
    Signal("restarts", "count", "restarts so far"),
)


def estimate_table(row: RowSpec) -> tuple[Signal, ...]:
    """Return the signals of one estimator: its state, its parameters, their deviations."""
    parameters = (*row.parameters, OFFSET) if row.linear else row.parameters
    values = tuple(Signal(p.name, p.unit, f"estimate of {p.name}") for p in parameters)
    spreads = tuple(
        Signal(f"{p.name}_std", p.unit, f"standard deviation of {p.name}") for p in parameters
    )
    return _LEADING + values + spreads


@kernel
def log(
    one: StateArray,
    places: StoredPlaces,
    room: Matrix,
    row: Vector,
    header: NDArray[np.int64],
    words: Vector,
    number: int,
    stamp_ns: int,
) -> None:
    """Write the present state of the estimator of this number into its ring, by way of a row."""
    write_logged(one, places, room, row, number, stamp_ns)
    put(header, words, row)


class EstimateLog:
    """One ring for each estimator; `turns` gives in turn, without end, functions that fill them.

    That takes the present time of the slave's clock [ns].
    """

    def __init__(self, pipeline: Pipeline, publish: Publish) -> None:
        self._rings: list[RingWriter] = []
        writers: list[Callable[[int], None]] = []
        for number, row in enumerate(pipeline.rows):
            table = estimate_table(row)
            topic = "/estimates/" + "/".join(row.label)
            ring = publish(topic, table)
            self._rings.append(ring)
            arrays = *pipeline.logged, np.zeros(len(table)), *ring_words(ring)
            writers.append(partial(bound(log, arrays, 0, 0), number))
        self.turns = itertools.cycle(writers)

    def close(self) -> None:
        """Close the rings for their readers."""
        for ring in self._rings:
            ring.close()
