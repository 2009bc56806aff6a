"""One tick of estimation as a kernel: align, detect, filter, regress, solve, choose."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact import detection as d
from teleop_rt.contact.effect import Vector
from teleop_rt.contact.surface import N_SUMS, add_sample, intercept_shift
from teleop_rt.estimation import algebraic as al
from teleop_rt.estimation import rows as rw
from teleop_rt.estimation import selection as sel
from teleop_rt.estimation import solvers as s
from teleop_rt.estimation.bank import bank_step, forget_row, reset_row
from teleop_rt.estimation.filters import (
    CURVATURE,
    RATE,
    VALUE,
    advance_channel,
    start_channel,
)
from teleop_rt.estimation.regressors import Motion, algebraic_row, direct_row, model_force
from teleop_rt.jit import kernel

Matrix = NDArray[np.float64]
Counts = NDArray[np.int64]
Flags = NDArray[np.bool_]

# Settings of the cycle.
(
    PERIOD,
    LENGTH,
    SPEED,
    ACCELERATION,
    POSITION_DELAY,
    FORCE_DELAY,
    SETTLE_TICKS,
    LARGEST_GAP,
    WINDOW,
    NOISE,
    RELEASE_LEVEL,
    STEP,
    N_CYCLE_SETTINGS,
) = range(13)

# State of the cycle.
(
    TIME,
    GAP,
    LAST_POSITION,
    LAST_FORCE,
    RING_NEXT,
    RING_FILLED,
    RUNNING,
    SETTLED,
    LOG_RUNNING,
    LOG_SETTLED,
    TRAVEL,
    PLAY,
    PENETRATION,
    VELOCITY,
    FORCE,
    DISCARDED,
    SURFACE_USED,
    EXTREME,
    DIRECTION,
    LOWEST,
    HIGHEST,
    EXCURSIONS,
    LEAST_FORCE,
    LARGEST_FORCE,
    LIVE,
    N_CYCLE,
) = range(26)

# Channels of the filter: position, one-way travel, force, ln x, ln f.
P, U, F, LX, LF, N_CHANNELS = range(6)
GATE_CLOSES, GATE_OPENS = 5.0, 6.0
LARGEST_SIGNAL = 1e9
LOG_FLOOR = 1e-3


class State(NamedTuple):
    """Everything that a tick reads and writes; shapes are fixed at start-up."""

    q: Vector
    settings: Vector
    detector: Vector
    detection: Vector
    rings: Matrix
    history: Matrix
    transition: Matrix
    before: Vector
    now: Vector
    channels: Matrix
    windows: Matrix
    log_windows: Matrix
    sums: Vector
    shift: Vector
    bank: Matrix
    bank_settings: Matrix
    active: Counts
    base: Counts
    codes: Counts
    regressions: Counts
    phi: Matrix
    y: Vector
    live: Flags
    ready: Flags
    records: Matrix
    choice: Vector


@kernel
def delayed(ring: Vector, newest: int, delay: float) -> float:
    """Return the ring's signal `delay` ticks before its newest sample, by interpolation."""
    size = len(ring)
    whole = int(delay)
    part = delay - whole
    late = ring[(newest - whole) % size]
    if part == 0.0:
        return float(late)
    return float(late + part * (ring[(newest - whole - 1) % size] - late))


@kernel
def restart_windows(st: State) -> None:
    """End the regressions' uninterrupted contact: filters and integrals start anew."""
    st.q[RUNNING] = 0.0
    st.q[SETTLED] = 0.0
    st.q[LOG_RUNNING] = 0.0
    st.q[LOG_SETTLED] = 0.0


@kernel
def forget_rows(st: State) -> None:
    """Discard the data of all rows that depend on the surface, keeping their estimates."""
    N = st.phi.shape[1]
    known = st.detector[d.SURFACE_KNOWN] > 0.0
    for r in range(len(st.codes)):
        linear = st.codes[r] != rw.HUNT_CROSSLEY
        n = st.base[r] + (1 if linear and not known else 0)
        if st.codes[r] == rw.MASS:
            continue
        if n == st.active[r]:
            forget_row(st.bank[r], st.bank_settings[r], n, N)
        else:
            st.active[r] = n
            reset_row(st.bank[r], st.bank_settings[r], n, N)
            for i in range(st.records.shape[1]):
                st.records[r, i] = 0.0


@kernel
def reference_surface(st: State) -> float:
    """Return where penetration is counted from: the surface, or the first sample without one."""
    if st.detector[d.SURFACE_KNOWN] > 0.0:
        return float(st.detector[d.SURFACE])
    return float(st.detector[d.ORIGIN])


@kernel
def use_surface(st: State) -> None:
    """Count penetration from the newest surface; data taken with another one are discarded."""
    surface = reference_surface(st)
    tolerance = 2.0 * st.detection[d.RESOLUTION]
    if abs(surface - st.q[SURFACE_USED]) > tolerance:
        st.q[SURFACE_USED] = surface
        forget_rows(st)


@kernel
def on_edge(st: State, event: int) -> None:
    """Handle the start or end of a contact."""
    if event == d.RELEASE and st.detector[d.SURFACE_FIXED] == 0.0:
        found = st.detector[d.SURFACE_KNOWN] > 0.0
        if found and intercept_shift(st.sums, st.settings[NOISE], st.shift):
            d.adopt_surface(
                st.detector, st.detection, st.q[SURFACE_USED] + st.shift[0], st.shift[1]
            )
    for i in range(N_SUMS):
        st.sums[i] = 0.0
    restart_windows(st)
    use_surface(st)
    if event == d.ONSET:
        end_excursion(st)
    st.q[DIRECTION] = 0.0


@kernel
def end_excursion(st: State) -> None:
    """Freeze what the rows know: the next predictions come from parameters this old."""
    N = st.phi.shape[1]
    st.q[EXCURSIONS] += 1.0
    for r in range(len(st.codes)):
        if st.bank[r, s.READY] > 0.0:
            sel.freeze(st.records[r], st.bank[r, s.N_SCALARS :], st.active[r], N)


@kernel
def track_excursions(st: State, x: float) -> None:
    """Notice the turning points of the motion; an excursion ends where penetration is least."""
    q = st.q
    if q[DIRECTION] == 0.0:
        q[DIRECTION], q[EXTREME], q[LOWEST], q[HIGHEST] = 1.0, x, x, x
    q[LOWEST] = min(q[LOWEST], x)
    q[HIGHEST] = max(q[HIGHEST], x)
    play = max(q[HIGHEST] - q[LOWEST], 100.0 * st.detection[d.RESOLUTION]) * 0.1
    if q[DIRECTION] > 0.0:
        q[EXTREME] = max(q[EXTREME], x)
        if x < q[EXTREME] - play:
            q[DIRECTION], q[EXTREME] = -1.0, x
    else:
        q[EXTREME] = min(q[EXTREME], x)
        if x > q[EXTREME] + play:
            q[DIRECTION], q[EXTREME] = 1.0, x
            end_excursion(st)


@kernel
def one_way_travel(q: Vector, position: float, resolution: float) -> float:
    """Return the travel into the environment so far, deaf to dither of one encoder step.

    Its derivative is max(v, 0): filtering it filters the regressor, not the position (2.2).
    """
    if position > q[PLAY]:
        q[TRAVEL] += position - q[PLAY]
        q[PLAY] = position
    elif position < q[PLAY] - resolution:
        q[PLAY] = position + resolution
    return float(q[TRAVEL])


@kernel
def advance_window_pair(st: State, x: float, f: float) -> None:
    """Advance the two staggered linear windows by one sample (x scaled)."""
    dt, half = st.settings[PERIOD], 0.5 * st.settings[WINDOW]
    first, second = st.windows[0], st.windows[1]
    if st.q[RUNNING] == 0.0:
        al.start_linear(first, x, f)
        second[al.T] = -1.0
        return
    al.advance_linear(first, x, f, dt)
    if second[al.T] >= 0.0:
        al.advance_linear(second, x, f, dt)
    elif first[al.T] >= half:
        al.start_linear(second, x, f)
    if first[al.T] > 2.0 * half:
        al.start_linear(first, x, f)
    if second[al.T] > 2.0 * half:
        al.start_linear(second, x, f)


@kernel
def advance_log_pair(st: State, x: float, lx: float, lf: float) -> None:
    """Advance the two staggered logarithmic windows by one sample (x scaled)."""
    dt, half = st.settings[PERIOD], 0.5 * st.settings[WINDOW]
    first, second = st.log_windows[0], st.log_windows[1]
    if st.q[LOG_RUNNING] == 0.0:
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


@kernel
def expected_force(st: State, x: float) -> float:
    """Return the force to judge logarithms by: predicted where a Hunt-Crossley row is ready.

    Gating on the measured force would truncate its noise and bias the logarithm.
    """
    q = st.q
    for r in range(len(st.codes)):
        if st.codes[r] == rw.HUNT_CROSSLEY and st.bank[r, s.READY] > 0.0:
            v = st.channels[P, RATE] / st.settings[SPEED]
            motion = Motion(x, v, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            return model_force(rw.HUNT_CROSSLEY, st.bank[r, s.N_SCALARS :], motion)
    return st.channels[F, VALUE] if q[RUNNING] > 0.0 else 0.0


@kernel
def advance_logarithms(st: State, x: float, f: float) -> None:
    """Filter and integrate ln x and ln f while the expected force is well above the noise."""
    q = st.q
    if st.detector[d.SURFACE_KNOWN] == 0.0:
        return
    level = GATE_CLOSES if q[LOG_RUNNING] > 0.0 else GATE_OPENS
    expected = expected_force(st, x)
    if x < LOG_FLOOR or not expected > level * st.settings[NOISE]:
        q[LOG_RUNNING] = 0.0
        q[LOG_SETTLED] = 0.0
        return
    lx = math.log(x)
    lf = math.log(max(f, st.settings[NOISE]))
    advance_log_pair(st, x, lx, lf)
    if q[LOG_RUNNING] == 0.0:
        start_channel(st.channels[LX], lx)
        start_channel(st.channels[LF], lf)
        q[LOG_RUNNING] = 1.0
    else:
        advance_channel(st.channels[LX], lx, st.transition, st.before, st.now)
        advance_channel(st.channels[LF], lf, st.transition, st.before, st.now)
        q[LOG_SETTLED] += 1.0


@kernel
def filter_signals(st: State, position: float, force: float) -> None:
    """Advance filters and integrals by one aligned sample."""
    q = st.q
    travel = one_way_travel(q, position, st.detection[d.RESOLUTION])
    advance_channel(st.channels[P], position, st.transition, st.before, st.now)
    advance_channel(st.channels[U], travel, st.transition, st.before, st.now)
    fixed = st.detector[d.SURFACE_FIXED] > 0.0
    pressing = st.detector[d.IN_CONTACT] > 0.0 and (fixed or force >= st.settings[RELEASE_LEVEL])
    if not pressing:
        # A force that the environment clamps at zero obeys no model.
        restart_windows(st)
        return
    x = (position - q[SURFACE_USED]) / st.settings[LENGTH]
    advance_window_pair(st, x, force)
    if q[RUNNING] == 0.0:
        start_channel(st.channels[F], force)
        q[RUNNING] = 1.0
    else:
        advance_channel(st.channels[F], force, st.transition, st.before, st.now)
        q[SETTLED] += 1.0
    advance_logarithms(st, x, force)


@kernel
def present_motion(st: State) -> Motion:
    """Return the filtered signals of this instant, scaled."""
    q, settings, c = st.q, st.settings, st.channels
    force = c[F, VALUE]
    return Motion(
        (c[P, VALUE] - q[SURFACE_USED]) / settings[LENGTH],
        c[P, RATE] / settings[SPEED],
        c[P, CURVATURE] / settings[ACCELERATION],
        c[U, RATE] / settings[SPEED],
        force,
        c[LX, VALUE],
        c[LF, VALUE],
        math.exp(min(max(c[LF, VALUE], -50.0), 50.0)),
    )


@kernel
def fill(st: State, motion: Motion) -> None:
    """Fill phi, y and live of every row for this instant."""
    settled = st.q[SETTLED] >= st.settings[SETTLE_TICKS]
    log_settled = st.q[LOG_SETTLED] >= st.settings[SETTLE_TICKS]
    time = st.settings[LENGTH] / st.settings[SPEED]
    older = 0 if st.windows[0, al.T] >= st.windows[1, al.T] else 1
    log_older = 0 if st.log_windows[0, al.L_T] >= st.log_windows[1, al.L_T] else 1
    for r in range(len(st.codes)):
        code = st.codes[r]
        phi = st.phi[r]
        log = code == rw.HUNT_CROSSLEY
        if st.regressions[r] == 0:
            st.live[r] = log_settled and settled if log else settled
            st.y[r] = direct_row(code, motion, phi)
            constant = 1.0
        else:
            window = st.windows[older]
            log_window = st.log_windows[log_older]
            st.live[r] = (
                st.q[LOG_RUNNING] > 0.0 and log_window[al.L_T] > 0.0
                if log
                else st.q[RUNNING] > 0.0 and window[al.T] > 0.0
            )
            st.y[r] = algebraic_row(code, window, log_window, phi, time)
            order = 1 if code == rw.KELVIN_VOIGT else 2
            constant = al.constant_regressor(window, order)
        if st.active[r] > st.base[r]:
            phi[st.base[r]] = constant


@kernel
def predict_and_choose(st: State, motion: Motion) -> None:
    """Predict the force open loop by frozen parameters, score it, and choose a row."""
    dt = st.settings[PERIOD]
    settled = st.q[SETTLED] >= st.settings[SETTLE_TICKS]
    for r in range(len(st.codes)):
        record = st.records[r]
        st.ready[r] = st.bank[r, s.READY] > 0.0
        known = record[sel.HAS_FROZEN] > 0.0
        frozen = record[sel.N_RECORD :] if known else st.bank[r, s.N_SCALARS :]
        force = model_force(st.codes[r], frozen, motion)
        if st.active[r] > st.base[r]:
            force += frozen[st.base[r]]
        record[sel.PREDICTED] = force if math.isfinite(force) else 0.0
        if settled and record[sel.HAS_FROZEN] > 0.0:
            sel.score(record, motion.force - record[sel.PREDICTED], dt)
        if st.live[r]:
            theta = st.bank[r, s.N_SCALARS :]
            log = st.codes[r] == rw.HUNT_CROSSLEY
            lead = 1 if st.codes[r] == rw.MASS_SPRING_DAMPER else 0
            band = sel.SETTLING_BAND * (1.0 if log else abs(theta[lead]))
            sel.settle(record, theta[lead], band, dt)
    if settled:
        st.q[LEAST_FORCE] = min(st.q[LEAST_FORCE], motion.force)
        st.q[LARGEST_FORCE] = max(st.q[LARGEST_FORCE], motion.force)
        sel.choose(st.choice, st.records, st.ready, dt)


@kernel
def sample_step(st: State, position: float, force: float) -> bool:
    """Take one sample, measured or interpolated across a gap; return whether it was aligned."""
    q = st.q
    size = st.rings.shape[1]
    newest = int(q[RING_NEXT])
    st.rings[0, newest] = position
    st.rings[1, newest] = force
    q[RING_NEXT] = (newest + 1) % size
    q[RING_FILLED] = min(q[RING_FILLED] + 1.0, size)
    q[TIME] += st.settings[PERIOD]
    if q[RING_FILLED] < size:
        return False
    p = delayed(st.rings[0], newest, st.settings[POSITION_DELAY])
    f = delayed(st.rings[1], newest, st.settings[FORCE_DELAY])
    first = st.detector[d.STARTED] == 0.0
    event = d.detect(st.detector, st.detection, st.history[0], st.history[1], p, f)
    if first:
        start_channel(st.channels[P], p)
        start_channel(st.channels[U], 0.0)
        q[PLAY] = p
        q[SURFACE_USED] = reference_surface(st)
    if event != d.NOTHING:
        on_edge(st, event)
    filter_signals(st, p, f)
    q[PENETRATION] = p - q[SURFACE_USED]
    q[VELOCITY] = st.channels[P, RATE]
    q[FORCE] = f
    return True


@kernel
def tick(st: State, position: float, force: float, valid: bool) -> None:
    """Advance everything by one tick; input that is not finite, or wild, counts as missing."""
    q = st.q
    sound = valid and abs(position) < LARGEST_SIGNAL and abs(force) < LARGEST_SIGNAL
    if not sound:
        q[GAP] += 1.0
        q[LIVE] = 0.0
        for r in range(len(st.codes)):
            st.live[r] = False
        return
    if q[GAP] > st.settings[LARGEST_GAP] or q[RING_FILLED] == 0.0:
        q[DISCARDED] += q[GAP]
        q[RING_FILLED] = 0.0
        restart_windows(st)
        start_channel(st.channels[P], position)
        start_channel(st.channels[U], q[TRAVEL])
        q[TIME] += q[GAP] * st.settings[PERIOD]
    else:
        missing = int(q[GAP])
        for j in range(missing):
            part = (j + 1.0) / (missing + 1.0)
            between = q[LAST_POSITION] + part * (position - q[LAST_POSITION])
            sample_step(st, between, q[LAST_FORCE] + part * (force - q[LAST_FORCE]))
    q[GAP] = 0.0
    q[LAST_POSITION] = position
    q[LAST_FORCE] = force
    if not sample_step(st, position, force):
        return
    motion = present_motion(st)
    fill(st, motion)
    bank_step(st.bank, st.bank_settings, st.active, st.phi, st.y, st.live)
    settled = q[SETTLED] >= st.settings[SETTLE_TICKS]
    q[LIVE] = 1.0 if settled else 0.0
    if settled:
        scale = st.settings[LENGTH]
        add_sample(st.sums, motion.x * scale, motion.v * st.settings[SPEED], motion.force)
        track_excursions(st, motion.x * scale)
    predict_and_choose(st, motion)


@kernel
def run_ticks(
    st: State,
    position: Vector,
    force: Vector,
    valid: Flags,
    decimate: int,
    signals: Matrix,
    theta: NDArray[np.float64],
    status: Matrix,
) -> None:
    """Run the very same tick over a recording, writing every `decimate`-th state to the traces.

    signals (kept, 8): in contact, contact id, surface (NaN while unknown), penetration,
    velocity, selected, predicted force of the selected row, force; theta (kept, rows, N) scaled;
    status (kept, rows).
    """
    rows, N = st.phi.shape
    for i in range(len(position)):
        tick(st, position[i], force[i], valid[i])
        if (i + 1) % decimate == 0:
            kept = (i + 1) // decimate - 1
            known = st.detector[d.SURFACE_KNOWN] > 0.0
            chosen = int(st.choice[sel.SELECTED])
            signals[kept, 0] = st.detector[d.IN_CONTACT]
            signals[kept, 1] = st.detector[d.CONTACT_ID]
            signals[kept, 2] = st.detector[d.SURFACE] if known else math.nan
            signals[kept, 3] = st.q[PENETRATION]
            signals[kept, 4] = st.q[VELOCITY]
            signals[kept, 5] = chosen
            signals[kept, 6] = st.records[chosen, sel.PREDICTED] if chosen >= 0 else math.nan
            signals[kept, 7] = st.q[FORCE]
            for r in range(rows):
                status[kept, r] = st.bank[r, s.STATUS]
                for j in range(N):
                    theta[kept, r, j] = st.bank[r, s.N_SCALARS + j]
