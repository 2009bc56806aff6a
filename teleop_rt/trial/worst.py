"""The worst that a hand met in a whole run, which a mean error does not show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig
from teleop_rt.trial.felt_force import Columns, Felt

Array = NDArray[np.float64]
MOVING = frozenset({"moving_surface", "permanent_set"})
"""Hidden effects of a simulated body that move its surface: truth.json says where it began."""


def since_touch(trial: TrialConfig, master: Columns) -> NDArray[np.bool_]:
    """Return which master rows (n,) come after it first took in a contact, but for jumps.

    Where it puts the hand to another place on the axis, the motion that the true environment is
    asked about has a jump, whose speed nobody made.
    """
    touched = np.logical_or.accumulate(master["contact_id"] > 0)
    most = 2.0 * trial.master.offset_speed / trial.master.rate_hz
    jumps = np.abs(np.diff(master["offset"], prepend=np.nan)) > most
    beside = jumps | np.roll(jumps, -1)
    kept: NDArray[np.bool_] = touched & ~beside
    return kept


def worst_felt(felt: Felt, counts: NDArray[np.bool_], began_ns: float) -> dict[str, float | None]:
    """Return the worst of a felt force in the rows (n,) that count, and the true force's range.

    In the environment's scale. A phantom is a force felt where the true environment answers the
    same motion with none. A hand that feels a softer wall goes where the tool never was: the force
    there is one that nothing met, so `true` counts up to the largest that the slave reported.
    `began_ns` is the stamp from which times count: the master may begin seconds before the run.
    """
    met = felt.reflected[np.isfinite(felt.reflected)]
    answer = np.clip(felt.true, min(met.min(), 0.0), max(met.max(), 0.0)) if met.size else felt.true
    error = np.where(counts, np.abs(felt.rendered - answer), np.nan)
    phantom = np.where(felt.true == 0.0, error, np.nan)
    true = answer[counts & np.isfinite(answer)]
    return {
        "phantom_force": _largest(phantom),
        "phantom_s": _when(phantom, felt.stamp_ns, began_ns),
        "force_error": _largest(error),
        "force_error_s": _when(error, felt.stamp_ns, began_ns),
        "force_range": float(np.ptp(true)) if true.size else None,
    }


def wall_offset(master: Columns, began_ns: float) -> dict[str, float] | None:
    """Return how far from its true place the wall is felt since the first touch; None without one.

    In the rig's unit. `began_ns` is the stamp from which times count.
    """
    touched = np.logical_or.accumulate(master.get("contact_id", np.empty(0)) > 0)
    offset = np.abs(np.where(touched, master.get("offset", np.empty(0)), np.nan))
    if (largest := _largest(offset)) is None:
        return None
    at_s = _when(offset, master["stamp_ns"], began_ns)
    at_end = float(offset[np.isfinite(offset)][-1])
    return {"largest": largest, "largest_s": at_s or 0.0, "at_end": at_end}


def worst_surface(
    slave: Mapping[str, Array], truth: Mapping[str, Any] | None
) -> dict[str, float | None]:
    """Return the largest error of the slave's surface while it had one, and the deepest press.

    In the rig's unit; null where the true surface is not known, or moves by itself.
    """
    nothing: dict[str, float | None] = dict.fromkeys(
        ("surface_error", "surface_error_s", "deepest")
    )
    hidden = truth.get("undeclared", ()) if truth else ()
    if truth is None or "surface" not in slave or any(h["effect"] in MOVING for h in hidden):
        return nothing
    true = truth["environment"]["surface"]
    error = np.abs(slave["surface"] - true)
    deepest = _largest(slave["position"] - true)
    return {
        "surface_error": _largest(error),
        "surface_error_s": _when(error, slave["stamp_ns"], slave["stamp_ns"][0]),
        "deepest": None if deepest is None or deepest <= 0.0 else deepest,
    }


def _largest(values: Array) -> float | None:
    return float(np.nanmax(values)) if np.isfinite(values).any() else None


def _when(values: Array, stamps_ns: Array, began_ns: float) -> float | None:
    """Return the time [s] of the largest value after the stamp of the beginning."""
    if not np.isfinite(values).any():
        return None
    return float(stamps_ns[int(np.nanargmax(values))] - began_ns) * 1e-9
