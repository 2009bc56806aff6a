"""Bodies of messages as records: what `messages` packs, for kernels that write each field."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

StoredState = NDArray[np.record]

_NUMBERS = ("position", "force", "verified_free", "velocity", "energy_J")
_CODES = ("in_contact", "following", "safety_state", "fault", "inadequate")
_STATE = np.dtype(
    [(name, "<f8") for name in _NUMBERS]
    + [("contact_id", "<u8")]
    + [(name, "u1") for name in _CODES]
)


def new_state() -> StoredState:
    """Return the body of a state (1,), all zeros: its bytes are those of `messages.encode`."""
    return np.zeros(1, np.dtype((np.record, _STATE)))
