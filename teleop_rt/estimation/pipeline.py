"""The on-line pipeline: from one sample of position and force to the model worth streaming."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact import detection as d
from teleop_rt.contact.surface import N_SUMS
from teleop_rt.estimation import algebraic as al
from teleop_rt.estimation import cycle as cy
from teleop_rt.estimation import selection as sel
from teleop_rt.estimation.bank import STATUS_NAMES, Bank, SolverSettings
from teleop_rt.estimation.filters import CHANNEL_SIZE, state_variable_filter
from teleop_rt.estimation.parameters import physical
from teleop_rt.estimation.rows import MODEL_CODES, REGRESSIONS, RowSpec

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PipelineSettings:
    """Settings of the pipeline, in the rig's units and seconds.

    force_lag_s > 0 means that force arrives later than the position it belongs to. `surface`
    given makes contact a matter of position alone. length and time scale the regressors.
    """

    period_s: float
    position_resolution: float
    force_noise: float
    onset_force: float
    release_force: float
    force_lag_s: float = 0.0
    differentiator: Literal["svf"] = "svf"
    cutoff_hz: float = 60.0
    onset_samples: int = 3
    release_samples: int = 5
    free_air_s: float = 0.02
    forgetting_factor: float = 1.0
    surface: float | None = None
    largest_gap_ticks: int = 10
    window_s: float = 2.0
    length: float = 5e-3
    time: float = 0.05
    solver: SolverSettings | None = None

    def solver_settings(self) -> SolverSettings:
        """Return the solvers' settings, by default those that fit these noises and rates."""
        if self.solver is not None:
            return self.solver
        variance = self.force_noise**2
        return SolverSettings(
            forgetting=self.forgetting_factor,
            gamma=0.02 / variance,
            noise_variance=variance,
            block=max(16, round(0.064 / self.period_s)),
            warm_up=max(20, round(0.04 / self.period_s)),
        )


class Contact(NamedTuple):
    """What is known of the contact, in rig units; surface is NaN while unknown."""

    in_contact: bool
    contact_id: int
    surface: float
    surface_known: bool
    penetration: float
    velocity: float
    verified_free: float


class StreamedModel(NamedTuple):
    """The model worth streaming: rig units; force_std is its open-loop error."""

    model: str
    parameters: dict[str, float]
    surface: float
    force_std: float


@dataclass
class Trace:
    """States kept of a run: see `cycle.run_ticks` for the columns of `signals`."""

    signals: Matrix
    theta: NDArray[np.float64]
    status: Matrix
    period_s: float = field(default=0.0)


class Pipeline:
    """Alignment, contact, regressions, bank and selection, one tick at a time.

    `update` allocates nothing that grows and never raises on any number.
    """

    def __init__(self, rows: Sequence[RowSpec], settings: PipelineSettings) -> None:
        self.rows = tuple(rows)
        self.settings = settings
        sizes = [len(row.parameters) + (1 if row.linear else 0) for row in rows]
        self.bank = Bank([row.solver for row in rows], sizes, settings.solver_settings())
        self._state = self._allocate()
        self.theta = self.bank.theta
        self.restarts = self.bank.restarts
        self.lambda_ = self.bank.lambda_
        self.predicted: Vector = self._state.records[:, sel.PREDICTED]
        self.reset()

    def _allocate(self) -> cy.State:
        """Allocate the state of the cycle for these rows and settings."""
        one, rows, N = self.settings, len(self.rows), self.bank.N
        delay = one.force_lag_s / one.period_s
        ring = math.ceil(abs(delay)) + 2
        design = state_variable_filter(one.cutoff_hz, one.period_s)
        cycle = np.zeros(cy.N_CYCLE_SETTINGS)
        cycle[cy.PERIOD] = one.period_s
        cycle[cy.LENGTH] = one.length
        cycle[cy.SPEED] = one.length / one.time
        cycle[cy.ACCELERATION] = one.length / one.time**2
        cycle[cy.POSITION_DELAY] = max(delay, 0.0)
        cycle[cy.FORCE_DELAY] = max(-delay, 0.0)
        cycle[cy.SETTLE_TICKS] = design.settle_ticks
        cycle[cy.LARGEST_GAP] = one.largest_gap_ticks
        cycle[cy.WINDOW] = one.window_s
        cycle[cy.NOISE] = one.force_noise
        cycle[cy.RELEASE_LEVEL] = one.release_force
        detection = np.zeros(d.N_DETECTION)
        detection[d.ONSET_FORCE] = one.onset_force
        detection[d.RELEASE_FORCE] = one.release_force
        detection[d.ONSET_SAMPLES] = one.onset_samples
        detection[d.RELEASE_SAMPLES] = one.release_samples
        detection[d.FREE_AIR_TICKS] = one.free_air_s / one.period_s
        detection[d.FORCE_NOISE] = one.force_noise
        detection[d.RESOLUTION] = one.position_resolution
        return cy.State(
            q=np.zeros(cy.N_CYCLE),
            settings=cycle,
            detector=np.zeros(d.N_DETECTOR),
            detection=detection,
            rings=np.zeros((2, ring)),
            history=np.zeros((2, d.HISTORY)),
            transition=design.transition,
            before=design.gain_before,
            now=design.gain_now,
            channels=np.zeros((cy.N_CHANNELS, CHANNEL_SIZE)),
            windows=np.zeros((2, al.N_LINEAR)),
            log_windows=np.zeros((2, al.N_LOG)),
            sums=np.zeros(N_SUMS),
            shift=np.zeros(2),
            bank=self.bank.state,
            bank_settings=self.bank.columns,
            active=self.bank.active,
            base=np.array([len(row.parameters) for row in self.rows], dtype=np.int64),
            codes=np.array([MODEL_CODES[row.model] for row in self.rows], dtype=np.int64),
            regressions=np.array([REGRESSIONS.index(r.regression) for r in self.rows]),
            phi=self.bank.phi,
            y=self.bank.y,
            live=self.bank.live,
            ready=np.zeros(rows, dtype=np.bool_),
            records=np.zeros((rows, sel.N_RECORD + 2 * N)),
            choice=np.zeros(sel.N_CHOICE),
        )

    def reset(self) -> None:
        """Forget everything."""
        state = self._state
        for array in (state.q, state.detector, state.rings, state.history, state.channels):
            array[:] = 0.0
        for array in (state.windows, state.log_windows, state.sums, state.records, state.choice):
            array[:] = 0.0
        state.live[:] = False
        state.choice[sel.SELECTED] = -1.0
        state.q[cy.LEAST_FORCE], state.q[cy.LARGEST_FORCE] = math.inf, -math.inf
        known = self.settings.surface is not None
        linear = np.array([row.linear for row in self.rows])
        state.active[:] = state.base + (linear & (not known))
        if self.settings.surface is not None:
            state.detector[d.SURFACE] = self.settings.surface
            state.detector[d.SURFACE_KNOWN] = state.detector[d.SURFACE_FIXED] = 1.0
        self.bank.reset()

    def update(self, position: float, force: float, valid: bool) -> None:
        """Take one tick's sample (rig units); `valid` false, or not a number, counts as missing."""
        cy.tick(self._state, position, force, valid)

    def run(
        self, position: Vector, force: Vector, valid: NDArray[np.bool_], decimate: int = 1
    ) -> Trace:
        """Run a whole recording through the very same kernel: same numbers, bit for bit.

        position, force, valid (samples,); every `decimate`-th state is kept in the trace.
        """
        kept, rows = len(position) // decimate, len(self.rows)
        trace = Trace(
            signals=np.zeros((kept, 8)),
            theta=np.zeros((kept, rows, self.bank.N)),
            status=np.zeros((kept, rows)),
            period_s=self.settings.period_s * decimate,
        )
        cy.run_ticks(
            self._state,
            np.ascontiguousarray(position, dtype=np.float64),
            np.ascontiguousarray(force, dtype=np.float64),
            np.ascontiguousarray(valid, dtype=np.bool_),
            decimate,
            trace.signals,
            trace.theta,
            trace.status,
        )
        return trace

    @property
    def contact(self) -> Contact:
        """What is known of the contact now."""
        one, q = self._state.detector, self._state.q
        known = bool(one[d.SURFACE_KNOWN] > 0.0)
        return Contact(
            in_contact=bool(one[d.IN_CONTACT] > 0.0),
            contact_id=int(one[d.CONTACT_ID]),
            surface=float(one[d.SURFACE]) if known else math.nan,
            surface_known=known,
            penetration=float(q[cy.PENETRATION]),
            velocity=float(q[cy.VELOCITY]),
            verified_free=float(one[d.VERIFIED_FREE]),
        )

    @property
    def onsets(self) -> int:
        """Number of onsets that were believed: found from free air."""
        return int(self._state.detector[d.ONSETS])

    @property
    def surface_reason(self) -> str | None:
        """Why there is no surface, or None when there is one."""
        one = self._state.detector
        if one[d.SURFACE_KNOWN] > 0.0:
            return None
        if one[d.IN_CONTACT] > 0.0 and one[d.FREE_SEEN] == 0.0:
            return "the recording never leaves contact, so the surface cannot be seen"
        if one[d.CONTACT_ID] == 0.0:
            return "the recording never comes into contact"
        return "no contact began after a stretch of free air, so the surface cannot be seen"

    @property
    def status(self) -> list[str]:
        """The status of each row in words."""
        return [STATUS_NAMES[int(code)] for code in self.bank.status]

    def estimate(self, row: int) -> tuple[list[str], Vector, Vector | None]:
        """Return names, values and standard deviations (or None) of a row, in rig units."""
        n = int(self.bank.active[row])
        spec = self.rows[row]
        covariance = self.bank.covariance(row) if spec.regression == "direct" else None
        one = self.settings
        return physical(spec, self.theta[row, :n].copy(), covariance, one.length, one.time)

    def condition(self, row: int) -> float | None:
        """Return the condition number of a row's (scaled) normal matrix, None before any data."""
        return self.bank.condition(row)

    @property
    def selected(self) -> int:
        """The row whose model is worth streaming, -1 while none."""
        return int(self._state.choice[sel.SELECTED])

    def predicted_force(self, row: int) -> float:
        """Return the force that a row predicts now, open loop, by its frozen parameters."""
        return float(self.predicted[row])

    def model(self) -> StreamedModel | None:
        """Return the model to stream, or None while there is none."""
        row = self.selected
        if row < 0:
            return None
        names, values, _ = self.estimate(row)
        contact = self.contact
        reference = contact.surface if contact.surface_known else self._state.q[cy.SURFACE_USED]
        return StreamedModel(
            model=self.rows[row].model,
            parameters=dict(zip(names, values.tolist(), strict=True)),
            surface=float(reference),
            force_std=math.sqrt(float(self._state.records[row, sel.ERROR_POWER])),
        )

    def nrmse(self, row: int) -> float | None:
        """Return the normalised force error (4.1) of a row's open-loop predictions, or None."""
        record, q = self._state.records[row], self._state.q
        spread = q[cy.LARGEST_FORCE] - q[cy.LEAST_FORCE]
        if record[sel.SCORED] == 0.0 or not spread > 0.0:
            return None
        return float(math.sqrt(record[sel.TOTAL_POWER] / record[sel.SCORED]) / spread)

    def convergence_s(self, row: int) -> float | None:
        """Return the contact time after which a row's leading parameter settled, or None.

        Settled: k, ln k or m within 2 % of where it is now; None before it is estimated.
        """
        record = self._state.records[row]
        ready = self._state.ready[row] and record[sel.ANCHORED] > 0.0
        return float(record[sel.ANCHOR_TIME]) if ready else None
