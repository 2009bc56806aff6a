"""The simulations of the report's section 4.1: every method of table 4.1, 0.5 to 10 Hz.

They are run as the report did: regressors in SI units from the exact motion, P(0) = 1e6 I, no
noise, and none of the filters, gates and scalings that run on-line.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.estimation import algebraic as algebraic_method
from teleop_rt.estimation.bank import Bank
from teleop_rt.ids import REGRESSIONS, SOLVERS
from teleop_rt.study.chapter4_plant import RATE_HZ, TRUTH, PenetrationMotion, Sine, plant_force

Matrix = NDArray[np.float64]
Signal = NDArray[np.float64]

FREQUENCIES_HZ = (0.5, 1.0, 3.0, 5.0, 10.0)
"""Of figures 4.2 and 4.3."""
METHODS = tuple(itertools.product(REGRESSIONS, SOLVERS))
REPORTED = {
    "kelvin-voigt": (("direct", "rls"), ("direct", "iec"), ("algebraic", "rls")),
    "hunt-crossley": (
        ("direct", "rls"), ("direct", "sprls"), ("direct", "gn-vff-rls"), ("direct", "iec"),
        ("algebraic", "rls"),
    ),
}  # fmt: skip
"""The methods of table 4.1; the study runs every solver on both regressions."""
SETTLED = 0.02
"""Of the true value: a parameter that stays as near to it has settled."""
_KEPT = 160  # points of a curve on a logarithmic axis of time


def cases(
    frequencies_hz: Sequence[float] = FREQUENCIES_HZ, duration_s: float = 10.0
) -> list[dict[str, Any]]:
    """Return the cases of the simulations; without noise they need no seed."""
    return [
        {"part": "simulation", "model": model, "frequency_hz": f, "duration_s": duration_s}
        for model in TRUTH
        for f in frequencies_hz
    ]


def simulate(case: dict[str, Any]) -> dict[str, Any]:
    """Run all methods of one case; `_result` describes the values of each."""
    model = case["model"]
    motion = Sine(case["frequency_hz"], duration_s=case["duration_s"]).samples()
    measured = plant_force(model, TRUTH[model], motion)
    theta = estimates(model, motion, measured)
    kept = np.unique(np.geomspace(1, motion.t.size, _KEPT).astype(int)) - 1
    return {
        "part": "simulation",
        "model": model,
        "frequency_hz": case["frequency_hz"],
        "t_s": (motion.t[kept] + 1.0 / RATE_HZ).tolist(),
        "methods": [
            {"regression": regression, "solver": solver}
            | _result(model, motion, measured, theta[:, row], kept)
            for row, (regression, solver) in enumerate(METHODS)
        ],
    }


def estimates(model: str, motion: PenetrationMotion, measured: Signal) -> Matrix:
    """Return the physical parameters (samples, methods, n) of every method over time."""
    regressions = {
        "direct": direct(model, motion, measured),
        "algebraic": algebraic(model, motion, measured),
    }
    n = len(TRUTH[model])
    phi = np.stack([regressions[name][0] for name, _ in METHODS], axis=1)
    y = np.stack([regressions[name][1] for name, _ in METHODS], axis=1)
    bank = Bank([solver for _, solver in METHODS], [n] * len(METHODS))
    theta = np.empty((len(y), len(METHODS), n))
    for i in range(len(y)):
        bank.step(phi[i], y[i])
        theta[i] = bank.theta[:, :n]
    if model != "hunt-crossley":
        return theta
    k = np.exp(np.clip(theta[..., 0], -50.0, 50.0))
    return np.stack([k, k * theta[..., 1], theta[..., 2]], axis=-1)


def direct(model: str, motion: PenetrationMotion, measured: Signal) -> tuple[Matrix, Signal]:
    """Return phi (samples, n) and y (samples,) of (2.1), or of (2.6)."""
    if model == "hunt-crossley":
        columns = [np.ones_like(motion.x), motion.v, np.log(motion.x)]
        return np.column_stack(columns), np.log(measured)
    return np.column_stack([motion.x, motion.v]), measured


def algebraic(model: str, motion: PenetrationMotion, measured: Signal) -> tuple[Matrix, Signal]:
    """Return phi (samples, n) and y (samples,) of (3.24), or of (3.31)."""
    logarithmic = model == "hunt-crossley"
    phi = np.zeros((motion.t.size, len(TRUTH[model])))
    y = np.zeros(motion.t.size)
    window = np.zeros(algebraic_method.N_LOG if logarithmic else algebraic_method.N_LINEAR)
    dt = 1.0 / RATE_HZ
    if logarithmic:
        log_x, log_f = np.log(motion.x), np.log(measured)
        algebraic_method.start_log(window, motion.x[0], log_x[0], log_f[0])
        for i in range(1, y.size):
            algebraic_method.advance_log(window, motion.x[i], log_x[i], log_f[i], dt)
            y[i] = algebraic_method.hunt_crossley_regression(window, phi[i])
        return phi, y
    algebraic_method.start_linear(window, motion.x[0], measured[0])
    for i in range(1, y.size):
        algebraic_method.advance_linear(window, motion.x[i], measured[i], dt)
        y[i] = algebraic_method.kelvin_voigt_regression(window, phi[i])
    return phi, y


def _result(
    model: str, motion: PenetrationMotion, measured: Signal, theta: Matrix, kept: NDArray[np.int64]
) -> dict[str, Any]:
    """Return the reported values of one method; theta (samples, n).

    Final values, settling times to 2 % [s] (null where it ends outside), overshoots relative to
    the truth, NRMSE (4.1) of the force that is predicted with the parameters of each moment, and
    with the final ones; and `trace`, the parameters at a few moments.
    """
    truth = TRUTH[model]
    names = list(truth)
    final = dict(zip(names, theta[-1].tolist(), strict=True))
    online = dict(zip(names, theta.T, strict=True))
    errors = {
        "nrmse_online": measured - plant_force(model, online, motion),
        "nrmse": measured - plant_force(model, final, motion),
    }
    return {
        "final": final,
        "settling_s": {n: settling_s(online[n], truth[n]) for n in names},
        "overshoot": {n: float(max(0.0, np.max(online[n]) / truth[n] - 1.0)) for n in names},
        **{
            name: float(np.sqrt(np.mean(error**2)) / np.ptp(measured))
            for name, error in errors.items()
        },
        "trace": {n: [float(f"{value:.6g}") for value in online[n][kept]] for n in names},
    }


def settling_s(values: Signal, truth: float) -> float | None:
    """Return when values (n,) came within 2 % of the truth for good [s]; None if never."""
    outside = np.flatnonzero(~(np.abs(values - truth) <= SETTLED * abs(truth)))
    if outside.size == 0:
        return 0.0
    last = int(outside[-1]) + 1
    return last / RATE_HZ if last < values.size else None
