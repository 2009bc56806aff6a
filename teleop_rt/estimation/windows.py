"""Staggered windows of the algebraic regressions: the older of two gives the regression.

t, with which the integrals grow, restarts at each contact, and again whenever a window ends; the
other one is then half a window old, so a regression is at hand all along.
"""

from __future__ import annotations

from teleop_rt.estimation import algebraic
from teleop_rt.estimation import state as index
from teleop_rt.kernels.jit import kernel


@kernel
def advance_contact_windows(
    state: index.BankState, pair: int, x: float, f: float, running: float, dt: float
) -> None:
    """Advance a pair of linear windows by one sample (x scaled); start it where not running."""
    half = 0.5 * state.settings[index.WINDOW]
    if running == 0.0:
        start_window(state, pair, x, f)
        state.windows[pair + 1, algebraic.T] = -1.0
        return
    advance_window(state, pair, x, f, dt)
    if state.windows[pair + 1, algebraic.T] >= 0.0:
        advance_window(state, pair + 1, x, f, dt)
    elif state.windows[pair, algebraic.T] >= half:
        start_window(state, pair + 1, x, f)
    for k in range(pair, pair + 2):
        if state.windows[k, algebraic.T] > 2.0 * half:
            start_window(state, k, x, f)


@kernel
def start_window(state: index.BankState, k: int, x: float, f: float) -> None:
    """Start window k, effects' integrals included."""
    algebraic.start_linear(state.windows[k], x, f)
    for e in range(int(state.settings[index.N_EFFECTS])):
        algebraic.start_term(state.term_windows[k, e], state.terms[e])


@kernel
def advance_window(state: index.BankState, k: int, x: float, f: float, dt: float) -> None:
    """Advance window k, effects' integrals included."""
    for e in range(int(state.settings[index.N_EFFECTS])):
        algebraic.advance_term(
            state.term_windows[k, e], state.terms[e], state.windows[k, algebraic.T], dt
        )
    algebraic.advance_linear(state.windows[k], x, f, dt)


@kernel
def older_window(state: index.BankState, pair: int) -> int:
    """Return the window of a pair that gives the regression."""
    return (
        pair
        if state.windows[pair, algebraic.T] >= state.windows[pair + 1, algebraic.T]
        else pair + 1
    )


@kernel
def advance_log_pair(state: index.BankState, x: float, lx: float, lf: float, dt: float) -> None:
    """Advance the logarithmic windows by one sample (x scaled)."""
    half = 0.5 * state.settings[index.WINDOW]
    first, second = state.log_windows[0], state.log_windows[1]
    if state.q[index.LOG_RUNNING] == 0.0:
        algebraic.start_log(first, x, lx, lf)
        second[algebraic.L_T] = -1.0
        return
    algebraic.advance_log(first, x, lx, lf, dt)
    if second[algebraic.L_T] >= 0.0:
        algebraic.advance_log(second, x, lx, lf, dt)
    elif first[algebraic.L_T] >= half:
        algebraic.start_log(second, x, lx, lf)
    if first[algebraic.L_T] > 2.0 * half:
        algebraic.start_log(first, x, lx, lf)
    if second[algebraic.L_T] > 2.0 * half:
        algebraic.start_log(second, x, lx, lf)
