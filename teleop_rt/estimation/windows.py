"""Staggered windows of the algebraic regressions: the older of two gives the regression.

t, with which the integrals grow, restarts at each contact, and again whenever a window ends; the
other one is then half a window old, so a regression is at hand all along.
"""

from __future__ import annotations

from teleop_rt.estimation import algebraic as al
from teleop_rt.estimation import state as c
from teleop_rt.jit import kernel


@kernel
def advance_contact_windows(
    st: c.BankState, pair: int, x: float, f: float, running: float, dt: float
) -> None:
    """Advance a pair of linear windows by one sample (x scaled); start it where not running."""
    half = 0.5 * st.settings[c.WINDOW]
    if running == 0.0:
        start_window(st, pair, x, f)
        st.windows[pair + 1, al.T] = -1.0
        return
    advance_window(st, pair, x, f, dt)
    if st.windows[pair + 1, al.T] >= 0.0:
        advance_window(st, pair + 1, x, f, dt)
    elif st.windows[pair, al.T] >= half:
        start_window(st, pair + 1, x, f)
    for k in range(pair, pair + 2):
        if st.windows[k, al.T] > 2.0 * half:
            start_window(st, k, x, f)


@kernel
def start_window(st: c.BankState, k: int, x: float, f: float) -> None:
    """Start window k, effects' integrals included."""
    al.start_linear(st.windows[k], x, f)
    for e in range(int(st.settings[c.N_EFFECTS])):
        al.start_term(st.term_windows[k, e], st.terms[e])


@kernel
def advance_window(st: c.BankState, k: int, x: float, f: float, dt: float) -> None:
    """Advance window k, effects' integrals included."""
    for e in range(int(st.settings[c.N_EFFECTS])):
        al.advance_term(st.term_windows[k, e], st.terms[e], st.windows[k, al.T], dt)
    al.advance_linear(st.windows[k], x, f, dt)


@kernel
def older_window(st: c.BankState, pair: int) -> int:
    """Return the window of a pair that gives the regression."""
    return pair if st.windows[pair, al.T] >= st.windows[pair + 1, al.T] else pair + 1


@kernel
def advance_log_pair(st: c.BankState, x: float, lx: float, lf: float, dt: float) -> None:
    """Advance the logarithmic windows by one sample (x scaled)."""
    half = 0.5 * st.settings[c.WINDOW]
    first, second = st.log_windows[0], st.log_windows[1]
    if st.q[c.LOG_RUNNING] == 0.0:
        al.start_log(first, x, lx, lf)
        second[al.L_T] = -1.0
        return
    al.advance_log(first, x, lx, lf, dt)
    if second[al.L_T] >= 0.0:
        al.advance_log(second, x, lx, lf, dt)
    elif first[al.L_T] >= half:
        al.start_log(second, x, lx, lf)
    if first[al.L_T] > 2.0 * half:
        al.start_log(first, x, lx, lf)
    if second[al.L_T] > 2.0 * half:
        al.start_log(second, x, lx, lf)
