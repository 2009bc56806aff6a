"""The first half of a tick: align, detect contact, filter, keep the refit of the surface going."""

from __future__ import annotations

import math

from teleop_rt.contact import detection as d
from teleop_rt.contact import surface as su
from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import layout as at
from teleop_rt.estimation import rows as rw
from teleop_rt.estimation import selection as sel
from teleop_rt.estimation import state as c
from teleop_rt.estimation import watch as wa
from teleop_rt.estimation.bank_kernels import forget_row, reset_row, soften_row
from teleop_rt.estimation.filters import (
    CURVATURE,
    RATE,
    VALUE,
    advance_channel,
    longest_line,
    push,
    start_channel,
    window_channel,
)
from teleop_rt.estimation.regressors import model_force
from teleop_rt.estimation.windows import advance_contact_windows, advance_log_pair
from teleop_rt.jit import kernel

GATE_CLOSES, GATE_OPENS = 5.0, 6.0
LOG_FLOOR = 1e-3
CANDIDATE_S = 1e-3
"""Time for each candidate surface: all are tried before a tool that lifted off comes again."""


@kernel
def delayed(ring: Vector, size: int, newest: int, delay: float) -> float:
    """Return a ring's signal `delay` ticks before its newest sample, by interpolation."""
    whole = int(delay)
    part = delay - whole
    late = ring[(newest - whole) % size]
    if part == 0.0:
        return float(late)
    return float(late + part * (ring[(newest - whole - 1) % size] - late))


@kernel
def restart_contact(st: c.BankState) -> None:
    """End the regressions' uninterrupted contact: filters and integrals are reset."""
    st.q[c.RUNNING] = st.q[c.SETTLED] = 0.0
    st.q[c.LOG_RUNNING] = st.q[c.LOG_SETTLED] = 0.0


@kernel
def forget_rows(st: c.BankState) -> None:
    """Discard the data of all rows that depend on the surface, keeping their estimates."""
    known = st.detector[d.SURFACE_KNOWN] > 0.0
    for r in range(int(st.settings[c.N_ROWS])):
        if st.codes[r] == rw.MASS or st.codes[r] == rw.MASS_DAMPER:
            continue
        offset = st.codes[r] < rw.HUNT_CROSSLEY and not known
        n = st.own[r] + (1 if offset else 0)
        if n == st.active[r]:
            forget_row(st.bank[r], st.bank_settings[r], n)
        else:
            st.active[r] = n
            reset_row(st.bank[r], st.bank_settings[r], n)
            for i in range(st.records.shape[1]):
                st.records[r, i] = 0.0


@kernel
def soften_rows(st: c.BankState, shift: float) -> None:
    """Lower the trust of all rows in data taken with a surface that was off by `shift`.

    That error of force stands on each parameter: shift times stiffness, the last contact's secant.
    """
    secant = st.sums[su.XF] / max(st.sums[su.XX], 1e-30)
    error = secant * shift / st.settings[c.NOISE]
    for r in range(int(st.settings[c.N_ROWS])):
        if st.codes[r] != rw.MASS and st.codes[r] != rw.MASS_DAMPER:
            soften_row(st.bank[r], st.bank_settings[r], error * error, st.active[r])


@kernel
def use_surface(st: c.BankState) -> None:
    """Count penetration from the newest surface, or from the first sample while there is none.

    Data taken with a surface a little off are trusted less, with one far off not at all.
    """
    known = st.detector[d.SURFACE_KNOWN] > 0.0
    surface = st.detector[d.SURFACE] if known else st.detector[d.ORIGIN]
    shift = abs(surface - st.q[c.SURFACE_USED])
    if shift == 0.0:
        return
    st.q[c.SURFACE_USED] = surface
    if shift > d.MOVED_RESOLUTIONS * st.detection[d.RESOLUTION] or st.sums[su.N] == 0.0:
        forget_rows(st)
    else:
        soften_rows(st, shift)


@kernel
def end_excursion(st: c.BankState) -> None:
    """Freeze the rows' parameters for the next predictions.

    When a row predicts for the first time, the comparison of all rows restarts: a late row would
    otherwise be spared the errors of the first excursions.
    """
    st.q[c.EXCURSIONS] += 1.0
    rows = int(st.settings[c.N_ROWS])
    another = False
    for r in range(rows):
        if st.bank[r, at.READY] > 0.0:
            before = st.records[r, sel.HAS_FROZEN]
            sel.freeze(st.records[r], st.bank[r], st.active[r])
            another = another or st.records[r, sel.HAS_FROZEN] > before
    if another:
        for r in range(rows):
            st.records[r, sel.COMPARED] = 0.0


@kernel
def on_edge(st: c.BankState, event: int) -> None:
    """Handle the start or end of a contact."""
    restart_contact(st)
    st.q[c.DIRECTION] = 0.0
    if event == d.RELEASE:
        known = st.detector[d.SURFACE_KNOWN] > 0.0 and st.detector[d.SURFACE_FIXED] == 0.0
        # No line through a body that remembers leads to its surface.
        if known and st.detection[d.LETS_GO] == 0.0:
            su.fit_line(st.sums, st.refit, st.settings[c.NOISE])
            su.start_search(st.buffer, st.refit, st.detection[d.RESOLUTION])
        return
    use_surface(st)
    su.forget_contact(st.sums, st.refit)
    end_excursion(st)


@kernel
def refit_surface(st: c.BankState) -> None:
    """Go on with the refit that the last contact's end began, one candidate per millisecond.

    What it finds counts from the next contact on, which may come soon.
    """
    if st.refit[su.STEP] == su.IDLE:
        return
    for _ in range(max(1, round(st.settings[c.PERIOD] / CANDIDATE_S))):
        if st.refit[su.STEP] >= su.DONE:
            break
        su.search_step(st.buffer, st.refit)
    else:
        return
    st.refit[su.STEP] = su.IDLE
    air = d.last_in_air(st.detector) - st.q[c.SURFACE_USED]
    if su.choose_surface(st.buffer, st.refit, air, st.detection[d.ONSET_FORCE]):
        found = st.q[c.SURFACE_USED] + st.refit[su.FOUND]
        d.refine_surface(st.detector, st.detection, found, st.refit[su.FOUND_VARIANCE])


@kernel
def one_way_travel(q: Vector, position: float, resolution: float) -> float:
    """Return the travel into the environment so far, deaf to dither of one encoder step.

    Its derivative is max(v, 0): filtering it filters the regressor, not the position (2.2).
    """
    if position > q[c.PLAY]:
        q[c.TRAVEL] += position - q[c.PLAY]
        q[c.PLAY] = position
    elif position < q[c.PLAY] - resolution:
        q[c.PLAY] = position + resolution
    return float(q[c.TRAVEL])


@kernel
def start(st: c.BankState, channel: int, u: float) -> None:
    """Start a channel of the filter at rest."""
    size = 2 * int(st.settings[c.FOAW_WINDOW]) + 1
    start_channel(st.channels[channel], st.foaw[channel], size, u)


@kernel
def advance(st: c.BankState, channel: int, u: float) -> None:
    """Advance a channel of the filter; with FOAW the position's window serves all."""
    longest = int(st.settings[c.FOAW_WINDOW])
    if longest == 0:
        advance_channel(st.channels[channel], u, st.transition, st.before, st.now)
        return
    push(st.foaw[channel], 2 * longest + 1, u)
    n = longest_line(st.foaw[c.P], longest, st.detection[d.RESOLUTION])
    window_channel(st.channels[channel], st.foaw[channel], n, st.settings[c.PERIOD])


@kernel
def expected_force(st: c.BankState, x: float) -> float:
    """Return the force to judge logarithms by: predicted where a Hunt-Crossley row is ready.

    Gating on the measured force would truncate its noise and bias the logarithm.
    """
    for r in range(int(st.settings[c.N_ROWS])):
        if st.codes[r] == rw.HUNT_CROSSLEY and st.bank[r, at.READY] > 0.0:
            v = st.channels[c.P, RATE] / st.settings[c.SPEED]
            theta = st.bank[r, at.THETA :]
            return model_force(rw.HUNT_CROSSLEY, theta, x, v, 0.0, 0.0)
    return float(st.channels[c.F, VALUE]) if st.q[c.RUNNING] > 0.0 else 0.0


@kernel
def log_gate(st: c.BankState, x: float) -> bool:
    """Return whether logarithms may be taken: surface known, expected force far above noise."""
    running = st.q[c.LOG_RUNNING] > 0.0
    level = GATE_CLOSES if running else GATE_OPENS
    known = st.detector[d.SURFACE_KNOWN] > 0.0
    inside = known and x > LOG_FLOOR
    is_open = inside and expected_force(st, x) > level * st.settings[c.NOISE]
    if not is_open:
        st.q[c.LOG_RUNNING] = st.q[c.LOG_SETTLED] = 0.0
    return is_open


@kernel
def advance_logarithms(st: c.BankState, x: float, f: float) -> None:
    """Filter and integrate ln x and ln f while the gate is open (x scaled)."""
    if not log_gate(st, x):
        return
    lx = math.log(x)
    lf = math.log(max(f, st.settings[c.NOISE]))
    advance_log_pair(st, x, lx, lf, st.settings[c.PERIOD])
    if st.q[c.LOG_RUNNING] == 0.0:
        start(st, c.LX, lx)
        start(st, c.LF, lf)
        st.q[c.LOG_RUNNING] = 1.0
    else:
        advance(st, c.LX, lx)
        advance(st, c.LF, lf)
        st.q[c.LOG_SETTLED] += 1.0


@kernel
def filter_signals(st: c.BankState, position: float, force: float) -> None:
    """Advance filters, and where no effects wait for filtered signals, integrals."""
    q = st.q
    plain = st.settings[c.N_EFFECTS] == 0.0
    x = (position - q[c.SURFACE_USED]) / st.settings[c.LENGTH]
    advance(st, c.P, position)
    advance(st, c.U, one_way_travel(q, position, st.detection[d.RESOLUTION]))
    if st.settings[c.ANY_FREE] > 0.0:
        if q[c.FREE_RUNNING] > 0.0:
            advance(st, c.FREE, force)
            q[c.FREE_SETTLED] += 1.0
        else:
            start(st, c.FREE, force)
        if plain:
            advance_contact_windows(
                st, c.FREE_PAIR, x, force, q[c.FREE_RUNNING], st.settings[c.PERIOD]
            )
        q[c.FREE_RUNNING] = 1.0
    fixed = st.detector[d.SURFACE_FIXED] > 0.0
    net = force - q[c.RIG_FORCE]
    pressing = st.detector[d.IN_CONTACT] > 0.0 and (fixed or net >= st.settings[c.RELEASE_LEVEL])
    if not pressing:
        # A force that the environment clamps at zero obeys no model.
        restart_contact(st)
        return
    if plain:
        advance_contact_windows(st, c.CONTACT_PAIR, x, force, q[c.RUNNING], st.settings[c.PERIOD])
    if q[c.RUNNING] == 0.0:
        start(st, c.F, force)
        q[c.RUNNING] = 1.0
    else:
        advance(st, c.F, force)
        q[c.SETTLED] += 1.0
    if plain:
        advance_logarithms(st, x, force)


@kernel
def set_motion(st: c.BankState) -> None:
    """Put the filtered signals of this instant into `motion`, scaled."""
    m, settings, ch = st.motion, st.settings, st.channels
    m[c.MX] = (ch[c.P, VALUE] - st.q[c.SURFACE_USED]) / settings[c.LENGTH]
    m[c.MV] = ch[c.P, RATE] / settings[c.SPEED]
    m[c.MA] = ch[c.P, CURVATURE] / settings[c.ACCELERATION]
    m[c.MV_IN] = ch[c.U, RATE] / settings[c.SPEED]
    m[c.MF] = ch[c.F, VALUE]
    m[c.M_FREE] = ch[c.FREE, VALUE]
    m[c.M_LOG_X] = ch[c.LX, VALUE]
    m[c.M_LOG_F] = ch[c.LF, VALUE]
    m[c.M_WEIGHT] = math.exp(min(max(m[c.M_LOG_F], -50.0), 50.0))


@kernel
def sample_step(st: c.BankState, position: float, force: float) -> bool:
    """Take one sample, measured or interpolated across a gap; return whether it was aligned."""
    q = st.q
    size = int(st.settings[c.RING])
    newest = int(q[c.RING_NEXT])
    st.rings[0, newest] = position
    st.rings[1, newest] = force
    q[c.RING_NEXT] = (newest + 1) % size
    q[c.RING_FILLED] = min(q[c.RING_FILLED] + 1.0, size)
    q[c.TIME] += st.settings[c.PERIOD]
    if q[c.RING_FILLED] < size:
        return False
    p = delayed(st.rings[0], size, newest, st.settings[c.POSITION_DELAY])
    f = delayed(st.rings[1], size, newest, st.settings[c.FORCE_DELAY])
    if st.detector[d.STARTED] == 0.0:
        start(st, c.P, p)
        start(st, c.U, 0.0)
        q[c.PLAY] = p
        q[c.SURFACE_USED] = st.detector[d.SURFACE] if st.detector[d.SURFACE_KNOWN] > 0.0 else p
    net = f - q[c.RIG_FORCE]
    event = d.detect(st.detector, st.detection, st.history[0], st.history[1], p, net)
    if event != d.NOTHING:
        on_edge(st, event)
    refit_surface(st)
    filter_signals(st, p, f)
    q[c.PENETRATION] = p - q[c.SURFACE_USED]
    q[c.VELOCITY] = st.channels[c.P, RATE]
    q[c.FORCE] = f
    return True


@kernel
def bridge_gap(st: c.BankState, position: float, force: float) -> None:
    """Fill a short gap by interpolation, or start over after a long one."""
    q = st.q
    missing = int(q[c.GAP])
    if missing <= st.settings[c.LARGEST_GAP] and q[c.RING_FILLED] > 0.0:
        for j in range(missing):
            part = (j + 1.0) / (missing + 1.0)
            between = q[c.LAST_POSITION] + part * (position - q[c.LAST_POSITION])
            sample_step(st, between, q[c.LAST_FORCE] + part * (force - q[c.LAST_FORCE]))
        return
    q[c.DISCARDED] += missing
    q[c.RING_FILLED] = 0.0
    q[c.FREE_RUNNING] = q[c.FREE_SETTLED] = 0.0
    restart_contact(st)
    start(st, c.P, position)
    start(st, c.U, q[c.TRAVEL])
    q[c.PLAY] = position
    q[c.TIME] += missing * st.settings[c.PERIOD]


@kernel
def sense(st: c.BankState, position: float, force: float, valid: bool) -> bool:
    """Take one tick's sample; return whether there is a new instant to estimate from.

    Input that is not finite, or wild, counts as missing.
    """
    q = st.q
    q[c.ELAPSED] += st.settings[c.PERIOD]
    if not (valid and abs(position) < 1e9 and abs(force) < 1e9):
        q[c.GAP] += 1.0
        for r in range(int(st.settings[c.N_ROWS])):
            st.live[r] = 0
        return False
    if q[c.GAP] > 0.0:
        bridge_gap(st, position, force)
    else:
        wa.listen(st.watch, force)
    q[c.GAP] = 0.0
    q[c.LAST_POSITION] = position
    q[c.LAST_FORCE] = force
    if not sample_step(st, position, force):
        return False
    set_motion(st)
    return True
