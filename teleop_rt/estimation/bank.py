"""The estimator bank: one preallocated row per estimator, one kernel that advances them all."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import solvers as s
from teleop_rt.estimation.rows import SOLVERS
from teleop_rt.estimation.solvers import (
    covariance_step,
    gradient_step,
    invert,
    perturb,
    propagate_noise,
)
from teleop_rt.jit import kernel

Matrix = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]

WARMING_UP, ESTIMATED, HELD, RESTARTED = range(4)
STATUS_NAMES = ("warming up", "estimated", "held", "restarted")
# Blocks of scores before their spread is believed, and the memory of that spread in blocks.
LEAST_BLOCKS = 16
BLOCK_MEMORY = 0.995
ERROR_MEMORY = 0.995
# A row is ready once every parameter's variance, per unit of noise variance, is below this.
READY_VARIANCE = 1.0


@dataclass(frozen=True, slots=True)
class SolverSettings:
    """Settings of all solvers, for regressors of order one.

    prior P0 = prior I; ceiling bounds trace(P) at ceiling * n * prior; beta, gamma of (3.6, 3.7);
    noise_variance sigma^2 of (3.7) and rho of (3.8); alpha and lambda bounds of (3.9 to 3.11);
    block is the length [samples] of the score sums behind the standard deviations, warm_up the
    samples before a row may be called estimated.
    """

    forgetting: float = 1.0
    prior: float = 1e6
    ceiling: float = 1e3
    beta: float = 1e-4
    gamma: float = 8.0
    gamma_noise_immunised: float = 0.1
    noise_variance: float = 2.5e-3
    rho: float = 0.9
    alpha: float = 0.01
    lambda_min: float = 0.95
    lambda_max: float = 1.0
    delta_start: float = 1.0
    block: int = 64
    warm_up: int = 40

    def row(self, solver: str) -> list[float]:
        """Return the settings of one row in the order of the solver kernels' columns."""
        immunised = solver == "ni-sprls"
        return [
            SOLVERS.index(solver),
            self.forgetting,
            self.prior,
            self.ceiling,
            self.beta,
            self.gamma_noise_immunised if immunised else self.gamma,
            self.noise_variance,
            self.rho,
            self.alpha,
            self.lambda_min,
            self.lambda_max,
            self.delta_start,
            self.block,
            self.warm_up,
        ]


@kernel
def forget_row(state: Vector, settings: Vector, n: int, N: int) -> None:
    """Forget the past of a row, and start over from its present theta."""
    head = s.N_SCALARS
    restarts = state[s.RESTARTS]
    rejected = state[s.REJECTED]
    gradient_restarts = state[s.GRADIENT_RESTARTS]
    for i in range(s.N_SCALARS):
        state[i] = 0.0
    state[s.RESTARTS] = restarts
    state[s.REJECTED] = rejected
    state[s.GRADIENT_RESTARTS] = gradient_restarts
    state[s.LAMBDA] = settings[s.FORGETTING]
    if int(settings[s.SOLVER]) == s.GN_VFF_RLS:
        state[s.LAMBDA] = settings[s.LAMBDA_MAX]
    state[s.DELTA] = settings[s.DELTA_START]
    for i in range(head + N, len(state)):
        state[i] = 0.0
    if int(settings[s.SOLVER]) != s.IEC:
        P = state[head + 8 * N :]
        C = state[head + 8 * N + 2 * N * N :]
        for i in range(n):
            P[i * n + i] = settings[s.PRIOR]
            C[i * n + i] = settings[s.PRIOR]


@kernel
def reset_row(state: Vector, settings: Vector, n: int, N: int) -> None:
    """Forget the past of a row and its theta."""
    for i in range(N):
        state[s.N_SCALARS + i] = 0.0
    forget_row(state, settings, n, N)


@kernel
def solve_integral(
    theta: Vector, r: Vector, R: Vector, inverse: Vector, phi: Vector,
    y: float, forgetting: float, n: int,
) -> bool:  # fmt: skip
    """Advance the integral error criterion (3.14), exponentially forgetting where asked.

    Returns whether the normal matrix could be inverted; theta keeps its value otherwise.
    """
    trace = 0.0
    for i in range(n):
        for j in range(n):
            R[i * n + j] = forgetting * R[i * n + j] + phi[i] * phi[j]
        r[i] = forgetting * r[i] + phi[i] * y
        trace += R[i * n + i]
    if trace > s.LARGEST_INFORMATION:
        for i in range(n * n):
            R[i] *= 0.5
        for i in range(n):
            r[i] *= 0.5
    if not invert(R, inverse, n):
        return False
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += inverse[i * n + j] * r[j]
        theta[i] = total
    return True


@kernel
def score_step(state: Vector, settings: Vector, phi: Vector, e: float, n: int, N: int) -> None:
    """Gather sums of scores phi e over blocks (batch means).

    Their spread against that of white noise tells by how much correlation in time widens the
    standard deviations.
    """
    head = s.N_SCALARS
    score = state[head + 4 * N :]
    info = state[head + 5 * N :]
    score_power = state[head + 6 * N :]
    info_power = state[head + 7 * N :]
    for i in range(n):
        score[i] += phi[i] * e
        info[i] += phi[i] * phi[i]
    state[s.BLOCK_COUNT] += 1.0
    if state[s.BLOCK_COUNT] >= settings[s.BLOCK]:
        for i in range(n):
            score_power[i] = BLOCK_MEMORY * score_power[i] + score[i] * score[i]
            info_power[i] = BLOCK_MEMORY * info_power[i] + info[i]
            score[i] = 0.0
            info[i] = 0.0
        state[s.BLOCK_COUNT] = 0.0
        state[s.BLOCKS] += 1.0


@kernel
def recursive_step(state: Vector, settings: Vector, phi: Vector, y: float, n: int, N: int) -> bool:
    """Advance one recursive row (3.2 to 3.13); return whether it is still healthy."""
    head = s.N_SCALARS
    theta = state[head:]
    L = state[head + 2 * N :]
    scratch = state[head + 3 * N :]
    P = state[head + 8 * N :]
    solver = int(settings[s.SOLVER])
    ceiling = settings[s.CEILING] * settings[s.PRIOR] * n
    e = y
    for i in range(n):
        e -= phi[i] * theta[i]
        total = 0.0
        for j in range(n):
            total += P[i * n + j] * phi[j]
        scratch[i] = total
    state[s.ERROR] = e
    forgetting = state[s.LAMBDA]
    if solver == s.GN_VFF_RLS:
        g = 0.0
        for i in range(n):
            g += state[head + N + i] * phi[i]
        alpha = settings[s.ALPHA]
        state[s.DELTA] = max((1.0 - alpha) * state[s.DELTA] + alpha * g * g, s.DELTA_FLOOR)
        forgetting += alpha * g * e / state[s.DELTA]
        forgetting = min(max(forgetting, settings[s.LAMBDA_MIN]), settings[s.LAMBDA_MAX])
        state[s.LAMBDA] = forgetting
    healthy = covariance_step(P, L, scratch, phi, forgetting, ceiling, n)
    for i in range(n):
        theta[i] += L[i] * e
    if solver == s.SPRLS:
        perturb(P, settings[s.BETA] * np.rint(settings[s.GAMMA] * e * e), ceiling, n)
    elif solver == s.NI_SPRLS:
        rho = settings[s.RHO]
        state[s.MEAN_SQUARE] = rho * state[s.MEAN_SQUARE] + (1.0 - rho) * e * e
        excess = abs(state[s.MEAN_SQUARE] / settings[s.NOISE_VARIANCE] - 1.0)
        perturb(P, settings[s.BETA] * np.rint(settings[s.GAMMA] * excess), ceiling, n)
    elif solver == s.GN_VFF_RLS:
        M = state[head + 8 * N + N * N :]
        psi = state[head + N :]
        if not gradient_step(M, psi, P, L, phi, scratch, e, forgetting, n):
            # M and psi amplify round-off: start them afresh, the estimate itself is sound.
            for i in range(n * n):
                M[i] = 0.0
            for i in range(n):
                psi[i] = 0.0
            state[s.DELTA] = settings[s.DELTA_START]
            state[s.GRADIENT_RESTARTS] += 1.0
    if solver != s.RLS or settings[s.FORGETTING] < 1.0:
        propagate_noise(state[head + 8 * N + 2 * N * N :], L, phi, scratch, n)
    return healthy


@kernel
def row_step(state: Vector, settings: Vector, phi: Vector, y: float, n: int, N: int) -> None:
    """Advance one row by one sample and keep it finite: skip wild input, restart when ill."""
    head = s.N_SCALARS
    sound = abs(y) < s.LARGEST_INPUT
    for i in range(n):
        sound = sound and abs(phi[i]) < s.LARGEST_INPUT
    if not sound:
        state[s.REJECTED] += 1.0
        return
    theta = state[head:]
    if int(settings[s.SOLVER]) == s.IEC:
        e = y
        for i in range(n):
            e -= phi[i] * theta[i]
        state[s.ERROR] = e
        R = state[head + 8 * N :]
        inverse = state[head + 8 * N + N * N :]
        r = state[head + N :]
        C = state[head + 8 * N + 2 * N * N :]
        solved = solve_integral(
            theta, r, R, inverse, phi, y, settings[s.FORGETTING], n
        )  # fmt: skip
        variance = inverse
        healthy = True
        if not solved:
            state[s.READY] = 0.0
            return
        if settings[s.FORGETTING] < 1.0:
            L = state[head + 2 * N :]
            if state[s.COUNT] == 0.0:
                for i in range(n * n):
                    C[i] = inverse[i]
            else:
                for i in range(n):
                    L[i] = 0.0
                    for j in range(n):
                        L[i] += inverse[i * n + j] * phi[j]
                propagate_noise(C, L, phi, state[head + 3 * N :], n)
    else:
        healthy = recursive_step(state, settings, phi, y, n, N)
        variance = state[head + 8 * N :]
    state[s.COUNT] += 1.0
    largest = 0.0
    for i in range(n):
        healthy = healthy and abs(theta[i]) < s.LARGEST_THETA
        largest = max(largest, variance[i * n + i])
    if not healthy:
        state[s.RESTARTS] += 1.0
        reset_row(state, settings, n, N)
        return
    warm = state[s.COUNT] >= settings[s.WARM_UP]
    state[s.READY] = 1.0 if warm and largest < READY_VARIANCE else 0.0
    if warm:
        score_step(state, settings, phi, state[s.ERROR], n, N)


@kernel
def bank_step(
    state: Matrix, settings: Matrix, active: Counts, phi: Matrix, y: Vector, live: Flags
) -> None:
    """Advance every live row of the bank by one sample and set every row's status.

    state (rows, ...), settings (rows, N_SETTINGS), active (rows,) parameters in use,
    phi (rows, N), y (rows,), live (rows,).
    """
    N = phi.shape[1]
    for r in range(len(y)):
        row = state[r]
        if live[r]:
            row_step(row, settings[r], phi[r], y[r], active[r], N)
        if row[s.READY] > 0.0:
            row[s.STATUS] = ESTIMATED if live[r] else HELD
        else:
            row[s.STATUS] = RESTARTED if row[s.RESTARTS] > 0.0 else WARMING_UP


@kernel
def bank_run(
    state: Matrix,
    settings: Matrix,
    active: Counts,
    phi: NDArray[np.float64],
    y: Matrix,
    live: Flags,
) -> None:
    """Advance the bank over a recording: phi (samples, rows, N), y (samples, rows)."""
    for i in range(len(y)):
        bank_step(state, settings, active, phi[i], y[i], live)


@dataclass
class Bank:
    """All estimators at once; the kernel sees only phi and y.

    `solvers` names each row's solver and `sizes` its number of parameters. `theta` (rows, N),
    `lambda_`, `status`, `restarts`, `count` are views of the state: read, do not write.
    """

    solvers: list[str]
    sizes: list[int]
    settings: SolverSettings | list[SolverSettings] = field(default_factory=SolverSettings)

    def __post_init__(self) -> None:
        rows = len(self.solvers)
        N = max(self.sizes)
        each = self.settings if isinstance(self.settings, list) else [self.settings] * rows
        self.columns: Matrix = np.array(
            [one.row(name) for one, name in zip(each, self.solvers, strict=True)], dtype=np.float64
        )
        self.N = N
        self.active: Counts = np.array(self.sizes, dtype=np.int64)
        self.phi: Matrix = np.zeros((rows, N))
        self.y: Vector = np.zeros(rows)
        self.live: Flags = np.ones(rows, dtype=np.bool_)
        head = s.N_SCALARS
        self.state: Matrix = np.zeros((rows, head + 8 * N + 3 * N * N))
        self.theta: Matrix = self.state[:, head : head + N]
        self.lambda_: Vector = self.state[:, s.LAMBDA]
        self.status: Vector = self.state[:, s.STATUS]
        self.restarts: Vector = self.state[:, s.RESTARTS]
        self.count: Vector = self.state[:, s.COUNT]
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.state[:] = 0.0
        for r in range(len(self.y)):
            reset_row(self.state[r], self.columns[r], int(self.active[r]), self.N)

    def step(self, phi: Matrix, y: Vector) -> None:
        """Advance every row by one sample: phi (rows, N), y (rows,)."""
        bank_step(self.state, self.columns, self.active, phi, y, self.live)

    def run(self, phi: NDArray[np.float64], y: Matrix) -> None:
        """Advance every row over a recording: phi (samples, rows, N), y (samples, rows)."""
        bank_run(self.state, self.columns, self.active, phi, y, self.live)

    def _matrix(self, r: int, which: int) -> Matrix:
        n, N = int(self.active[r]), self.N
        start = s.N_SCALARS + 8 * N + which * N * N
        return self.state[r, start : start + n * n].reshape(n, n)

    def covariance(self, r: int) -> Matrix | None:
        """Return the covariance (n, n) of theta of a row, or None while it cannot be told.

        It is the propagated covariance per unit of noise, widened per parameter by the spread of
        block sums of scores, so noise that the filters coloured counts as what it is.
        """
        if self.state[r, s.BLOCKS] < LEAST_BLOCKS or self.state[r, s.READY] == 0.0:
            return None
        n, N = int(self.active[r]), self.N
        forgets = self.columns[r, s.FORGETTING] < 1.0
        solver = self.solvers[r]
        plain = {"rls": 0, "iec": 1}.get(solver)
        unit = self._matrix(r, plain if plain is not None and not forgets else 2)
        start = s.N_SCALARS + 6 * N
        scores = self.state[r, start : start + n]
        informations = self.state[r, start + N : start + N + n]
        widening = np.sqrt(scores / np.maximum(informations, 1e-300))
        covariance = unit * np.outer(widening, widening)
        return covariance if np.all(np.isfinite(covariance)) else None

    def condition(self, r: int) -> float | None:
        """Return the condition number of the row's normal matrix, or None before any data."""
        matrix = self._matrix(r, 0)
        if self.state[r, s.COUNT] == 0.0:
            return None
        value = float(np.linalg.cond(matrix))
        return value if math.isfinite(value) else None
