"""Bodies of messages as records, which `codec` packs, for kernels that write each field."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import MOST_SHAPES
from teleop_rt.link.messages import MOST_EFFECTS

StoredState = NDArray[np.record]
StoredModel = NDArray[np.record]
StoredMotion = NDArray[np.record]

_NUMBERS = ("position", "force", "verified_free", "velocity", "energy_J")
_CODES = ("in_contact", "following", "safety_state", "fault", "inadequate")
_STATE = np.dtype(
    [(name, "<f8") for name in _NUMBERS]
    + [("contact_id", "<u8")]
    + [(name, "u1") for name in _CODES]
)
_MOTION = np.dtype(
    [(name, "<f8") for name in ("target", "velocity", "surface", "force", "energy_J")]
    + [("contact_id", "<u8")]
    + [(name, "u1") for name in ("engaged", "wall", "provisional", "faulted", "known")]
)
_EFFECT = np.dtype([("code", "<u4"), ("amplitude", "<f8"), ("shape", "<f8", (MOST_SHAPES,))])
_MODEL = np.dtype(
    [("model_sequence", "<u8"), ("contact_id", "<u8"), ("model", "u1"), ("surface_known", "u1")]
    + [(name, "<f8") for name in ("surface", "k", "b", "n", "m", "offset", "force_std")]
    + [(name, "<f8") for name in ("time_s", "surface_velocity")]
    + [("count", "u1"), ("effects", _EFFECT, (MOST_EFFECTS,))]
)


def new_model() -> StoredModel:
    """Return the body of a model (1,), all zeros: its bytes are those of `codec.encode`."""
    return np.zeros(1, np.dtype((np.record, _MODEL)))


def new_state_body() -> StoredState:
    """Return the body of a state (1,), all zeros: its bytes are those of `codec.encode`."""
    return np.zeros(1, np.dtype((np.record, _STATE)))


class NewestMotion:
    """The body of the newest motion, as it came, and whether there is one, for kernels.

    `stored` (1,) has the fields of a motion's body, and `known`, 0 while there is none; `words`
    are the same by byte, for functions that take a body.
    """

    def __init__(self) -> None:
        self.stored: StoredMotion = np.zeros(1, np.dtype((np.record, _MOTION)))
        self.words = self.stored.view(np.uint8)
        self._body, self._known = self.words.data[:-1], self.words.data[-1:]

    def take(self, body: bytes) -> None:
        """Take the body of a motion that was found to be in order."""
        self._body[:] = body
        self._known[0] = 1

    def forget(self) -> None:
        """Count the last motion for nothing; its values stay."""
        self._known[0] = 0
