"""Effects of contact edges and of a newer surface on the rows of the bank."""

from __future__ import annotations

from teleop_rt.contact import detection
from teleop_rt.contact import surface as surface_fit
from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import layout, selection
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import state as index
from teleop_rt.estimation.bank_kernels import forget_row, reset_row, soften_row
from teleop_rt.kernels.jit import kernel

CANDIDATE_S = 1e-3
"""Time for each candidate surface: all are tried before a tool that lifted off comes again."""


@kernel
def restart_contact(state: index.BankState) -> None:
    """End the regressions' uninterrupted contact: filters and integrals are reset."""
    state.q[index.RUNNING] = state.q[index.SETTLED] = 0.0
    state.q[index.LOG_RUNNING] = state.q[index.LOG_SETTLED] = 0.0


@kernel
def forget_rows(state: index.BankState) -> None:
    """Discard the data of all rows that depend on the surface, keeping their estimates."""
    known = state.detector[detection.SURFACE_KNOWN] > 0.0
    for r in range(int(state.settings[index.N_ROWS])):
        if state.codes[r] == row_kinds.MASS or state.codes[r] == row_kinds.MASS_DAMPER:
            continue
        offset = state.codes[r] < row_kinds.HUNT_CROSSLEY and not known
        n = state.own[r] + (1 if offset else 0)
        if n == state.active[r]:
            forget_row(state.bank[r], state.bank_settings[r], n)
        else:
            state.active[r] = n
            reset_row(state.bank[r], state.bank_settings[r], n)
            for i in range(state.records.shape[1]):
                state.records[r, i] = 0.0


@kernel
def soften_rows(state: index.BankState, shift: float) -> None:
    """Lower the trust of all rows in data taken with a surface that was off by `shift`.

    That error of force stands on each parameter: shift times stiffness, the last contact's secant.
    """
    secant = state.sums[surface_fit.XF] / max(state.sums[surface_fit.XX], 1e-30)
    error = secant * shift / state.settings[index.NOISE]
    for r in range(int(state.settings[index.N_ROWS])):
        if state.codes[r] != row_kinds.MASS and state.codes[r] != row_kinds.MASS_DAMPER:
            soften_row(state.bank[r], state.bank_settings[r], error * error, state.active[r])


@kernel
def use_surface(state: index.BankState) -> None:
    """Count penetration from the newest surface, or from the first sample while there is none.

    Data taken with a surface a little off are trusted less, with one far off not at all.
    """
    known = state.detector[detection.SURFACE_KNOWN] > 0.0
    surface = state.detector[detection.SURFACE] if known else state.detector[detection.ORIGIN]
    shift = abs(surface - state.q[index.SURFACE_USED])
    if shift == 0.0:
        return
    state.q[index.SURFACE_USED] = surface
    if (
        shift > detection.MOVED_RESOLUTIONS * state.detection[detection.RESOLUTION]
        or state.sums[surface_fit.N] == 0.0
    ):
        forget_rows(state)
    else:
        soften_rows(state, shift)


@kernel
def end_excursion(state: index.BankState) -> None:
    """Freeze the rows' parameters for the next predictions.

    When a row predicts for the first time, the comparison of all rows restarts: a late row would
    otherwise be spared the errors of the first excursions.
    """
    state.q[index.EXCURSIONS] += 1.0
    rows = int(state.settings[index.N_ROWS])
    another = False
    for r in range(rows):
        if state.bank[r, layout.READY] > 0.0:
            before = state.records[r, selection.HAS_FROZEN]
            selection.freeze(state.records[r], state.bank[r], state.active[r])
            another = another or state.records[r, selection.HAS_FROZEN] > before
    if another:
        for r in range(rows):
            state.records[r, selection.COMPARED] = 0.0


@kernel
def on_edge(state: index.BankState, event: int) -> None:
    """Handle the start or end of a contact, or a surface that was found within one."""
    restart_contact(state)
    if event == detection.FOUND:
        use_surface(state)
        return
    state.q[index.DIRECTION] = 0.0
    if event == detection.RELEASE:
        known = (
            state.detector[detection.SURFACE_KNOWN] > 0.0
            and state.detector[detection.SURFACE_FIXED] == 0.0
        )
        # No line through a body that remembers leads to its surface.
        if known and state.detection[detection.LETS_GO] == 0.0:
            surface_fit.fit_line(state.sums, state.refit, state.settings[index.NOISE])
            surface_fit.start_search(
                state.buffer, state.refit, state.detection[detection.RESOLUTION]
            )
        return
    use_surface(state)
    surface_fit.forget_contact(state.sums, state.refit)
    end_excursion(state)


@kernel
def refit_surface(state: index.BankState) -> None:
    """Go on with the refit that the last contact's end began, one candidate per millisecond.

    Its result counts from the next contact on, which may come soon.
    """
    if state.refit[surface_fit.STEP] == surface_fit.IDLE:
        return
    for _ in range(max(1, round(state.settings[index.PERIOD] / CANDIDATE_S))):
        if state.refit[surface_fit.STEP] >= surface_fit.DONE:
            break
        surface_fit.search_step(state.buffer, state.refit)
    else:
        return
    state.refit[surface_fit.STEP] = surface_fit.IDLE
    air = detection.last_in_air(state.detector) - state.q[index.SURFACE_USED]
    onset_force = state.detection[detection.ONSET_FORCE]
    if surface_fit.choose_surface(state.buffer, state.refit, air, onset_force):
        found = state.q[index.SURFACE_USED] + state.refit[surface_fit.FOUND]
        detection.refine_surface(
            state.detector, state.detection, found, state.refit[surface_fit.FOUND_VARIANCE]
        )


@kernel
def one_way_travel(q: Vector, position: float, resolution: float) -> float:
    """Return the travel into the environment so far, deaf to dither of one encoder step.

    Its derivative is max(v, 0): filtering it filters the regressor, not the position (2.2).
    """
    if position > q[index.PLAY]:
        q[index.TRAVEL] += position - q[index.PLAY]
        q[index.PLAY] = position
    elif position < q[index.PLAY] - resolution:
        q[index.PLAY] = position + resolution
    return float(q[index.TRAVEL])
