"""Record what every estimator holds, one of them a tick, so that no tick pays for all."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from teleop_rt.estimation.estimates import LEADING, MOST_NAMES
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import OFFSET, RowSpec
from teleop_rt.realtime.ring import RingWriter
from teleop_rt.realtime.ring_kernel import row_writer
from teleop_rt.signals import Signal

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


class EstimateLog:
    """One ring for each estimator, filled in turn."""

    def __init__(self, pipeline: Pipeline, publish: Publish) -> None:
        self._rings: list[RingWriter] = []
        self._writers: list[Callable[[], None]] = []
        self._next = 0
        stored = np.zeros(LEADING + 2 * MOST_NAMES)
        self._write = pipeline.logged(stored)
        for row in pipeline.rows:
            table = estimate_table(row)
            topic = "/estimates/" + "/".join(row.label)
            ring = publish(topic, table)
            self._rings.append(ring)
            self._writers.append(row_writer(ring, stored[: len(table)]))

    def update(self, stamp_ns: int) -> None:
        """Record the next estimator in turn."""
        number = self._next
        self._next = (number + 1) % len(self._rings)
        self._write(number, stamp_ns)
        self._writers[number]()

    def close(self) -> None:
        """Close the rings for their readers."""
        for ring in self._rings:
            ring.close()
