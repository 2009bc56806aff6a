"""The second half of a tick: regress, solve, predict, choose; and whole recordings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact import detection
from teleop_rt.contact import surface as surface_fit
from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import EXPONENT_LEAST, EXPONENT_MOST
from teleop_rt.estimation import layout, selection, watch
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import state as index
from teleop_rt.estimation.bank_kernels import bank_step
from teleop_rt.estimation.contact_edges import end_excursion
from teleop_rt.estimation.grid import Whole as Places
from teleop_rt.estimation.grid import gap_at
from teleop_rt.estimation.pair_kernels import PAIR, Paired, take_sample
from teleop_rt.estimation.physical import NONE, deviation_known, surely_positive
from teleop_rt.estimation.row_equations import (
    fill_algebraic,
    fill_direct,
    integrate_filtered,
    is_free,
    predict,
    predict_by,
)
from teleop_rt.estimation.sensing import sense
from teleop_rt.kernels.jit import kernel, shared

Matrix = NDArray[np.float64]
Flags = NDArray[np.bool_]
Codes = NDArray[np.uint8]


@kernel
def track_excursions(state: index.BankState, x: float) -> None:
    """Notice the turning points of the motion; an excursion ends where penetration is least."""
    q = state.q
    if q[index.DIRECTION] == 0.0:
        q[index.DIRECTION] = 1.0
        q[index.EXTREME] = q[index.LOWEST] = q[index.HIGHEST] = x
    q[index.LOWEST] = min(q[index.LOWEST], x)
    q[index.HIGHEST] = max(q[index.HIGHEST], x)
    play = 0.1 * max(
        q[index.HIGHEST] - q[index.LOWEST], 100.0 * state.detection[detection.RESOLUTION]
    )
    if q[index.DIRECTION] > 0.0:
        q[index.EXTREME] = max(q[index.EXTREME], x)
        if x < q[index.EXTREME] - play:
            q[index.DIRECTION], q[index.EXTREME] = -1.0, x
    else:
        q[index.EXTREME] = min(q[index.EXTREME], x)
        if x > q[index.EXTREME] + play:
            q[index.DIRECTION], q[index.EXTREME] = 1.0, x
            end_excursion(state)


@kernel
def of_a_wall(code: int, value: float) -> bool:
    """Return whether a stiffness, or the exponent of a Hunt-Crossley row, may be of a wall."""
    if code == row_kinds.HUNT_CROSSLEY:
        return EXPONENT_LEAST <= value <= EXPONENT_MOST
    return value > 0.0


@kernel
def possible_choice(state: index.BankState, r: int) -> int:
    """Return whether a row may be chosen: by its values, readiness, and sure signs.

    A free motion's row, which is ready in free air, must first have predicted a contact where the
    others are rows of contact.
    """
    code, ready = state.codes[r], state.bank[r, layout.READY] > 0.0
    if is_free(code):
        compared_s = state.records[r, selection.COMPARED] * state.settings[index.PERIOD]
        tried = state.settings[index.ONLY_FREE] > 0.0 or compared_s >= selection.LEAST_SCORED_S
        return (
            selection.IDENTIFIED
            if ready and tried and surely_positive(state, r, 0, NONE)
            else selection.IMPOSSIBLE
        )
    place = (
        1 if code == row_kinds.MASS_SPRING_DAMPER else 2 if code == row_kinds.HUNT_CROSSLEY else 0
    )
    if not of_a_wall(code, state.bank[r, layout.THETA + place]):
        return selection.REFUSED
    if not (ready and surely_positive(state, r, place, place)):
        return selection.IMPOSSIBLE
    if code != row_kinds.MASS_SPRING_DAMPER:
        return selection.IDENTIFIED
    mass_known = deviation_known(state, r) and surely_positive(state, r, 0, place)
    return selection.IDENTIFIED if mass_known else selection.POSSIBLE


@kernel
def judge_row(state: index.BankState, r: int, judged: bool, compared: bool, force: float) -> None:
    """Predict with a row, and where it can be judged, score it against the force measured.

    `compared` where all rows that may be chosen are judged.
    """
    dt = state.settings[index.PERIOD]
    record = state.records[r]
    state.ready[r] = state.bank[r, layout.READY] > 0.0
    state.possible[r] = possible_choice(state, r)
    predicted = predict(state, r)
    record[selection.PREDICTED] = predicted if math.isfinite(predicted) else 0.0
    if judged and record[selection.HAS_FROZEN] > 0.0:
        selection.score(record, force - record[selection.PREDICTED], compared, dt)


@kernel
def judge(state: index.BankState) -> None:
    """Predict with every row, score the rows, and choose the one to stream."""
    m = state.motion
    settled = state.q[index.SETTLED] >= state.settings[index.SETTLE_TICKS]
    free_settled = state.q[index.FREE_SETTLED] >= state.settings[index.SETTLE_TICKS]
    only_free = state.settings[index.ONLY_FREE] > 0.0
    for r in range(int(state.settings[index.N_ROWS])):
        code = state.codes[r]
        if code == row_kinds.COMPANION:
            state.ready[r] = state.possible[r] = 0
        elif is_free(code):
            judge_row(state, r, free_settled, settled or only_free, m[index.M_FREE])
        else:
            judge_row(state, r, settled, settled, m[index.MF])
    if not (settled or (only_free and free_settled)):
        watch.end_stretch(state.watch)
        return
    force = m[index.M_FREE] if only_free else m[index.MF]
    state.q[index.LEAST_FORCE] = min(state.q[index.LEAST_FORCE], force)
    state.q[index.LARGEST_FORCE] = max(state.q[index.LARGEST_FORCE], force)
    track_excursions(state, m[index.MX] * state.settings[index.LENGTH])
    rows = int(state.settings[index.N_ROWS])
    noise, dt = state.settings[index.NOISE], state.settings[index.PERIOD]
    watch_over(state, force)
    selection.choose(
        state.choice, state.records, state.possible[:rows], state.regressions, noise, dt
    )


@kernel
def watch_over(state: index.BankState, force: float) -> None:
    """Watch the residual of the selected row, by its present parameters.

    Frozen parameters are worse in the first seconds because of missing data, not of the model. A
    hand that holds ends no excursion and so freezes none, but the master renders the row all along.
    """
    chosen = int(state.choice[selection.SELECTED])
    if chosen < 0:
        watch.end_stretch(state.watch)
        return
    watch.turn_to(state.watch, chosen)
    q, resolution = state.q, state.detection[detection.RESOLUTION]
    depth = max(abs(q[index.PENETRATION]), 100.0 * resolution)
    curved = state.codes[chosen] == row_kinds.HUNT_CROSSLEY
    variance = resolution * resolution / 12.0 + detection.surface_variance(state.detector, curved)
    by_position = abs(force) / depth * math.sqrt(variance)
    span = q[index.LARGEST_FORCE] - q[index.LEAST_FORCE]
    residual = force - predict_by(state, chosen, state.bank[chosen, layout.THETA :])
    watch.judge_residual(
        state.watch,
        residual,
        state.settings[index.NOISE],
        by_position,
        span,
        state.settings[index.PERIOD],
    )


@kernel
def weigh_terms(state: index.BankState) -> None:
    """Sum up the additive effects' forces, and those of the rig, by their known amplitudes.

    That is the selected row's estimate where it is ready and not far from its start.
    """
    q, chosen = state.q, int(state.choice[selection.SELECTED])
    q[index.RIG_FORCE] = q[index.ADDED_FORCE] = q[index.START_FORCE] = 0.0
    effects = int(state.settings[index.N_EFFECTS])
    linear = (
        chosen >= 0 and state.codes[chosen] != row_kinds.HUNT_CROSSLEY and not state.frozen[chosen]
    )
    for e in range(effects):
        share = state.starts[e]
        if linear and state.bank[chosen, layout.READY] > 0.0:
            found = state.bank[chosen, layout.THETA + state.own[chosen] - effects + e]
            share = found if abs(found - share) <= 1.0 else share
        q[index.START_FORCE] += state.starts[e] * state.terms[e]
        q[index.ADDED_FORCE] += share * state.terms[e]
        q[index.RIG_FORCE] += share * state.terms[e] * state.of_rig[e]


@kernel
def estimate(state: index.BankState, whole: layout.Whole) -> None:
    """Advance all rows by the instant in `motion`, with the effects' values in `terms`."""
    q, settings, m = state.q, state.settings, state.motion
    if whole is not None and settings[index.N_EFFECTS] > 0.0:
        weigh_terms(state)
        integrate_filtered(state, q[index.ELAPSED])
    q[index.ELAPSED] = 0.0
    for r in range(int(state.settings[index.N_ROWS])):
        if whole is not None and state.regressions[r] != 0:
            fill_algebraic(state, r, state.phi[r])
        else:
            fill_direct(state, r, state.phi[r])
    rows = int(settings[index.N_ROWS])
    bank_step(
        state.bank,
        state.bank_settings,
        state.active,
        state.phi,
        state.y[:rows],
        state.lever,
        state.live,
        whole,
    )
    if q[index.SETTLED] >= settings[index.SETTLE_TICKS]:
        x, v = m[index.MX] * settings[index.LENGTH], m[index.MV] * settings[index.SPEED]
        body = m[index.MF] - q[index.ADDED_FORCE]
        surface_fit.add_sample(
            state.sums, state.buffer, state.refit, x, v, body, 5.0 * settings[index.NOISE]
        )
    judge(state)


@kernel
def sense_tick(one: index.StateArray, position: float, force: float, valid: bool) -> bool:
    """Do the first half of a tick, after which effects are evaluated where there are any.

    Returns whether the second half has anything to do: `run_ticks` with `sensed`.
    """
    return sense(one[0], position, force, valid)


@shared
def skip(state: index.BankState, ticks: int) -> None:
    """Let ticks pass that had no sample: the next one ends a gap of so many more."""
    state.q[index.GAP] += ticks
    state.q[index.ELAPSED] += ticks * state.settings[index.PERIOD]


@kernel
def write_trace_row(one: index.StateArray, signals: Vector, theta: Matrix, status: Codes) -> None:
    """Write the present state to one row of a trace: see `run_ticks`."""
    state = one[0]
    known = state.detector[detection.SURFACE_KNOWN] > 0.0
    chosen = int(state.choice[selection.SELECTED])
    signals[0] = state.detector[detection.IN_CONTACT]
    signals[1] = state.detector[detection.CONTACT_ID]
    signals[2] = state.detector[detection.SURFACE] if known else math.nan
    signals[3] = state.motion[index.MX] * state.settings[index.LENGTH]
    signals[4] = state.motion[index.MV] * state.settings[index.SPEED]
    signals[5] = chosen
    signals[6] = state.records[chosen, selection.PREDICTED] if chosen >= 0 else math.nan
    signals[7] = state.motion[index.MF]
    for r in range(theta.shape[0]):
        status[r] = np.uint8(state.bank[r, layout.STATUS])
        for j in range(theta.shape[1]):
            theta[r, j] = state.bank[r, layout.THETA + j]


@kernel
def run_ticks(
    one: index.StateArray,
    positions: Vector,
    forces: Vector,
    valids: Flags,
    signals: Matrix,
    theta: NDArray[np.float64],
    status: Codes,
    grid: Places,
    paired: Paired,
    decimate: int,
    sensed: bool,
    whole: layout.Whole,
    position: float,
    force: float,
    stamp_ns: int,
    valid: bool,
) -> int:
    """Run one tick with `position`, `force`, `valid`; or where a recording is given, all of its.

    One kernel serves both, for its compilation takes ten seconds. Of a tick that `sense_tick` has
    `sensed`, it does the second half. Where there is a grid, the words of a `SampleGrid`, the
    sample of one tick ends the gap before its stamp. Where there is a pairing, its cycle's sample,
    if it is `valid` here, too, takes the place of position and force; return as `take_sample` does,
    without a pair before anything is run.
    positions, forces, valids (samples,), empty for one tick; every `decimate`-th state is kept in
    signals (kept, 8): in contact, contact id, surface (NaN while unknown), penetration and
    velocity, selected row, its predicted force, force, all through one filter; theta (kept, rows,
    the most parameters of a row) scaled; status (kept, rows).
    """
    if len(paired.pairs) > 0:
        found = take_sample(paired, valid)
        if found != PAIR:
            return found
        pair: Any = paired.pairs[0]
        position, force = pair.position, pair.force
        skip(one[0], pair.gap)
    recorded = len(positions)
    for i in range(max(recorded, 1)):  # the code of a tick stands here once: it is large
        if recorded > 0:
            position, force, valid = positions[i], forces[i], valids[i]
        if len(grid) > 0:
            skip(one[0], gap_at(grid, valid, stamp_ns))
        if sensed or sense(one[0], position, force, valid):
            estimate(one[0], whole)
        if recorded > 0 and (i + 1) % decimate == 0:
            k = (i + 1) // decimate - 1
            write_trace_row(one, signals[k], theta[k], status[k])
    return PAIR
