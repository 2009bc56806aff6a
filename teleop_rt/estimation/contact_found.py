"""The contact as estimation has found it, in the coordinates of the encoder."""

from __future__ import annotations

import math
from typing import NamedTuple

from teleop_rt.contact import detection
from teleop_rt.estimation import state as index
from teleop_rt.estimation.state import BankState


class Contact(NamedTuple):
    """State of the contact in rig units; NaN where it is unknown."""

    in_contact: bool
    contact_id: int
    surface: float
    surface_known: bool
    penetration: float
    velocity: float
    verified_free: float


def contact_of(state: BankState, shift: float) -> Contact:
    """Return the contact, `shift` being the motion of tip or surface that no encoder shows."""
    one, q = state.detector.tolist(), state.q
    known = one[detection.SURFACE_KNOWN] > 0.0
    free = one[detection.VERIFIED_FREE] - shift if one[detection.STARTED] > 0.0 else math.nan
    return Contact(
        one[detection.IN_CONTACT] > 0.0,
        int(one[detection.CONTACT_ID]),
        one[detection.SURFACE] - shift if known else math.nan,
        known,
        q.item(index.PENETRATION),
        q.item(index.VELOCITY),
        free if free > detection.NEVER_FREE else math.nan,
    )


def surface_reason(state: BankState) -> str | None:
    """Return why there is no surface, or None when there is one."""
    one = state.detector
    if one[detection.SURFACE_KNOWN] > 0.0:
        return None
    if one[detection.IN_CONTACT] > 0.0 and one[detection.FREE_SEEN] == 0.0:
        return "the recording never leaves contact, so the surface cannot be seen"
    if one[detection.CONTACT_ID] == 0.0:
        return "the recording never comes into contact"
    return "no contact began after a stretch of free air, so the surface cannot be seen"
