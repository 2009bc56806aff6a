"""A wall that is rendered softer than it is, in one line: the tool presses harder than is felt."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from teleop_rt.config.section import Units
from teleop_rt.config.trial import TrialConfig
from teleop_rt.trial.felt_force import Columns, converged

MARGIN_S = 0.05
"""By which a force may be later than the link's round trip: sampling, filters and jitter."""


def softened(master: Mapping[str, Any], units: Units) -> str | None:
    """Return how much of a stiff wall was felt; None where the newest was rendered as it is.

    `master` is that part of a summary. The stiffness that the device must bear is that of a quick
    touch, which the damping adds to: the share of the force is that of the moment itself.
    """
    passivity = (master.get("rendering") or {}).get("passivity")
    if not passivity:
        return None
    stiffness = passivity["stiffness"]
    rendered, true = stiffness["rendered"], stiffness["true"]
    if not 0.0 < rendered < true:
        return None
    unit = f"{units.force}/{units.position}"
    soft, stiff = (f"{float(f'{value:.3g}'):g}" for value in (rendered, true))
    said = f"at most {soft} {unit} is passive on this device; with its damping the wall has {stiff}"
    if (unfelt := master.get("unfelt")) is None:
        return said
    return (
        f"{unfelt['share']:.0%} at {unfelt['at_s']:.1f} s: the tool pressed with "
        f"{unfelt['pressed']:.3g} {units.force} and the hand felt {unfelt['felt']:.3g}; {said}"
    )


def most_unfelt(trial: TrialConfig, master: Columns) -> dict[str, float] | None:
    """Return the moment of converged contact in which the felt force was most exceeded.

    A force of the slave arrives up to a round trip after the hand's own: it is compared with the
    largest that was rendered since. None without such contact, or where nothing pressed.
    """
    rows = converged(trial, master)
    if not rows.any():
        return None
    from scipy.ndimage import maximum_filter1d  # noqa: PLC0415 - no daemon waits for it

    since = 1 + round(trial.master.rate_hz * (1e-3 * trial.link.round_trip_ms + MARGIN_S))
    rendered, pressed = master["rendered_force"], master["reflected_force"]
    felt = maximum_filter1d(np.nan_to_num(rendered), since, origin=(since - 1) // 2)
    beyond = np.where(rows, pressed - felt / trial.master.force_scale, np.nan)
    if not np.isfinite(beyond).any():
        return None
    at = int(np.nanargmax(beyond))
    if not pressed[at] > 0.0:
        return None
    began = master["stamp_ns"][np.flatnonzero(np.isfinite(master["stamp_ns"]))[0]]
    return {
        "pressed": float(pressed[at]),
        "felt": float(felt[at]),
        "share": float(felt[at] / trial.master.force_scale / pressed[at]),
        "at_s": float(master["stamp_ns"][at] - began) * 1e-9,
    }
