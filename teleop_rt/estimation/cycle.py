"""The second half of a tick: regress, solve, predict, choose; and whole recordings."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact import detection as d
from teleop_rt.contact import surface as su
from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import algebraic as al
from teleop_rt.estimation import layout as at
from teleop_rt.estimation import rows as rw
from teleop_rt.estimation import selection as sel
from teleop_rt.estimation import state as c
from teleop_rt.estimation import watch as wa
from teleop_rt.estimation.bank_kernels import bank_step
from teleop_rt.estimation.physical import NONE, deviation_known, surely_positive
from teleop_rt.estimation.regressors import algebraic_row, by_surface, direct_row, model_force
from teleop_rt.estimation.sensing import end_excursion, log_gate, sense
from teleop_rt.estimation.windows import advance_contact_windows, advance_log_pair, older_window
from teleop_rt.jit import kernel

Matrix = NDArray[np.float64]
Flags = NDArray[np.bool_]


@kernel
def is_free(code: int) -> bool:
    """Return whether a model needs no contact."""
    return code in (rw.MASS, rw.MASS_DAMPER)


@kernel
def track_excursions(st: c.BankState, x: float) -> None:
    """Notice the turning points of the motion; an excursion ends where penetration is least."""
    q = st.q
    if q[c.DIRECTION] == 0.0:
        q[c.DIRECTION] = 1.0
        q[c.EXTREME] = q[c.LOWEST] = q[c.HIGHEST] = x
    q[c.LOWEST] = min(q[c.LOWEST], x)
    q[c.HIGHEST] = max(q[c.HIGHEST], x)
    play = 0.1 * max(q[c.HIGHEST] - q[c.LOWEST], 100.0 * st.detection[d.RESOLUTION])
    if q[c.DIRECTION] > 0.0:
        q[c.EXTREME] = max(q[c.EXTREME], x)
        if x < q[c.EXTREME] - play:
            q[c.DIRECTION], q[c.EXTREME] = -1.0, x
    else:
        q[c.EXTREME] = min(q[c.EXTREME], x)
        if x > q[c.EXTREME] + play:
            q[c.DIRECTION], q[c.EXTREME] = 1.0, x
            end_excursion(st)


@kernel
def integrate_filtered(st: c.BankState, dt: float) -> None:
    """Integrate with effects: filtered signals, so that the effects' lag is everybody's."""
    q, m = st.q, st.motion
    if st.settings[c.ANY_FREE] > 0.0 and q[c.FREE_SETTLED] >= st.settings[c.SETTLE_TICKS]:
        running = 1.0 if st.windows[c.FREE_PAIR, al.T] >= 0.0 else 0.0
        advance_contact_windows(st, c.FREE_PAIR, m[c.MX], m[c.M_FREE], running, dt)
    else:
        st.windows[c.FREE_PAIR, al.T] = -1.0
    if q[c.SETTLED] < st.settings[c.SETTLE_TICKS]:
        st.windows[c.CONTACT_PAIR, al.T] = -1.0
        q[c.LOG_RUNNING] = q[c.LOG_SETTLED] = 0.0
        return
    running = 1.0 if st.windows[c.CONTACT_PAIR, al.T] >= 0.0 else 0.0
    advance_contact_windows(st, c.CONTACT_PAIR, m[c.MX], m[c.MF], running, dt)
    if not log_gate(st, m[c.MX]):
        return
    force = m[c.MF] - added_force(st)
    m[c.M_LOG_X] = math.log(m[c.MX])
    m[c.M_WEIGHT] = max(force, st.settings[c.NOISE])
    m[c.M_LOG_F] = math.log(m[c.M_WEIGHT])
    advance_log_pair(st, m[c.MX], m[c.M_LOG_X], m[c.M_LOG_F], dt)
    q[c.LOG_RUNNING] = 1.0
    q[c.LOG_SETTLED] = st.settings[c.SETTLE_TICKS]


@kernel
def added_force(st: c.BankState) -> float:
    """Return the present estimate of the additive effects' force, by the companion row.

    The logarithm of Hunt-Crossley admits no additive term: the companion fits the form that is
    linear in k, b and the effects at the exponent found, and its effects leave the force.
    """
    last = int(st.settings[c.N_ROWS]) - 1
    if st.codes[last] == rw.COMPANION and st.bank[last, at.READY] == 0.0:
        return float(st.q[c.START_FORCE])
    total = 0.0
    if st.codes[last] == rw.COMPANION and st.bank[last, at.READY] > 0.0:
        for e in range(int(st.settings[c.N_EFFECTS])):
            total += st.bank[last, at.THETA + 2 + e] * st.terms[e]
    return total


@kernel
def fill_companion(st: c.BankState, r: int, phi: Vector) -> bool:
    """Fill the companion's phi = [x^n, x^n v, effects] and y; return whether n is known."""
    m = st.motion
    for h in range(r):
        if st.codes[h] == rw.HUNT_CROSSLEY and st.bank[h, at.READY] > 0.0 and m[c.MX] > 0.0:
            exponent = min(max(st.bank[h, at.THETA + 2], 0.1), 10.0)
            phi[0] = math.pow(m[c.MX], exponent)
            phi[1] = phi[0] * m[c.MV]
            for e in range(int(st.settings[c.N_EFFECTS])):
                phi[2 + e] = st.terms[e]
            st.y[r] = m[c.MF]
            return True
    return False


@kernel
def fill_direct(st: c.BankState, r: int, phi: Vector) -> None:
    """Fill phi, y and live of a direct row for this instant."""
    settled = st.q[c.SETTLED] >= st.settings[c.SETTLE_TICKS]
    code = st.codes[r]
    if code == rw.COMPANION:
        st.live[r] = settled and fill_companion(st, r, phi)
        return
    st.y[r] = direct_row(code, st.motion, phi)
    st.lever[r] = by_surface(code, st.motion)
    if code == rw.HUNT_CROSSLEY:
        st.live[r] = settled and st.q[c.LOG_SETTLED] >= st.settings[c.SETTLE_TICKS]
        return
    if st.frozen[r]:
        st.y[r] -= st.q[c.START_FORCE]
    else:
        effects = int(st.settings[c.N_EFFECTS])
        for e in range(effects):
            phi[st.own[r] - effects + e] = st.terms[e]
    if st.active[r] > st.own[r]:
        phi[st.own[r]] = 1.0
    free = st.q[c.FREE_SETTLED] >= st.settings[c.SETTLE_TICKS]
    st.live[r] = free if is_free(code) else settled


@kernel
def fill_algebraic(st: c.BankState, r: int, phi: Vector) -> None:
    """Fill phi, y and live of an algebraic row for this instant."""
    code = st.codes[r]
    time = st.settings[c.LENGTH] / st.settings[c.SPEED]
    k = older_window(st, c.FREE_PAIR if is_free(code) else c.CONTACT_PAIR)
    log_k = 0 if st.log_windows[0, al.L_T] >= st.log_windows[1, al.L_T] else 1
    window, log_window = st.windows[k], st.log_windows[log_k]
    st.y[r] = algebraic_row(code, window, log_window, phi, time)
    if code == rw.HUNT_CROSSLEY:
        st.live[r] = st.q[c.LOG_RUNNING] > 0.0 and log_window[al.L_T] > 0.0
        return
    slot = al.J_TP if code == rw.KELVIN_VOIGT else al.JJ_T2P
    effects = int(st.settings[c.N_EFFECTS])
    for e in range(effects):
        if st.frozen[r]:
            st.y[r] -= st.starts[e] * st.term_windows[k, e, slot]
        else:
            phi[st.own[r] - effects + e] = st.term_windows[k, e, slot]
    if st.active[r] > st.own[r]:
        phi[st.own[r]] = al.constant_regressor(window, 1 if code == rw.KELVIN_VOIGT else 2)
    running = st.q[c.FREE_RUNNING] if is_free(code) else st.q[c.RUNNING]
    st.live[r] = running > 0.0 and window[al.T] > 0.0


@kernel
def predict(st: c.BankState, r: int) -> float:
    """Return the force of row r at this instant, open loop, by its frozen parameters."""
    record = st.records[r]
    if record[sel.HAS_FROZEN] > 0.0:
        return predict_by(st, r, record[sel.FROZEN :])
    return predict_by(st, r, st.bank[r, at.THETA :])


@kernel
def predict_by(st: c.BankState, r: int, theta: Vector) -> float:
    """Return the force of row r at this instant by the parameters theta."""
    m = st.motion
    code, effects = st.codes[r], int(st.settings[c.N_EFFECTS])
    force = model_force(code, theta, m[c.MX], m[c.MV], m[c.MV_IN], m[c.MA])
    if code == rw.HUNT_CROSSLEY:
        return force + added_force(st)
    if st.frozen[r]:
        force += st.q[c.START_FORCE]
    else:
        for e in range(effects):
            force += theta[st.own[r] - effects + e] * st.terms[e]
    if st.active[r] > st.own[r]:
        force += theta[st.own[r]]
    return float(force)


@kernel
def possible_choice(st: c.BankState, r: int) -> int:
    """Return whether a row may be chosen: by readiness, and signs of its mass and stiffness.

    A free motion's row, which is ready in free air, must first have predicted a contact where the
    others are rows of contact.
    """
    code = st.codes[r]
    if st.bank[r, at.READY] == 0.0:
        return sel.IMPOSSIBLE
    if is_free(code):
        compared_s = st.records[r, sel.COMPARED] * st.settings[c.PERIOD]
        tried = st.settings[c.ONLY_FREE] > 0.0 or compared_s >= sel.LEAST_SCORED_S
        return sel.IDENTIFIED if tried and surely_positive(st, r, 0, NONE) else sel.IMPOSSIBLE
    place = 1 if code == rw.MASS_SPRING_DAMPER else 2 if code == rw.HUNT_CROSSLEY else 0
    if not surely_positive(st, r, place, place):
        return sel.IMPOSSIBLE
    if code != rw.MASS_SPRING_DAMPER:
        return sel.IDENTIFIED
    mass_known = deviation_known(st, r) and surely_positive(st, r, 0, place)
    return sel.IDENTIFIED if mass_known else sel.POSSIBLE


@kernel
def judge_row(st: c.BankState, r: int, judged: bool, compared: bool, force: float) -> None:
    """Predict with a row, and where it can be judged, score it against the force measured.

    `compared` where all rows that may be chosen are judged.
    """
    dt = st.settings[c.PERIOD]
    record = st.records[r]
    st.ready[r] = st.bank[r, at.READY] > 0.0
    st.possible[r] = possible_choice(st, r)
    predicted = predict(st, r)
    record[sel.PREDICTED] = predicted if math.isfinite(predicted) else 0.0
    if judged and record[sel.HAS_FROZEN] > 0.0:
        sel.score(record, force - record[sel.PREDICTED], compared, dt)


@kernel
def judge(st: c.BankState) -> None:
    """Predict with every row, score the rows, and choose the one to stream."""
    m = st.motion
    settled = st.q[c.SETTLED] >= st.settings[c.SETTLE_TICKS]
    free_settled = st.q[c.FREE_SETTLED] >= st.settings[c.SETTLE_TICKS]
    only_free = st.settings[c.ONLY_FREE] > 0.0
    for r in range(int(st.settings[c.N_ROWS])):
        code = st.codes[r]
        if code == rw.COMPANION:
            st.ready[r] = st.possible[r] = 0
        elif is_free(code):
            judge_row(st, r, free_settled, settled or only_free, m[c.M_FREE])
        else:
            judge_row(st, r, settled, settled, m[c.MF])
    if not (settled or (only_free and free_settled)):
        wa.interrupt(st.watch)
        return
    force = m[c.M_FREE] if only_free else m[c.MF]
    st.q[c.LEAST_FORCE] = min(st.q[c.LEAST_FORCE], force)
    st.q[c.LARGEST_FORCE] = max(st.q[c.LARGEST_FORCE], force)
    track_excursions(st, m[c.MX] * st.settings[c.LENGTH])
    rows = int(st.settings[c.N_ROWS])
    noise, dt = st.settings[c.NOISE], st.settings[c.PERIOD]
    watch_over(st, force)
    sel.choose(st.choice, st.records, st.possible[:rows], st.regressions, noise, dt)


@kernel
def watch_over(st: c.BankState, force: float) -> None:
    """Watch the residual of the selected row, by its present parameters.

    Frozen parameters are worse in the first seconds because of missing data, not of the model.
    """
    chosen = int(st.choice[sel.SELECTED])
    if chosen < 0 or st.records[chosen, sel.HAS_FROZEN] == 0.0:
        wa.interrupt(st.watch)
        return
    wa.turn_to(st.watch, chosen)
    q, resolution = st.q, st.detection[d.RESOLUTION]
    depth = max(abs(q[c.PENETRATION]), 100.0 * resolution)
    curved = st.codes[chosen] == rw.HUNT_CROSSLEY
    variance = resolution * resolution / 12.0 + d.surface_variance(st.detector, curved)
    by_position = abs(force) / depth * math.sqrt(variance)
    span = q[c.LARGEST_FORCE] - q[c.LEAST_FORCE]
    residual = force - predict_by(st, chosen, st.bank[chosen, at.THETA :])
    wa.judge_residual(
        st.watch, residual, st.settings[c.NOISE], by_position, span, st.settings[c.PERIOD]
    )


@kernel
def weigh_terms(st: c.BankState) -> None:
    """Sum up the additive effects' forces, and those of the rig, by what is known of them.

    That is the selected row's estimate where it is ready and not far from what it started with.
    """
    q, chosen = st.q, int(st.choice[sel.SELECTED])
    q[c.RIG_FORCE] = q[c.ADDED_FORCE] = q[c.START_FORCE] = 0.0
    effects = int(st.settings[c.N_EFFECTS])
    linear = chosen >= 0 and st.codes[chosen] != rw.HUNT_CROSSLEY and not st.frozen[chosen]
    for e in range(effects):
        share = st.starts[e]
        if linear and st.bank[chosen, at.READY] > 0.0:
            found = st.bank[chosen, at.THETA + st.own[chosen] - effects + e]
            share = found if abs(found - share) <= 1.0 else share
        q[c.START_FORCE] += st.starts[e] * st.terms[e]
        q[c.ADDED_FORCE] += share * st.terms[e]
        q[c.RIG_FORCE] += share * st.terms[e] * st.of_rig[e]


@kernel
def estimate(st: c.BankState, whole: at.Whole) -> None:
    """Advance all rows by the instant in `motion`, with the effects' values in `terms`."""
    q, settings, m = st.q, st.settings, st.motion
    if whole is not None and settings[c.N_EFFECTS] > 0.0:
        weigh_terms(st)
        integrate_filtered(st, q[c.ELAPSED])
    q[c.ELAPSED] = 0.0
    for r in range(int(st.settings[c.N_ROWS])):
        if whole is not None and st.regressions[r] != 0:
            fill_algebraic(st, r, st.phi[r])
        else:
            fill_direct(st, r, st.phi[r])
    rows = int(settings[c.N_ROWS])
    bank_step(st.bank, st.bank_settings, st.active, st.phi, st.y[:rows], st.lever, st.live, whole)
    if q[c.SETTLED] >= settings[c.SETTLE_TICKS]:
        x, v = m[c.MX] * settings[c.LENGTH], m[c.MV] * settings[c.SPEED]
        body = m[c.MF] - q[c.ADDED_FORCE]
        su.add_sample(st.sums, st.buffer, st.refit, x, v, body, 5.0 * settings[c.NOISE])
    judge(st)


@kernel
def tick(one: c.StateArray, position: float, force: float, valid: bool, whole: at.Whole) -> None:
    """Advance everything by one tick, where no effects are to be evaluated in between."""
    if sense(one[0], position, force, valid):
        estimate(one[0], whole)


@kernel
def sense_tick(one: c.StateArray, position: float, force: float, valid: bool) -> bool:
    """Do the first half of a tick; return whether the second half has anything to do."""
    return sense(one[0], position, force, valid)


@kernel
def estimate_tick(one: c.StateArray, whole: at.Whole) -> None:
    """Do the second half of a tick, after the effects have been evaluated."""
    estimate(one[0], whole)


@kernel
def keep(one: c.StateArray, signals: Vector, theta: Matrix, status: Vector) -> None:
    """Write the present state to one row of a trace: see `run_ticks`."""
    st = one[0]
    known = st.detector[d.SURFACE_KNOWN] > 0.0
    chosen = int(st.choice[sel.SELECTED])
    signals[0] = st.detector[d.IN_CONTACT]
    signals[1] = st.detector[d.CONTACT_ID]
    signals[2] = st.detector[d.SURFACE] if known else math.nan
    signals[3] = st.motion[c.MX] * st.settings[c.LENGTH]
    signals[4] = st.motion[c.MV] * st.settings[c.SPEED]
    signals[5] = chosen
    signals[6] = st.records[chosen, sel.PREDICTED] if chosen >= 0 else math.nan
    signals[7] = st.motion[c.MF]
    for r in range(theta.shape[0]):
        status[r] = st.bank[r, at.STATUS]
        for j in range(at.MAX_PARAMETERS):
            theta[r, j] = st.bank[r, at.THETA + j]


@kernel
def run_ticks(
    one: c.StateArray,
    position: Vector,
    force: Vector,
    valid: Flags,
    decimate: int,
    signals: Matrix,
    theta: NDArray[np.float64],
    status: Matrix,
    whole: at.Whole,
) -> None:
    """Run the very same tick over a recording, keeping every `decimate`-th state.

    signals (kept, 8): in contact, contact id, surface (NaN while unknown), penetration and
    velocity, selected row, its predicted force, force, all through one filter; theta (kept, rows,
    MAX_PARAMETERS) scaled; status (kept, rows).
    """
    for i in range(len(position)):
        tick(one, position[i], force[i], valid[i], whole)
        if (i + 1) % decimate == 0:
            k = (i + 1) // decimate - 1
            keep(one, signals[k], theta[k], status[k])
