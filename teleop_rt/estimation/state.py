"""Everything that a tick of estimation reads and writes: one preallocated record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.detection import HISTORY, N_DETECTION, N_DETECTOR
from teleop_rt.contact.effect import Vector
from teleop_rt.contact.slow_onset import N_ROOM
from teleop_rt.contact.surface import BUFFER, N_REFIT, N_SUMS
from teleop_rt.estimation.algebraic import N_LINEAR, N_LOG, N_TERM
from teleop_rt.estimation.filters import CHANNEL_SIZE, LONGEST_WINDOW
from teleop_rt.estimation.layout import MAX_PARAMETERS, N_SETTINGS, ROW_SIZE
from teleop_rt.estimation.selection import N_CHOICE, N_RECORD
from teleop_rt.estimation.watch import N_WATCH

Matrix = NDArray[np.float64]
Counts = NDArray[np.int64]
Flags = NDArray[np.uint8]

# Settings of the cycle; L, V, A are the units that regressors are counted in.
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
    FOAW_WINDOW,
    ANY_FREE,
    ONLY_FREE,
    N_EFFECTS,
    N_ROWS,
    RING,
    N_CYCLE_SETTINGS,
) = range(18)

# State of the cycle.
(
    TIME,
    ELAPSED,
    GAP,
    LAST_POSITION,
    LAST_FORCE,
    RING_NEXT,
    RING_FILLED,
    RUNNING,
    SETTLED,
    LOG_RUNNING,
    LOG_SETTLED,
    FREE_RUNNING,
    FREE_SETTLED,
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
    RIG_FORCE,
    ADDED_FORCE,
    START_FORCE,
    N_CYCLE,
) = range(31)

# Channels of the filter: position, one-way travel, force in contact, ln x, ln f, force always.
P, U, F, LX, LF, FREE, N_CHANNELS = range(7)
# The pairs of windows of the linear algebraic regressions: in contact, and always.
CONTACT_PAIR, FREE_PAIR = 0, 2

# The filtered signals of an instant, scaled by L, V, A: x, v, a, max(v, 0), force, ln x, ln f, the
# force that weights logarithms, and the force whether in contact or not.
MX, MV, MA, MV_IN, MF, M_LOG_X, M_LOG_F, M_WEIGHT, M_FREE, N_MOTION = range(10)


MOST_ROWS = 64
"""Rows of the bank: the record's arrays have a fixed size."""
MOST_EFFECTS = 4
"""Effects of an extended model."""
LONGEST_LAG = 256
"""Samples by which a channel may be delayed to meet another: 64 ms at 4 kHz."""


@dataclass(frozen=True, slots=True)
class BankState:
    """Views of the record that a tick reads and writes: one allocation, fields of fixed shape.

    q, settings: as named above; detector, detection: contact/detection.py; rings (3, LONGEST_LAG):
    position, force and 1 where they were measured, before alignment; history: aligned; room: work
    space to find an onset in; filter: transition, before, now, channels (N_CHANNELS, CHANNEL_SIZE),
    foaw; motion (N_MOTION,); windows, term_windows and log_windows: algebraic.py; sums, buffer,
    refit: contact/surface.py; bank, bank_settings, active, phi, y, lever, live: the bank's; own
    (parameters without offset), codes (models), regressions, ready, possible, records and choice:
    the rows'; terms: the effects' forces at their scales, starts: their shares before they are
    estimated, of_rig: 1 for those of the rig; frozen: rows that take those; watch: watch.py.
    """

    q: Vector
    settings: Vector
    detector: Vector
    detection: Vector
    rings: Matrix
    history: Matrix
    room: Vector
    transition: Matrix
    before: Vector
    now: Vector
    channels: Matrix
    foaw: Matrix
    motion: Vector
    windows: Matrix
    term_windows: NDArray[np.float64]
    log_windows: Matrix
    sums: Vector
    buffer: Matrix
    refit: Vector
    bank: Matrix
    bank_settings: Matrix
    active: Counts
    own: Counts
    codes: Counts
    regressions: Counts
    phi: Matrix
    y: Vector
    lever: Vector
    live: Flags
    ready: Flags
    possible: Flags
    records: Matrix
    choice: Vector
    terms: Vector
    starts: Vector
    of_rig: Vector
    frozen: Flags
    watch: Vector


# Numba passes a record by reference: a tuple of as many arrays would be copied at each call.
_FIELDS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "q": (np.float64, (N_CYCLE,)),
    "settings": (np.float64, (N_CYCLE_SETTINGS,)),
    "detector": (np.float64, (N_DETECTOR,)),
    "detection": (np.float64, (N_DETECTION,)),
    "rings": (np.float64, (3, LONGEST_LAG)),
    "history": (np.float64, (3, HISTORY)),
    "room": (np.float64, (N_ROOM,)),
    "transition": (np.float64, (3, 3)),
    "before": (np.float64, (3,)),
    "now": (np.float64, (3,)),
    "channels": (np.float64, (N_CHANNELS, CHANNEL_SIZE)),
    "foaw": (np.float64, (N_CHANNELS, 2 * LONGEST_WINDOW + 1)),
    "motion": (np.float64, (N_MOTION,)),
    "windows": (np.float64, (4, N_LINEAR)),
    "term_windows": (np.float64, (4, MOST_EFFECTS, N_TERM)),
    "log_windows": (np.float64, (2, N_LOG)),
    "sums": (np.float64, (N_SUMS,)),
    "buffer": (np.float64, (3, BUFFER)),
    "refit": (np.float64, (N_REFIT,)),
    "bank": (np.float64, (MOST_ROWS, ROW_SIZE)),
    "bank_settings": (np.float64, (MOST_ROWS, N_SETTINGS)),
    "active": (np.int64, (MOST_ROWS,)),
    "own": (np.int64, (MOST_ROWS,)),
    "codes": (np.int64, (MOST_ROWS,)),
    "regressions": (np.int64, (MOST_ROWS,)),
    "phi": (np.float64, (MOST_ROWS, MAX_PARAMETERS)),
    "y": (np.float64, (MOST_ROWS,)),
    "lever": (np.float64, (MOST_ROWS,)),
    "live": (np.uint8, (MOST_ROWS,)),
    "ready": (np.uint8, (MOST_ROWS,)),
    "possible": (np.uint8, (MOST_ROWS,)),
    "records": (np.float64, (MOST_ROWS, N_RECORD)),
    "choice": (np.float64, (N_CHOICE,)),
    "terms": (np.float64, (MOST_EFFECTS,)),
    "starts": (np.float64, (MOST_EFFECTS,)),
    "of_rig": (np.float64, (MOST_EFFECTS,)),
    "frozen": (np.uint8, (MOST_ROWS,)),
    "watch": (np.float64, (N_WATCH,)),
}
# Of `np.record`, so that kernels that are not compiled find its fields as attributes, too.
STATE_TYPE = np.dtype(
    (np.record, np.dtype([(n, *kind) for n, kind in _FIELDS.items()], align=True))
)
StateArray = NDArray[np.void]


def look_into(storage: StateArray) -> BankState:
    """Return views of the record within the array of one, made once: each takes microseconds."""
    return BankState(**{name: storage[name][0] for name in _FIELDS})


def new_state() -> tuple[StateArray, BankState]:
    """Return an array of one zeroed record, as kernels take it, and the record to look into."""
    storage = np.zeros(1, dtype=STATE_TYPE)
    return storage, look_into(storage)
