"""Everything that a tick of the slave's decisions reads and writes: one preallocated record.

Kernels read and write its fields by name. Python reads the outputs through two views of the same
words, which takes a fraction of the time of numpy's fields.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

WINDOW_ROOM = 64
"""Room for the samples of 10 ms at the highest rate, 4 kHz."""
Floats = NDArray[np.float64]
Counts = NDArray[np.int64]
StoredTick = NDArray[np.record]


class Tick:
    """Fields by group; positions, velocities and forces in the rig's units, flags 0 or 1."""

    # Settings: limits, bounds in ticks, the guard's and the supervision's.
    period_s: float
    position_min: float
    position_max: float
    velocity_max: float
    velocity_step: float
    force_max: float
    hold_missing: int
    stop_missing: int
    rate_hz: int
    runs_out_ns: int
    hold_after_ms: float
    retreat_after_ms: float
    force_cap: float
    retreat_step: float
    fading: float
    tolerance: float
    slope_step: float
    slope_noticed: float
    acceleration: float
    unknown_speed: float
    stiffest: float
    late_s: float
    catch_up_speed: float
    homing_step: float
    has_zeros: int
    nothing_free: float
    supervised: int
    mode: int
    needs_drive_position: int
    needs_drive_force: int
    # Inputs of the tick: clock and zeros, the arguments of `decide`, and the sample.
    tick: int
    now_ns: int
    skipped: int
    wake_latency_ns: int
    ready: int
    surface_shift: float
    homed: int
    late_ns: int
    sample_stamp_ns: int
    usable: int
    valid: int
    enabled: int
    missing: int
    invalid_in_a_row: int
    axis_fault: int
    position: float
    force: float
    position_stamp_ns: int
    force_stamp_ns: int
    has_drive_position: int
    has_drive_force: int
    drive_position: float
    drive_force: float
    # The master's silence, and its newest motion.
    silence_ns: int
    has_motion: int
    lead: float
    lead_velocity: float
    lead_force: float
    lead_energy_J: float
    acknowledged: int
    engaged: int
    provisional: int
    faulted: int
    # The contact that the estimators see.
    in_contact: int
    contact_id: int
    surface: float
    surface_deviation: float
    surface_known: int
    velocity: float
    verified_free: float
    rig_force: float
    inadequate: int
    # The safety chain.
    state: int
    fault: int
    started: int
    stopping_ticks: int
    followings: int
    holds: int
    held_by: int
    led: int
    led_stamp_ns: int
    calm: int
    # The zeros.
    joined: int
    shift: float
    # Limiter, catching up and guard.
    command: float
    command_velocity: float
    pace: float
    limited: int
    target: float
    following: int
    behind: int
    known_surface: float
    met_contact: int
    waiting_for: int
    hold_at: float
    secant: float
    wall_stiffness: float
    wall_force: float
    pressed: float
    pressed_force: float
    nearer: float
    slope: float
    slope_place: int
    slope_kept: float
    slope_count: int
    slope_from: float
    slope_from_force: float
    # The model last sent, as far as its depth goes.
    model: int
    model_k: float
    model_b: float
    model_n: float
    model_added: float
    # A coupling without a model.
    coupling_force_gain: float
    drift_speed: float
    reserve_J: float
    reserve_W: float
    tool_mass: float
    tool_damping: float
    tool_stiffness: float
    tool_gain: float
    energy_J: float
    spent_J: float
    known_before_J: float
    heard: float
    coupled_position: float
    deviation: float
    # The supervision.
    written: float
    following_max: float
    following_ticks: float
    overspeed: float
    difference_max: float
    mismatch_max: float
    mismatch_gain: float
    load: float
    coulomb: float
    viscous: float
    slow: float
    silent_ticks: float
    enable_ticks: float
    align_ticks: float
    supervised_ticks: int
    far_ticks: int
    silent: int
    same_max: float
    same_ms: float
    same_position: float
    same_command: float
    same_far: int
    same_from_ns: int
    difference: float
    mismatch: float
    window: int
    window_place: int
    # Rings: forces of the guard's slope, positions and their stamps of the supervision's velocity.
    forces: Floats
    positions: Floats
    stamps_ns: Counts


_KINDS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "float": (np.float64, ()),
    "int": (np.int64, ()),
    "Floats": (np.float64, (WINDOW_ROOM,)),
    "Counts": (np.int64, (WINDOW_ROOM,)),
}
_FIELDS = [(name, *_KINDS[kind]) for name, kind in Tick.__annotations__.items()]
# As a record its fields are attributes also where the kernels are not compiled.
TICK_TYPE = np.dtype((np.record, np.dtype(_FIELDS)))
_OFFSETS: dict[str, int] = {name: kind[1] for name, kind in (TICK_TYPE.fields or {}).items()}
_WORD = 8  # bytes of a field, a float64 or int64


def place(field: str) -> int:
    """Return where a field is in the views of a record."""
    return _OFFSETS[field] // _WORD


class TickRecord:
    """A record and its views: `stored` for compiled steps, `tick` by field, `floats`, `counts`.

    The views are of all words: a field must be used in the view of its own type, at its `place`.
    """

    def __init__(self) -> None:
        self.stored: StoredTick = np.zeros(1, dtype=TICK_TYPE)
        self.tick = cast("Tick", self.stored[0])
        self.words = words = self.stored.view(np.uint8).data
        self.floats, self.counts = words.cast("d"), words.cast("q")
