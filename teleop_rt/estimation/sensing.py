"""The first half of a tick: align, detect contact, filter, keep the refit of the surface going."""

from __future__ import annotations

import math

from teleop_rt.contact import detection
from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import layout, watch
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import state as index
from teleop_rt.estimation.contact_edges import (
    on_edge,
    one_way_travel,
    refit_surface,
    restart_contact,
)
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
from teleop_rt.kernels.jit import kernel

GATE_CLOSES, GATE_OPENS = 5.0, 6.0
"""Expected force [deviations of noise] below which logarithms end, and above which they begin."""
LOG_FLOOR = 1e-3
"""Least penetration, scaled, whose logarithm is used."""


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
def start(state: index.BankState, channel: int, u: float) -> None:
    """Start a channel of the filter at rest."""
    size = 2 * int(state.settings[index.FOAW_WINDOW]) + 1
    start_channel(state.channels[channel], state.foaw[channel], size, u)


@kernel
def advance(state: index.BankState, channel: int, u: float) -> None:
    """Advance a channel of the filter; with FOAW the position's window serves all."""
    longest = int(state.settings[index.FOAW_WINDOW])
    if longest == 0:
        advance_channel(state.channels[channel], u, state.transition, state.before, state.now)
        return
    push(state.foaw[channel], 2 * longest + 1, u)
    n = longest_line(state.foaw[index.P], longest, state.detection[detection.RESOLUTION])
    window_channel(state.channels[channel], state.foaw[channel], n, state.settings[index.PERIOD])


@kernel
def expected_force(state: index.BankState, x: float) -> float:
    """Return the force to judge logarithms by: predicted where a Hunt-Crossley row is ready.

    Gating on the measured force would truncate its noise and bias the logarithm. A row whose
    exponent is not positive is not asked: a rest just inside the surface leaves such a one now and
    then. It expects less force the deeper the tool is, so the gate would stay closed, and the row
    never learn better.
    """
    for r in range(int(state.settings[index.N_ROWS])):
        if state.codes[r] == row_kinds.HUNT_CROSSLEY and state.bank[r, layout.READY] > 0.0:
            v = state.channels[index.P, RATE] / state.settings[index.SPEED]
            theta = state.bank[r, layout.THETA :]
            if theta[2] <= 0.0:
                continue
            return model_force(row_kinds.HUNT_CROSSLEY, theta, x, v, 0.0, 0.0)
    return float(state.channels[index.F, VALUE]) if state.q[index.RUNNING] > 0.0 else 0.0


@kernel
def log_gate(state: index.BankState, x: float) -> bool:
    """Return whether logarithms may be taken: surface known, expected force far above noise."""
    running = state.q[index.LOG_RUNNING] > 0.0
    level = GATE_CLOSES if running else GATE_OPENS
    known = state.detector[detection.SURFACE_KNOWN] > 0.0
    inside = known and x > LOG_FLOOR
    is_open = inside and expected_force(state, x) > level * state.settings[index.NOISE]
    if not is_open:
        state.q[index.LOG_RUNNING] = state.q[index.LOG_SETTLED] = 0.0
    return is_open


@kernel
def advance_logarithms(state: index.BankState, x: float, f: float) -> None:
    """Filter and integrate ln x and ln f while the gate is open (x scaled)."""
    if not log_gate(state, x):
        return
    lx = math.log(x)
    lf = math.log(max(f, state.settings[index.NOISE]))
    advance_log_pair(state, x, lx, lf, state.settings[index.PERIOD])
    if state.q[index.LOG_RUNNING] == 0.0:
        start(state, index.LX, lx)
        start(state, index.LF, lf)
        state.q[index.LOG_RUNNING] = 1.0
    else:
        advance(state, index.LX, lx)
        advance(state, index.LF, lf)
        state.q[index.LOG_SETTLED] += 1.0


@kernel
def filter_free(state: index.BankState, x: float, force: float) -> None:
    """Advance the signals of the models with a free offset: in contact and out of it (x scaled)."""
    q = state.q
    if q[index.FREE_RUNNING] > 0.0:
        advance(state, index.FREE, force)
        q[index.FREE_SETTLED] += 1.0
    else:
        start(state, index.FREE, force)
    if state.settings[index.N_EFFECTS] == 0.0:
        advance_contact_windows(
            state, index.FREE_PAIR, x, force, q[index.FREE_RUNNING], state.settings[index.PERIOD]
        )
    q[index.FREE_RUNNING] = 1.0


@kernel
def filter_signals(state: index.BankState, position: float, force: float) -> None:
    """Advance filters, and where no effects wait for filtered signals, integrals."""
    q = state.q
    plain = state.settings[index.N_EFFECTS] == 0.0
    x = (position - q[index.SURFACE_USED]) / state.settings[index.LENGTH]
    advance(state, index.P, position)
    advance(state, index.U, one_way_travel(q, position, state.detection[detection.RESOLUTION]))
    if state.settings[index.ANY_FREE] > 0.0:
        filter_free(state, x, force)
    fixed = state.detector[detection.SURFACE_FIXED] > 0.0
    net = force - q[index.RIG_FORCE]
    pressing = state.detector[detection.IN_CONTACT] > 0.0 and (
        fixed or net >= state.settings[index.RELEASE_LEVEL]
    )
    if not pressing:
        # A force that the environment clamps at zero obeys no model.
        restart_contact(state)
        return
    if plain:
        advance_contact_windows(
            state, index.CONTACT_PAIR, x, force, q[index.RUNNING], state.settings[index.PERIOD]
        )
    if q[index.RUNNING] == 0.0:
        start(state, index.F, force)
        q[index.RUNNING] = 1.0
    else:
        advance(state, index.F, force)
        q[index.SETTLED] += 1.0
    if plain:
        advance_logarithms(state, x, force)


@kernel
def set_motion(state: index.BankState) -> None:
    """Put the filtered signals of this instant into `motion`, scaled."""
    m, settings, ch = state.motion, state.settings, state.channels
    m[index.MX] = (ch[index.P, VALUE] - state.q[index.SURFACE_USED]) / settings[index.LENGTH]
    m[index.MV] = ch[index.P, RATE] / settings[index.SPEED]
    m[index.MA] = ch[index.P, CURVATURE] / settings[index.ACCELERATION]
    m[index.MV_IN] = ch[index.U, RATE] / settings[index.SPEED]
    m[index.MF] = ch[index.F, VALUE]
    m[index.M_FREE] = ch[index.FREE, VALUE]
    m[index.M_LOG_X] = ch[index.LX, VALUE]
    m[index.M_LOG_F] = ch[index.LF, VALUE]
    m[index.M_WEIGHT] = math.exp(min(max(m[index.M_LOG_F], -50.0), 50.0))


@kernel
def sample_step(state: index.BankState, position: float, force: float, measured: bool) -> bool:
    """Take one sample, `measured` or interpolated across a gap; return whether it was aligned."""
    q = state.q
    size = int(state.settings[index.RING])
    newest = int(q[index.RING_NEXT])
    state.rings[0, newest] = position
    state.rings[1, newest] = force
    state.rings[2, newest] = 1.0 if measured else 0.0
    q[index.RING_NEXT] = (newest + 1) % size
    q[index.RING_FILLED] = min(q[index.RING_FILLED] + 1.0, size)
    q[index.TIME] += state.settings[index.PERIOD]
    if q[index.RING_FILLED] < size:
        return False
    p_delay, f_delay = state.settings[index.POSITION_DELAY], state.settings[index.FORCE_DELAY]
    p = delayed(state.rings[0], size, newest, p_delay)
    f = delayed(state.rings[1], size, newest, f_delay)
    seen = delayed(state.rings[2], size, newest, p_delay) == 1.0
    seen = seen and delayed(state.rings[2], size, newest, f_delay) == 1.0
    if state.detector[detection.STARTED] == 0.0:
        start(state, index.P, p)
        start(state, index.U, 0.0)
        q[index.PLAY] = p
        q[index.SURFACE_USED] = (
            state.detector[detection.SURFACE]
            if state.detector[detection.SURFACE_KNOWN] > 0.0
            else p
        )
    net = f - q[index.RIG_FORCE]
    event = detection.detect(
        state.detector, state.detection, state.history, state.room, p, net, seen
    )
    if event != detection.NOTHING:
        on_edge(state, event)
    refit_surface(state)
    filter_signals(state, p, f)
    q[index.PENETRATION] = p - q[index.SURFACE_USED]
    q[index.VELOCITY] = state.channels[index.P, RATE]
    q[index.FORCE] = f
    return True


@kernel
def bridge_gap(state: index.BankState, position: float, force: float) -> None:
    """Fill a short gap by interpolation, or start over after a long one."""
    q = state.q
    missing = int(q[index.GAP])
    if missing <= state.settings[index.LARGEST_GAP] and q[index.RING_FILLED] > 0.0:
        for j in range(missing):
            part = (j + 1.0) / (missing + 1.0)
            between = q[index.LAST_POSITION] + part * (position - q[index.LAST_POSITION])
            f = q[index.LAST_FORCE] + part * (force - q[index.LAST_FORCE])
            sample_step(state, between, f, False)  # noqa: FBT003 - not measured
        return
    q[index.DISCARDED] += missing
    q[index.RING_FILLED] = 0.0
    q[index.FREE_RUNNING] = q[index.FREE_SETTLED] = 0.0
    restart_contact(state)
    start(state, index.P, position)
    start(state, index.U, q[index.TRAVEL])
    q[index.PLAY] = position
    q[index.TIME] += missing * state.settings[index.PERIOD]


@kernel
def sense(state: index.BankState, position: float, force: float, valid: bool) -> bool:
    """Take one tick's sample; return whether there is a new instant to estimate from.

    Input that is not finite, or wild, counts as missing.
    """
    q = state.q
    q[index.ELAPSED] += state.settings[index.PERIOD]
    if not (valid and abs(position) < 1e9 and abs(force) < 1e9):
        q[index.GAP] += 1.0
        for r in range(int(state.settings[index.N_ROWS])):
            state.live[r] = 0
        return False
    if q[index.GAP] > 0.0:
        bridge_gap(state, position, force)
    else:
        watch.listen(state.watch, force)
    q[index.GAP] = 0.0
    q[index.LAST_POSITION] = position
    q[index.LAST_FORCE] = force
    if not sample_step(state, position, force, True):  # noqa: FBT003 - measured
        return False
    set_motion(state)
    return True
