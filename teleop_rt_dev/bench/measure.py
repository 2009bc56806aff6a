"""Measurement of a figure: sides interleaved, the median of per-round ratios, with bars."""

from __future__ import annotations

import operator
import os
import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np

Row = dict[str, object]
COMPARE = {">=": operator.ge, "<=": operator.le}


def seconds(work: Callable[[], object]) -> float:
    """Time one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def processor_seconds(work: Callable[[], object]) -> float:
    """Return the processor time of one call: other work on the machine hardly changes it."""
    start = time.process_time()
    work()
    return time.process_time() - start


def take_all_cores() -> None:
    """Let this process and those that it starts run where they like, as a lab's do."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, range(os.cpu_count() or 1))


def interleave(rounds: int, sides: Sequence[Callable[[], float]]) -> list[list[float]]:
    """Call every side once per round, each returning its own time per unit of work."""
    for side in sides:
        side()
    return [[side() for side in sides] for _ in range(rounds)]


def row(name: str, unit: str, values: Sequence[float], bar: str | None = None) -> Row:
    """Make a row of a bench; `bar` is such as '>= 10' and is judged by the median."""
    median = statistics.median(values) if values else None
    holds = None
    if bar is not None and median is not None:
        sign, limit = bar.split()
        holds = bool(COMPARE[sign](median, float(limit)))
    return {
        "name": name,
        "unit": unit,
        "median": median,
        "min": min(values, default=None),
        "max": max(values, default=None),
        "bar": bar,
        "holds": holds,
    }


def quantiles(work_us: Sequence[float]) -> dict[str, float]:
    """Return the figures of a loop: median, 99th and 99.99th percentile, and largest."""
    found = np.quantile(work_us, (0.5, 0.99, 0.9999, 1.0)).tolist()
    return dict(zip(("p50", "p99", "p99.99", "max"), found, strict=True))


def ratios(times: Sequence[Sequence[float]], above: int, below: int) -> list[float]:
    """Return the ratio of two sides in each round."""
    return [one[above] / one[below] for one in times]
