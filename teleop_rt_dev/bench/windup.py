"""An hour of constant regressor at lambda = 0.995: the bank stays bounded, others do not."""

from __future__ import annotations

import importlib.util
import warnings

import numpy as np

from teleop_rt.estimation.bank import Bank, SolverSettings
from teleop_rt.ids import SOLVERS
from teleop_rt_dev.bench.measure import Row, row
from teleop_rt_dev.estimation import oracle

TICKS, CHUNK = 3_600_000, 40_000
PHI = np.array([1.0, 0.5, 0.2])
TRUTH = np.array([3600.0, 20.0, 5.0])
FORGETTING = 0.995  # the one that the theory states for 1 kHz
WILD = 1e6  # of parameters of order 1000
LONGEST = 60_000  # a minute at 1 kHz


def target(samples: int) -> np.ndarray:
    return np.asarray(PHI @ TRUTH + 0.05 * np.random.default_rng(0).normal(size=samples))


def plain_failure() -> int | None:
    """Return the sample at which the textbook solver's estimate goes wild."""
    plain = oracle.Rls(3, 1e6, FORGETTING)
    for i, y in enumerate(target(LONGEST)):
        plain.step(PHI.tolist(), float(y))
        if not max(abs(value) for value in plain.theta) < WILD:
            return i
    return None


def padasip_failure() -> int | None:
    """Return the sample at which padasip's estimate goes wild."""
    import padasip  # noqa: PLC0415 - a peer, perhaps not installed

    peer = padasip.filters.FilterRLS(3, mu=FORGETTING, eps=1e-6, w="zeros")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for i, y in enumerate(target(LONGEST)):
            peer.adapt(y, PHI)
            if not np.max(np.abs(peer.w)) < WILD:
                return i
    return None


def run(rounds: int) -> list[Row]:
    del rounds  # nothing is timed here
    bank = Bank(SOLVERS, [3] * 5, SolverSettings(forgetting=FORGETTING))
    phi = np.tile(PHI, (CHUNK, 5, 1))
    y = np.repeat(target(CHUNK)[:, None], 5, axis=1)
    largest = np.zeros(5)
    for _ in range(TICKS // CHUNK):
        bank.run(phi, y)
        largest = np.maximum(largest, np.max(np.abs(bank.theta), axis=1))
    finite = float(np.all(np.isfinite(bank.state)))
    rows = [row("every row finite after an hour (1 yes, 0 no)", "-", [finite], ">= 1")]
    rows += [
        row(f"largest |theta| of {solver}", "-", [float(value)], "<= 1e6")
        for solver, value in zip(SOLVERS, largest, strict=True)
    ]
    failed = plain_failure()
    rows.append(row("plain RLS goes wild at", "sample", [] if failed is None else [failed]))
    if importlib.util.find_spec("padasip") is None:
        return [*rows, row("padasip: not installed", "sample", [])]
    failed = padasip_failure()
    return [*rows, row("padasip goes wild at", "sample", [] if failed is None else [failed])]
