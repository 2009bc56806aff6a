"""The estimator bank: one preallocated row per estimator, one kernel that advances them all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import layout
from teleop_rt.estimation import state as index
from teleop_rt.estimation.bank_kernels import bank_step, reset_row
from teleop_rt.ids import SOLVERS
from teleop_rt.kernels.jit import kernel

Matrix = NDArray[np.float64]
Flags = NDArray[np.uint8]
Counts = NDArray[np.int64]


@kernel
def run_bank(one: index.StateArray, rows: int, phi: Matrix, y: Vector) -> None:
    """Advance the bank within the record `one` over samples: phi (samples x rows, ...), y likewise.

    One sample is the quickest call from Python; one compiled form serves a recording, too.
    """
    state = one[0]
    bank, settings, active = state.bank, state.bank_settings, state.active
    for i in range(0, len(y), rows):
        row, target = phi[i : i + rows], y[i : i + rows]
        bank_step(bank, settings, active, row, target, state.lever, state.live, layout.WHOLE)


@dataclass(frozen=True, slots=True)
class SolverSettings:
    """Settings of all solvers, for regressors of order one.

    P0 = prior I, and trace(P) stays below ceiling * n * prior; beta and gamma of (3.6, 3.7);
    noise_variance sigma^2 of (3.7), rho of (3.8); alpha and the bounds of lambda of (3.9 to 3.11);
    block is the length [samples] of the score sums behind the standard deviations, warm_up the
    samples before a row may be called estimated; one_sided perturbs above the noise only.
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
    one_sided: bool = False

    def row(self, solver: str) -> list[float]:
        """Return the settings of one row in the order of `layout`'s columns."""
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
            float(self.one_sided),
            layout.NO_INTERCEPT,
            layout.NO_INTERCEPT,
            layout.UNKNOWN_VARIANCE,
        ]


class Bank:
    """All estimators at once; the kernel sees only phi and y.

    `solvers` names each row's solver, `sizes` its number of parameters (at most MAX_PARAMETERS).
    `theta` (rows, MAX_PARAMETERS), `lambda_`, `status`, `restarts`, `count` (rows,) are views of
    the state to read.
    `step(phi, y)` advances every live row by one sample: phi (rows, up to MAX_PARAMETERS), y
    (rows,).
    `storage` is the pipeline's record where the bank is part of one. Raises ValueError for more
    parameters or rows than there is room for.
    """

    def __init__(
        self,
        solvers: Sequence[str],
        sizes: Sequence[int],
        settings: SolverSettings | Sequence[SolverSettings] = SolverSettings(),
        storage: index.StateArray | None = None,
    ) -> None:
        if max(sizes) > layout.MAX_PARAMETERS:
            raise ValueError(
                f"a row has {max(sizes)} parameters, the bank holds {layout.MAX_PARAMETERS} at most"
            )
        if len(solvers) > index.MOST_ROWS:
            raise ValueError(f"{len(solvers)} rows, the bank holds {index.MOST_ROWS} at most")
        rows = len(solvers)
        each = [settings] * rows if isinstance(settings, SolverSettings) else settings
        self._one = index.new_state()[0] if storage is None else storage
        memory = index.look_into(self._one)
        self.solvers = tuple(solvers)
        self.columns: Matrix = memory.bank_settings[:rows]
        self.active: Counts = memory.active[:rows]
        self.phi: Matrix = memory.phi[:rows]
        self.y: Vector = memory.y[:rows]
        self.lever: Vector = memory.lever[:rows]
        self.live: Flags = memory.live[:rows]
        self.state: Matrix = memory.bank[:rows]
        self.columns[:] = [one.row(name) for one, name in zip(each, solvers, strict=True)]
        self.active[:] = sizes
        self.live[:] = 1
        self.theta: Matrix = self.state[:, layout.THETA : layout.THETA + layout.MAX_PARAMETERS]
        self.lambda_: Vector = self.state[:, layout.LAMBDA]
        self.status: Vector = self.state[:, layout.STATUS]
        self.restarts: Vector = self.state[:, layout.RESTARTS]
        self.count: Vector = self.state[:, layout.COUNT]
        # A partial, not a method: a tick is called from Python so often that it shows.
        self.step: Callable[[Matrix, Vector], None] = partial(run_bank, self._one, rows)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.state[:] = 0.0
        for r in range(len(self.y)):
            reset_row(self.state[r], self.columns[r], int(self.active[r]))

    def run(self, phi: NDArray[np.float64], y: Matrix) -> None:
        """Advance every live row over a recording: phi (samples, rows, up to MAX_PARAMETERS)."""
        run_bank(self._one, len(self.y), phi.reshape(-1, phi.shape[-1]), y.reshape(-1))

    def _matrix(self, r: int, slot: int) -> Matrix:
        n = int(self.active[r])
        square: Matrix = self.state[r, slot : slot + layout.MAX_PARAMETERS**2].reshape(
            layout.MAX_PARAMETERS, layout.MAX_PARAMETERS
        )
        return square[:n, :n]

    def condition(self, r: int) -> float | None:
        """Return the condition number of the row's normal matrix, or None before any data.

        It may be infinite: then the data do not excite the model.
        """
        matrix = self._matrix(r, layout.COVARIANCE)
        return float(np.linalg.cond(matrix)) if np.any(matrix) else None
