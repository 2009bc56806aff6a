"""Settings of the pipeline, and the arrays that follow from them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from teleop_rt.contact import detection
from teleop_rt.contact import surface as surface_fit
from teleop_rt.contact.effect import Vector
from teleop_rt.contact.fitted import FittedEffect
from teleop_rt.contact.lagged_onset import N_RECURSION, recursion_of
from teleop_rt.contact.slow_onset import settling_weights
from teleop_rt.estimation import layout, selection
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import state as index
from teleop_rt.estimation.bank import Bank, SolverSettings
from teleop_rt.estimation.filters import DesignedFilter, design
from teleop_rt.estimation.pairing import EvenPairing, Pairing
from teleop_rt.estimation.rows import MODEL_CODES, RowSpec
from teleop_rt.estimation.surface_motion import SurfaceMotion
from teleop_rt.ids import REGRESSIONS

_OF_CONTACT = {row_kinds.KELVIN_VOIGT, row_kinds.UNILATERAL, row_kinds.MASS_SPRING_DAMPER}
"""Models that estimate an offset of the force where the surface is unknown."""


@dataclass(frozen=True, slots=True)
class PipelineSettings:
    """Settings of the pipeline, in the rig's units and seconds.

    force_lag_s > 0 means that force arrives later than the position it belongs to, known to
    force_lag_deviation_s; friction_deviation is that of a force left against the motion.
    paired_lag_s is the lag that `Pairing` takes out before, if sensors are slower
    than the loop, and None where the pipeline takes every cycle's sample; a converter that settles
    in paired_settling_s averages the force, and the position is averaged alike. `surface`
    given, known to surface_deviation, makes contact a matter of position alone. window_s is the
    length of an algebraic window; `length` and `time` scale the regressors to near one. `shapes`
    sets shape parameters of additive effects by the effect's name, `starts` their amplitudes, in
    multiples of their scales, before they are estimated (0 unless given). `corrections` act before
    everything. Effects were fitted on a recording with the `diagnosed_surface`, if that is known. A
    body that `lets_go` has a memory by which it is met again deeper than its surface. A moving
    surface is tracked with the bandwidth `surface_tracking_hz`, 0 for a stationary one.
    """

    period_s: float
    position_resolution: float
    force_noise: float
    onset_force: float
    release_force: float
    force_lag_s: float = 0.0
    force_lag_deviation_s: float = 0.0
    friction_deviation: float = 0.0
    paired_lag_s: float | None = None
    paired_settling_s: float = 0.0
    differentiator: Literal["svf", "kalman", "foaw"] = "svf"
    cutoff_hz: float = 60.0
    onset_samples: int = 3
    release_samples: int = 5
    free_air_s: float = 0.02
    forgetting_factor: float = 1.0
    surface: float | None = None
    surface_deviation: float = 0.0
    largest_gap_ticks: int = 10
    window_s: float = 2.0
    length: float = 5e-3
    time: float = 0.05
    solver: SolverSettings | None = None
    shapes: Mapping[str, Sequence[float]] = field(default_factory=dict)
    starts: tuple[float, ...] = ()
    corrections: tuple[FittedEffect, ...] = ()
    diagnosed_surface: float | None = None
    lets_go: bool = False
    surface_tracking_hz: float = 0.0

    def solver_settings(self) -> SolverSettings:
        """Return the solvers' settings, by default those that fit these noises and rates."""
        if self.solver is not None:
            return self.solver
        variance = self.force_noise**2
        return SolverSettings(
            forgetting=self.forgetting_factor,
            gamma=0.02 / variance,
            noise_variance=variance,
            # A memory of a tenth of a second at least: a shorter one cannot separate k from b.
            lambda_min=1.0 - self.period_s / 0.1,
            block=max(16, round(0.064 / self.period_s)),
            warm_up=max(20, round(0.04 / self.period_s)),
        )

    def pairing(self, loop_period_ns: int) -> Pairing | None:
        """Return the pairing of slow sensors' samples, None where every cycle has its own."""
        if self.paired_lag_s is None:
            return None
        pair_period_ns = round(1e9 * self.period_s)
        if pair_period_ns < 1.5 * loop_period_ns:
            return EvenPairing(loop_period_ns, pair_period_ns, self.paired_lag_s)
        return Pairing(loop_period_ns, pair_period_ns, self.paired_lag_s, self.paired_settling_s)

    def surface_motion(self) -> SurfaceMotion | None:
        """Return the tracker of a moving surface, None for a stationary one."""
        if self.surface_tracking_hz == 0.0:
            return None
        return SurfaceMotion(
            self.surface_tracking_hz,
            self.period_s,
            self.onset_force,
            self.force_noise,
            self.length,
        )

    def design(self) -> DesignedFilter:
        """Return the differentiator with its lag and noise gains."""
        return design(self.differentiator, self.cutoff_hz, self.period_s)


def _cycle_settings(one: PipelineSettings, rows: Sequence[RowSpec], count: int) -> Vector:
    """Return the cycle's settings in the order of `state`'s columns."""
    delay = one.force_lag_s / one.period_s
    designed = one.design()
    cycle = np.zeros(index.N_CYCLE_SETTINGS)
    cycle[index.PERIOD] = one.period_s
    cycle[index.LENGTH] = one.length
    cycle[index.SPEED] = one.length / one.time
    cycle[index.ACCELERATION] = one.length / one.time**2
    cycle[index.POSITION_DELAY] = max(delay, 0.0)
    cycle[index.FORCE_DELAY] = max(-delay, 0.0)
    cycle[index.SETTLE_TICKS] = designed.settle_ticks
    cycle[index.LARGEST_GAP] = one.largest_gap_ticks
    cycle[index.WINDOW] = one.window_s
    cycle[index.NOISE] = one.force_noise
    cycle[index.RELEASE_LEVEL] = one.release_force
    cycle[index.FOAW_WINDOW] = designed.window
    cycle[index.ANY_FREE] = float(any(row.model in {"mass", "mass-damper"} for row in rows))
    cycle[index.ONLY_FREE] = float(all(row.model in {"mass", "mass-damper"} for row in rows))
    cycle[index.N_EFFECTS] = len(rows[0].effects)
    cycle[index.N_ROWS] = count
    cycle[index.RING] = math.ceil(abs(delay)) + 2
    if cycle[index.RING] > index.LONGEST_LAG:
        most = index.LONGEST_LAG - 2
        raise ValueError(f"force_lag_s {one.force_lag_s} is more than {most} ticks")
    return cycle


def _detection_settings(one: PipelineSettings) -> Vector:
    """Return the detector's settings in the order of its columns."""
    values = np.zeros(detection.N_DETECTION)
    values[detection.ONSET_FORCE] = one.onset_force
    values[detection.RELEASE_FORCE] = one.release_force
    values[detection.ONSET_SAMPLES] = one.onset_samples
    values[detection.RELEASE_SAMPLES] = one.release_samples
    values[detection.FREE_AIR_TICKS] = one.free_air_s / one.period_s
    values[detection.FORCE_NOISE] = one.force_noise
    values[detection.RESOLUTION] = one.position_resolution
    values[detection.LETS_GO] = float(one.lets_go)
    if one.paired_lag_s is not None and one.paired_settling_s > 0.0:
        span = max(1, round(one.paired_settling_s / one.period_s))
        weights = settling_weights(span)
        values[detection.SETTLING] = span
        values[detection.AVERAGE : detection.AVERAGE + len(weights)] = weights
    recursion = _recursion_of_channel(one)
    values[detection.LAGGED] = float(np.any(recursion != 0.0))
    values[detection.RECURSION : detection.RECURSION + N_RECURSION] = recursion
    return values


def _recursion_of_channel(one: PipelineSettings) -> Vector:
    """Return the recursion of the slow force channel among the corrections, zeros without one."""
    slow = [fitted for fitted in one.corrections if fitted.effect.acts == "filters_force"]
    states = [np.zeros(max(1, fitted.effect.state_size)) for fitted in slow]

    def respond(value: float) -> float:
        for fitted, state in zip(slow, states, strict=True):
            value = fitted.effect.step(state, value, 0.0, 0.0, 0.0, one.period_s, fitted.eta)
        return value

    return recursion_of(respond) if slow else np.zeros(N_RECURSION)


def covariance_slot(row: RowSpec, forgetting: float) -> int:
    """Return where a row's state holds its covariance per unit of noise.

    UNKNOWN_VARIANCE for algebraic rows: their noise is integrated, coloured and grows.
    """
    if row.regression != "direct":
        return layout.UNKNOWN_VARIANCE
    if forgetting != 1.0:
        return layout.PROPAGATED
    return {"rls": layout.COVARIANCE, "iec": layout.GRADIENT}.get(row.solver, layout.PROPAGATED)


def bank_for(
    one: PipelineSettings, rows: Sequence[RowSpec], storage: index.StateArray
) -> tuple[Bank, list[int], list[int]]:
    """Return the bank with the parameters (without offset) and model codes of its rows.

    Hunt-Crossley rows with additive effects get a companion row, the last one.
    """
    effects = len(rows[0].effects)
    added = [effects if row.linear and not row.frozen else 0 for row in rows]
    base = [len(row.declared.parameters) + n for row, n in zip(rows, added, strict=True)]
    codes = [MODEL_CODES[row.model] for row in rows]
    solvers = [row.solver for row in rows]
    sizes = [n + (1 if row.linear else 0) for n, row in zip(base, rows, strict=True)]
    if effects and not all(row.linear for row in rows):
        base.append(2 + effects)
        sizes.append(2 + effects)
        codes.append(row_kinds.COMPANION)
        solvers.append("rls")
    bank = Bank(solvers, sizes, one.solver_settings(), storage)
    for r, row in enumerate(rows):
        bank.columns[r, layout.VARIANCE_AT] = covariance_slot(row, one.solver_settings().forgetting)
        if codes[r] == row_kinds.HUNT_CROSSLEY:  # ln k takes up the unit of x in ln x
            bank.columns[r, layout.INTERCEPT], bank.columns[r, layout.SHIFTED] = 0, 2
    return bank, base, codes


def allocate(
    one: PipelineSettings, rows: Sequence[RowSpec]
) -> tuple[index.StateArray, index.BankState, Bank]:
    """Allocate everything that a tick reads and writes, and the bank that is part of it.

    Raises ValueError for settings that cannot be: see `filters.design` and `Bank`.
    """
    if len(rows[0].effects) > index.MOST_EFFECTS:
        raise ValueError(f"{len(rows[0].effects)} additive effects, {index.MOST_EFFECTS} at most")
    storage, state = index.new_state()
    bank, base, codes = bank_for(one, rows, storage)
    designed = one.design()
    regressions = [REGRESSIONS.index(row.regression) for row in rows]
    state.settings[:] = _cycle_settings(one, rows, len(codes))
    state.detection[:] = _detection_settings(one)
    state.transition[:] = designed.transition
    state.before[:] = designed.gain_before
    state.now[:] = designed.gain_now
    state.own[: len(codes)] = base
    state.codes[: len(codes)] = codes
    state.regressions[: len(rows)] = regressions
    state.frozen[: len(rows)] = [row.frozen for row in rows]
    state.starts[: len(one.starts)] = one.starts
    state.of_rig[: len(rows[0].effects)] = [e.belongs_to == "rig" for e in rows[0].effects]
    return storage, state, bank


def clear(one: PipelineSettings, state: index.BankState, bank: Bank) -> None:
    """Set everything that a tick writes to its value before the first one."""
    for array in (state.q, state.detector, state.rings, state.history, state.channels):
        array[:] = 0.0
    for array in (state.windows, state.log_windows, state.sums, state.records, state.choice):
        array[:] = 0.0
    state.term_windows[:] = state.watch[:] = 0.0
    state.refit[:] = 0.0
    state.refit[surface_fit.STRIDE] = 1.0
    state.live[:] = False
    state.choice[selection.SELECTED] = -1.0
    state.q[index.LEAST_FORCE], state.q[index.LARGEST_FORCE] = math.inf, -math.inf
    if one.surface is not None:
        state.detector[detection.SURFACE] = one.surface
        state.detector[detection.SURFACE_VARIANCE] = one.surface_deviation**2
        state.detector[detection.SURFACE_KNOWN] = state.detector[detection.SURFACE_FIXED] = 1.0
    for r in range(len(bank.y)):
        unknown_surface = one.surface is None and state.codes[r] in _OF_CONTACT
        state.active[r] = state.own[r] + int(unknown_surface)
    bank.reset()
