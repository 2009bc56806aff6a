"""The equations of the bank's rows in a tick: integrals, regressors, and the force they predict."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import algebraic, layout, selection
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import state as index
from teleop_rt.estimation.regressors import algebraic_row, by_surface, direct_row, model_force
from teleop_rt.estimation.sensing import log_gate
from teleop_rt.estimation.windows import advance_contact_windows, advance_log_pair, older_window
from teleop_rt.kernels.jit import kernel

Matrix = NDArray[np.float64]
Flags = NDArray[np.bool_]


@kernel
def is_free(code: int) -> bool:
    """Return whether a model needs no contact."""
    return code in (row_kinds.MASS, row_kinds.MASS_DAMPER)


@kernel
def integrate_filtered(state: index.BankState, dt: float) -> None:
    """Integrate with effects: filtered signals, so that the effects' lag is everybody's."""
    q, m = state.q, state.motion
    if (
        state.settings[index.ANY_FREE] > 0.0
        and q[index.FREE_SETTLED] >= state.settings[index.SETTLE_TICKS]
    ):
        running = 1.0 if state.windows[index.FREE_PAIR, algebraic.T] >= 0.0 else 0.0
        advance_contact_windows(state, index.FREE_PAIR, m[index.MX], m[index.M_FREE], running, dt)
    else:
        state.windows[index.FREE_PAIR, algebraic.T] = -1.0
    if q[index.SETTLED] < state.settings[index.SETTLE_TICKS]:
        state.windows[index.CONTACT_PAIR, algebraic.T] = -1.0
        q[index.LOG_RUNNING] = q[index.LOG_SETTLED] = 0.0
        return
    running = 1.0 if state.windows[index.CONTACT_PAIR, algebraic.T] >= 0.0 else 0.0
    advance_contact_windows(state, index.CONTACT_PAIR, m[index.MX], m[index.MF], running, dt)
    if not log_gate(state, m[index.MX]):
        return
    force = m[index.MF] - added_force(state)
    m[index.M_LOG_X] = math.log(m[index.MX])
    m[index.M_WEIGHT] = max(force, state.settings[index.NOISE])
    m[index.M_LOG_F] = math.log(m[index.M_WEIGHT])
    advance_log_pair(state, m[index.MX], m[index.M_LOG_X], m[index.M_LOG_F], dt)
    q[index.LOG_RUNNING] = 1.0
    q[index.LOG_SETTLED] = state.settings[index.SETTLE_TICKS]


@kernel
def added_force(state: index.BankState) -> float:
    """Return the present estimate of the additive effects' force, by the companion row.

    The logarithm of Hunt-Crossley admits no additive term: the companion fits the form that is
    linear in k, b and the effects at the exponent found, and its effects leave the force.
    """
    last = int(state.settings[index.N_ROWS]) - 1
    if state.codes[last] == row_kinds.COMPANION and state.bank[last, layout.READY] == 0.0:
        return float(state.q[index.START_FORCE])
    total = 0.0
    if state.codes[last] == row_kinds.COMPANION and state.bank[last, layout.READY] > 0.0:
        for e in range(int(state.settings[index.N_EFFECTS])):
            total += state.bank[last, layout.THETA + 2 + e] * state.terms[e]
    return total


@kernel
def fill_companion(state: index.BankState, r: int, phi: Vector) -> bool:
    """Fill the companion's phi = [x^n, x^n v, effects] and y; return whether n is known."""
    m = state.motion
    for h in range(r):
        if (
            state.codes[h] == row_kinds.HUNT_CROSSLEY
            and state.bank[h, layout.READY] > 0.0
            and m[index.MX] > 0.0
        ):
            exponent = min(max(state.bank[h, layout.THETA + 2], 0.1), 10.0)
            phi[0] = math.pow(m[index.MX], exponent)
            phi[1] = phi[0] * m[index.MV]
            for e in range(int(state.settings[index.N_EFFECTS])):
                phi[2 + e] = state.terms[e]
            state.y[r] = m[index.MF]
            return True
    return False


@kernel
def fill_direct(state: index.BankState, r: int, phi: Vector) -> None:
    """Fill phi, y and live of a direct row for this instant."""
    settled = state.q[index.SETTLED] >= state.settings[index.SETTLE_TICKS]
    code = state.codes[r]
    if code == row_kinds.COMPANION:
        state.live[r] = settled and fill_companion(state, r, phi)
        return
    state.y[r] = direct_row(code, state.motion, phi)
    state.lever[r] = by_surface(code, state.motion)
    if code == row_kinds.HUNT_CROSSLEY:
        state.live[r] = settled and state.q[index.LOG_SETTLED] >= state.settings[index.SETTLE_TICKS]
        return
    if state.frozen[r]:
        state.y[r] -= state.q[index.START_FORCE]
    else:
        effects = int(state.settings[index.N_EFFECTS])
        for e in range(effects):
            phi[state.own[r] - effects + e] = state.terms[e]
    if state.active[r] > state.own[r]:
        phi[state.own[r]] = 1.0
    free = state.q[index.FREE_SETTLED] >= state.settings[index.SETTLE_TICKS]
    state.live[r] = free if is_free(code) else settled


@kernel
def fill_algebraic(state: index.BankState, r: int, phi: Vector) -> None:
    """Fill phi, y and live of an algebraic row for this instant."""
    code = state.codes[r]
    time = state.settings[index.LENGTH] / state.settings[index.SPEED]
    k = older_window(state, index.FREE_PAIR if is_free(code) else index.CONTACT_PAIR)
    log_k = 0 if state.log_windows[0, algebraic.L_T] >= state.log_windows[1, algebraic.L_T] else 1
    window, log_window = state.windows[k], state.log_windows[log_k]
    state.y[r] = algebraic_row(code, window, log_window, phi, time)
    if code == row_kinds.HUNT_CROSSLEY:
        state.live[r] = state.q[index.LOG_RUNNING] > 0.0 and log_window[algebraic.L_T] > 0.0
        return
    slot = algebraic.J_TP if code == row_kinds.KELVIN_VOIGT else algebraic.JJ_T2P
    effects = int(state.settings[index.N_EFFECTS])
    for e in range(effects):
        if state.frozen[r]:
            state.y[r] -= state.starts[e] * state.term_windows[k, e, slot]
        else:
            phi[state.own[r] - effects + e] = state.term_windows[k, e, slot]
    if state.active[r] > state.own[r]:
        phi[state.own[r]] = algebraic.constant_regressor(
            window, 1 if code == row_kinds.KELVIN_VOIGT else 2
        )
    running = state.q[index.FREE_RUNNING] if is_free(code) else state.q[index.RUNNING]
    state.live[r] = running > 0.0 and window[algebraic.T] > 0.0


@kernel
def predict(state: index.BankState, r: int) -> float:
    """Return the force of row r at this instant, open loop, by its frozen parameters."""
    record = state.records[r]
    if record[selection.HAS_FROZEN] > 0.0:
        return predict_by(state, r, record[selection.FROZEN :])
    return predict_by(state, r, state.bank[r, layout.THETA :])


@kernel
def predict_by(state: index.BankState, r: int, theta: Vector) -> float:
    """Return the force of row r at this instant by the parameters theta."""
    m = state.motion
    code, effects = state.codes[r], int(state.settings[index.N_EFFECTS])
    force = model_force(code, theta, m[index.MX], m[index.MV], m[index.MV_IN], m[index.MA])
    if code == row_kinds.HUNT_CROSSLEY:
        return force + added_force(state)
    if state.frozen[r]:
        force += state.q[index.START_FORCE]
    else:
        for e in range(effects):
            force += theta[state.own[r] - effects + e] * state.terms[e]
    if state.active[r] > state.own[r]:
        force += theta[state.own[r]]
    return float(force)
