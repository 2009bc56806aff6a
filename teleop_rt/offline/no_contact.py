"""The note on a recording in which no contact begins, with the force and time for one."""

from __future__ import annotations

import math

import numpy as np

from teleop_rt.offline.load import Online
from teleop_rt.recordings.rows import stretches

ONSET_NOISES = 8.0
"""Force that is contact, in deviations of the force's noise, where no settings give it."""


def no_contact(online: Online) -> str:
    """Return why no contact begins: force and time that one needs, and those that there are.

    Only samples of a recording without contact are expected, and no stated surface.
    """
    settings, (_, unit) = online.settings, online.units
    onset, needed = settings.onset_force, settings.onset_samples
    force = np.where(online.valid, online.force, -np.inf)
    longest = max((past - first for first, past in stretches(force > onset)), default=0)
    of_noise = ""
    if math.isclose(onset, ONSET_NOISES * settings.force_noise):
        of_noise = f", {ONSET_NOISES:g} deviations of its noise"
    period_ms = 1e3 * settings.period_s
    lasts = f" and stays above for at most {longest * period_ms:.3g} ms" if longest else ""
    return (
        f"no contact: one begins with {needed} samples ({needed * period_ms:.3g} ms) above"
        f" {onset:.3g} {unit}{of_noise}, but the force rises to {float(force.max()):.3g} {unit}"
        f"{lasts}; press harder or longer, or state the surface with --surface"
    )
