"""One estimator of 3 parameters against the libraries that offer one."""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.estimation.bank import Bank, SolverSettings
from teleop_rt_dev.bench.measure import Row, interleave, ratios, row, seconds
from teleop_rt_dev.estimation.regressions import rich

Array = NDArray[np.float64]
SAMPLES, CALLS = 20_000, 2_000
PRIOR, FORGETTING = 1e6, 0.999


def data() -> tuple[Array, Array]:
    """Return phi (samples, 3) and y (samples,) of a mass-spring-damper, scaled to near one."""
    _, x, v, a = rich(SAMPLES / 1000)
    phi = np.column_stack([a, x, v])
    phi /= np.sqrt(np.mean(phi**2, axis=0))
    return phi, phi @ [1.0, 18.0, 2.0] + 0.05 * np.random.default_rng(0).normal(size=len(x))


def weighted_least_squares(phi: Array, y: Array) -> Array:
    """Return exact exponentially weighted least squares with the prior P0 = PRIOR I."""
    n = len(y)
    weight = FORGETTING ** np.arange(n - 1, -1, -1)
    prior = FORGETTING**n / PRIOR * np.eye(phi.shape[1])
    stacked = np.vstack([phi * np.sqrt(weight)[:, None], np.sqrt(prior)])
    target = np.concatenate([y * np.sqrt(weight), np.zeros(phi.shape[1])])
    solution: Array = np.linalg.lstsq(stacked, target, rcond=None)[0]
    return solution


def padasip_call(phi: Array, y: Array) -> Callable[[], object]:
    import padasip  # noqa: PLC0415 - a peer, perhaps not installed

    peer = padasip.filters.FilterRLS(3, mu=FORGETTING, eps=1 / PRIOR, w="zeros")
    return lambda: [peer.adapt(y[i], phi[i]) for i in range(CALLS)]


def padasip_run(phi: Array, y: Array) -> Callable[[], object]:
    import padasip  # noqa: PLC0415 - as above

    peer = padasip.filters.FilterRLS(3, mu=FORGETTING, eps=1 / PRIOR, w="zeros")
    return lambda: peer.run(y, phi)


def filterpy_call(phi: Array, y: Array) -> Callable[[], object]:
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415 - as above

    peer = KalmanFilter(dim_x=3, dim_z=1)
    peer.P *= PRIOR
    peer.alpha = FORGETTING**-0.5
    peer.Q[:] = 0.0

    def work() -> None:
        for i in range(CALLS):
            peer.predict()
            peer.update(y[i], H=phi[i : i + 1])

    return work


def river_call(phi: Array, y: Array) -> Callable[[], object]:
    from river.linear_model import BayesianLinearRegression  # noqa: PLC0415 - as above

    peer = BayesianLinearRegression(alpha=1 / PRIOR, beta=1.0, smoothing=FORGETTING)
    named = [dict(enumerate(one)) for one in phi[:CALLS].tolist()]
    return lambda: [peer.learn_one(one, y[i]) for i, one in enumerate(named)]


def statsmodels_run(phi: Array, y: Array) -> Callable[[], object]:
    from statsmodels.api import RecursiveLS  # noqa: PLC0415 - as above

    return lambda: RecursiveLS(y, phi).fit()


def _each(work: Callable[[], None], samples: int) -> float:
    """Return the time [s] that a sample takes."""
    return seconds(work) / samples


PEERS: dict[str, list[tuple[Any, int, int, str | None]]] = {
    "padasip": [(padasip_call, CALLS, 0, ">= 10"), (padasip_run, SAMPLES, 1, ">= 60")],
    "filterpy": [(filterpy_call, CALLS, 0, None)],
    "river": [(river_call, CALLS, 0, None)],
    "statsmodels": [(statsmodels_run, SAMPLES, 1, None)],
}
"""For each library: the maker of its work, its samples, our side of HOW, and the bar."""
HOW = ("per call", "over a recording")


def run(rounds: int) -> list[Row]:
    phi, y = data()
    bank = Bank(["rls"], [3], SolverSettings(forgetting=FORGETTING, prior=PRIOR))
    wide, tall = phi[:, None, :].copy(), y[:, None].copy()
    bank.run(wide, tall)
    exact = weighted_least_squares(phi, y)
    deviation = float(np.max(np.abs(bank.theta[0, :3] - exact) / np.abs(exact)))
    pieces = [(wide[i], tall[i]) for i in range(CALLS)]

    def call() -> None:
        for p, target in pieces:
            bank.step(p, target)

    sides: list[Callable[[], float]] = [
        lambda: seconds(call) / CALLS,
        lambda: seconds(lambda: bank.run(wide, tall)) / SAMPLES,
    ]
    found, absent = [], []
    for name, kinds in PEERS.items():
        if importlib.util.find_spec(name) is None:
            absent.append(row(f"{name}: not installed", "-", []))
            continue
        for make, samples, against, bar in kinds:
            sides.append(partial(_each, make(phi, y), samples))
            found.append((name, against, bar))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        times = interleave(rounds, sides)
    exactly = row("deviation from exact weighted LS", "relative", [deviation], "<= 1e-8")
    return [*rows_of(times, found), exactly, *absent]


def rows_of(times: list[list[float]], found: list[tuple[str, int, str | None]]) -> list[Row]:
    """Return the rows of our bank, and of each peer with its ratio to ours.

    times: the seconds of each round, ours in both ways and then the peers'.
    """
    rows = [
        row(f"bank, one row, {HOW[i]}", "us/sample", [1e6 * t[i] for t in times]) for i in range(2)
    ]
    for k, (name, against, bar) in enumerate(found):
        rows.append(row(f"{name}, {HOW[against]}", "us/sample", [1e6 * t[k + 2] for t in times]))
        rows.append(
            row(f"{name} / bank, {HOW[against]}", "ratio", ratios(times, k + 2, against), bar)
        )
    return rows
