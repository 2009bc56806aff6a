"""A touch that ended before it counted as contact, such as one that the force limit stopped."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig
from teleop_rt.trial.estimators import pipeline_settings

Array = NDArray[np.float64]


class BriefTouch(NamedTuple):
    """The force of a run without contact, where it was above contact.onset_force."""

    largest_force: float
    """In the rig's unit."""
    longest_ms: float
    """Longest time for which it was above contact.onset_force."""
    needed_ms: float
    """Time above contact.onset_force from which on there is a contact."""


def brief_touch(trial: TrialConfig, slave: Mapping[str, Array]) -> BriefTouch | None:
    """Return the touch that was too short for a contact; None where contact or touch was none."""
    if not slave or np.any(slave["contact_id"] > 0):
        return None
    force = np.where(slave["valid"] > 0, slave["force"], -np.inf)
    above = force > trial.contact.onset_force
    edges = np.flatnonzero(np.diff(above, prepend=False, append=False))
    if not edges.size:
        return None
    settings = pipeline_settings(trial)
    longest_ms = 1e3 * float(np.max(edges[1::2] - edges[::2])) / trial.rig.rate_hz
    needed_ms = 1e3 * settings.onset_samples * settings.period_s
    return BriefTouch(float(force.max()), longest_ms, needed_ms)


def said_of(touch: BriefTouch, trial: TrialConfig, fault: Mapping[str, Any]) -> str:
    """Return why the touch was no contact; `fault` is that of the end of the run."""
    unit = trial.rig.units.force
    said = (
        f"the force rose to {touch.largest_force:.4g} {unit}, and was above contact.onset_force "
        f"{trial.contact.onset_force:g} {unit} for up to {touch.longest_ms:.3g} ms at a time: a "
        f"contact begins after {touch.needed_ms:.3g} ms (contact.onset_samples)"
    )
    return f"{said}; {fault['name']} stopped the run" if fault.get("code") else said
