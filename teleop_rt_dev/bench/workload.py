"""The 18-row workload, and the sides that the bank is compared with."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.estimation.bank import Bank, SolverSettings
from teleop_rt.ids import SOLVERS
from teleop_rt_dev.estimation import oracle
from teleop_rt_dev.estimation.regressions import algebraic, direct, force, rich

Array = NDArray[np.float64]
MODELS = {
    "kelvin-voigt": [18.0, 0.02],
    "mass-spring-damper": [0.001, 18.0, 0.02],
    "hunt-crossley": [18.0, 0.02, 1.5],
}
SETTINGS = SolverSettings()
NOISE = 0.03  # N, or relative for Hunt-Crossley, as that of a load cell


def rows() -> list[tuple[str, str, str]]:
    """Return {Kelvin-Voigt, mass-spring-damper, Hunt-Crossley} x {five direct, algebraic RLS}."""
    kinds = [("direct", solver) for solver in SOLVERS] + [("algebraic", "rls")]
    return [(model, regression, solver) for model in MODELS for regression, solver in kinds]


def regressions(samples: int) -> tuple[Array, Array]:
    """Return phi (samples, 18, 3), scaled to near one, and y (samples, 18)."""
    t, x, v, a = rich(samples / 1000 + 1)
    noise = NOISE * np.random.default_rng(3).normal(size=len(t))
    phi, y = np.zeros((samples, 18, 3)), np.zeros((samples, 18))
    for r, (model, regression, _) in enumerate(rows()):
        f = force(model, MODELS[model], x, v, a)
        f = f * np.exp(noise) if model == "hunt-crossley" else f + noise
        if regression == "direct":
            columns, target = direct(model, x, v, a, f)
        else:
            columns, target = algebraic(model, t, x, f)
        columns = columns[1000:] / np.sqrt(np.mean(columns[1000:] ** 2, axis=0))
        phi[:, r, : columns.shape[1]] = columns[:samples]
        y[:, r] = target[1000 : 1000 + samples]
    return phi, y


def sizes() -> list[int]:
    return [len(MODELS[model]) for model, _, _ in rows()]


def bank() -> Bank:
    """Return the bank under test."""
    return Bank([solver for _, _, solver in rows()], sizes(), SETTINGS)


def oracles() -> list[Any]:
    """Return the tests' plain-Python solvers for the same rows."""
    one = SETTINGS
    make: dict[str, Callable[[int], Any]] = {
        "rls": lambda n: oracle.Rls(n, one.prior),
        "sprls": lambda n: oracle.Sprls(n, one.beta, one.gamma, one.prior),
        "ni-sprls": lambda n: oracle.NiSprls(
            n, one.beta, one.gamma_noise_immunised, one.noise_variance, one.rho, one.prior
        ),
        "gn-vff-rls": lambda n: oracle.GnVffRls(
            n, one.alpha, one.lambda_min, one.lambda_max, one.delta_start, 1e-12, one.prior
        ),
        "iec": oracle.Iec,
    }
    return [make[solver](n) for (_, _, solver), n in zip(rows(), sizes(), strict=True)]


class NumpyRow:
    """One estimator as an object over small numpy arrays, the way such code is usually written."""

    def __init__(self, solver: str, n: int) -> None:
        self.solver, self.eye = solver, np.eye(n)
        self.theta, self.P = np.zeros(n), SETTINGS.prior * np.eye(n)
        self.M, self.psi = np.zeros((n, n)), np.zeros(n)
        self.R, self.r = np.zeros((n, n)), np.zeros(n)
        self.forgetting: Any = 1.0
        self.delta: Any = 1.0
        self.power: Any = 0.0

    def step(self, phi: Array, y: float) -> None:
        one = SETTINGS
        if self.solver == "iec":
            self.R += np.outer(phi, phi)
            self.r += phi * y
            try:
                self.theta = np.asarray(np.linalg.solve(self.R, self.r))
            except np.linalg.LinAlgError:
                self.theta[:] = 0.0
            return
        e = y - phi @ self.theta
        if self.solver == "gn-vff-rls":
            g = self.psi @ phi
            self.delta = max((1 - one.alpha) * self.delta + one.alpha * g * g, 1e-12)
            step = self.forgetting + one.alpha * g * e / self.delta
            self.forgetting = min(max(step, one.lambda_min), one.lambda_max)
        u = self.P @ phi
        L = u / (self.forgetting + phi @ u)
        self.theta = self.theta + L * e
        self.P = (self.P - np.outer(L, u)) / self.forgetting
        if self.solver == "sprls":
            self.P += one.beta * np.rint(one.gamma * e * e) * self.eye
        elif self.solver == "ni-sprls":
            self.power = one.rho * self.power + (1 - one.rho) * e * e
            excess = abs(self.power / one.noise_variance - 1)
            self.P += one.beta * np.rint(one.gamma_noise_immunised * excess) * self.eye
        elif self.solver == "gn-vff-rls":
            left = self.eye - np.outer(L, phi)
            self.M = (left @ self.M @ left.T + np.outer(L, L) - self.P) / self.forgetting
            self.psi = left @ self.psi + self.M @ phi * e


def numpy_rows() -> list[NumpyRow]:
    return [NumpyRow(solver, n) for (_, _, solver), n in zip(rows(), sizes(), strict=True)]
