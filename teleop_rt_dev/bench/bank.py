"""The bank tick by tick from Python, against plain Python and per-object numpy."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from teleop_rt_dev.bench.measure import Row, interleave, ratios, row, seconds
from teleop_rt_dev.bench.workload import bank, numpy_rows, oracles, regressions, sizes

SAMPLES = 20_000  # 20 s at 1 kHz
# The slow sides take a slice of the samples per round; times are per tick.
ORACLE_SLICE, NUMPY_SLICE = 300, 600
AGREE = 300


def agreement() -> list[float]:
    """Return the largest deviation from the oracle of each row after each of the first samples.

    The first 20 are left out: with a sample per parameter the problem itself is near singular.
    """
    phi, y = regressions(AGREE)
    one, plain, n = bank(), oracles(), sizes()
    worst = np.zeros(len(n))
    for i in range(AGREE):
        one.step(phi[i], y[i])
        for r, reference in enumerate(plain):
            reference.step(phi[i, r, : n[r]].tolist(), float(y[i, r]))
            if i >= 20:
                expected = np.array(reference.theta)
                error = np.abs(one.theta[r, : n[r]] - expected) / np.maximum(1.0, abs(expected))
                worst[r] = max(worst[r], error.max())
    return worst.tolist()


def _each(rows: Sequence[Any], samples: Sequence[Sequence[tuple[Any, float]]]) -> float:
    """Return the time [s] that a tick takes rows of which each is stepped by itself."""

    def work() -> None:
        for sample in samples:
            for reference, (p, target) in zip(rows, sample, strict=True):
                reference.step(p, target)

    return seconds(work) / len(samples)


def run(rounds: int) -> list[Row]:
    phi, y = regressions(SAMPLES)
    one, n = bank(), sizes()
    ticks = [(phi[i], y[i]) for i in range(SAMPLES)]
    lists = [
        [(phi[i, r, : n[r]].tolist(), float(y[i, r])) for r in range(len(n))]
        for i in range(ORACLE_SLICE)
    ]
    arrays = [
        [(phi[i, r, : n[r]].copy(), float(y[i, r])) for r in range(len(n))]
        for i in range(NUMPY_SLICE)
    ]

    def ours() -> None:
        for p, target in ticks:
            one.step(p, target)

    times = interleave(
        rounds,
        [
            lambda: seconds(ours) / SAMPLES,
            partial(_each, oracles(), lists),
            partial(_each, numpy_rows(), arrays),
        ],
    )
    return [
        row("bank, 18 rows, a tick from Python", "us", [1e6 * one_[0] for one_ in times]),
        row("plain Python, a tick", "us", [1e6 * one_[1] for one_ in times]),
        row("per-object numpy, a tick", "us", [1e6 * one_[2] for one_ in times]),
        row("plain Python / bank", "ratio", ratios(times, 1, 0), ">= 10"),
        row("per-object numpy / bank", "ratio", ratios(times, 2, 0), ">= 100"),
        row("largest deviation from plain Python", "relative", [max(agreement())], "<= 1e-8"),
    ]
