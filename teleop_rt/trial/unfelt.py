"""When a tool pressed harder than its operator felt, and why: the device's bound, or the model."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig
from teleop_rt.trial.felt_force import Columns, converged

MARGIN_S = 0.05
"""By which a force may be later than the link's round trip: sampling, filters and jitter."""
EXPLAINED = 0.5
"""Share of the missing force [1] from which one cause of it is the main one."""
BESIDE = 3
"""Samples on both sides of a force in which the tool had the velocity that made it: the sensor's
lag."""
BOUND_SIGNALS = ("true_stiffness", "rendered_stiffness", "true_damping", "rendered_damping")
"""The master's signals of a wall, as it is and as the bound lets it be rendered."""
Cause = Literal["bound", "model", "other"]


def most_unfelt(trial: TrialConfig, slave: Columns, master: Columns) -> dict[str, Any] | None:
    """Return the moment of converged contact in which the felt force was most exceeded.

    A force of the slave arrives up to a round trip after the hand's own: it is compared with the
    largest that was rendered since. None without such contact, or where nothing pressed.
    """
    rows = converged(trial, master)
    if not rows.any():
        return None
    from scipy.ndimage import maximum_filter1d  # noqa: PLC0415 - no daemon waits for it

    since = 1 + round(trial.master.rate_hz * (1e-3 * trial.link.round_trip_ms + MARGIN_S))
    rendered, pressed = np.nan_to_num(master["rendered_force"]), master["reflected_force"]
    felt = maximum_filter1d(rendered, since, origin=(since - 1) // 2) / trial.master.force_scale
    beyond = np.where(rows, pressed - felt, np.nan)
    if not np.isfinite(beyond).any():
        return None
    at = int(np.nanargmax(beyond))
    if not pressed[at] > 0.0:
        return None
    began = master["stamp_ns"][np.flatnonzero(np.isfinite(master["stamp_ns"]))[0]]
    first = max(0, at - since + 1)
    felt_at = first + int(np.argmax(rendered[first : at + 1]))
    tool = _tool(slave, master["stamp_ns"][[first, at]], float(pressed[at]))
    return {
        "pressed": float(pressed[at]),
        "felt": float(rendered[felt_at]),
        "share": float(felt[at] / pressed[at]),
        "at_s": float(master["stamp_ns"][at] - began) * 1e-9,
        "tracking_hz": trial.contact.surface_tracking_hz,
        **_why(trial, master, felt_at, tool, (float(felt[at]), float(pressed[at]))),
    }


def _tool(
    slave: Columns, span_ns: NDArray[np.float64], pressed: float
) -> tuple[float, float] | None:
    """Return the tool's position and velocity when it pressed so hard, between two stamps (2,)."""
    if not slave:
        return None
    within = (slave["stamp_ns"] >= span_ns[0]) & (slave["stamp_ns"] <= span_ns[1])
    within &= slave["valid"] > 0
    if not within.any():
        return None
    row = np.flatnonzero(within)[np.argmin(np.abs(slave["force"][within] - pressed))]
    return float(slave["position"][row]), _fastest(slave, int(row))


def _fastest(slave: Columns, row: int) -> float:
    """Return the tool's largest velocity between samples beside a row, at least 0.

    A filtered one lags, and misses the steps of a link that jitters, which damping answers.
    """
    rows = slice(max(0, row - BESIDE), row + BESIDE + 1)
    steps, took_ns = (np.diff(slave[key][rows]) for key in ("position", "sample_stamp_ns"))
    fresh = took_ns > 0.0
    return max(0.0, float(np.max(1e9 * steps[fresh] / took_ns[fresh], initial=0.0)))


def _why(
    trial: TrialConfig,
    master: Columns,
    row: int,
    tool: tuple[float, float] | None,
    felt_and_pressed: tuple[float, float],
) -> dict[str, Any]:
    """Return the cause of a missing force, by the force that the wall of a row has unbounded.

    That is at the tool's place and velocity, by the wall's largest slopes: at most so much. All
    null where tool or wall are not known.
    """
    surface = float(master["surface"][row])
    if tool is None or not np.isfinite(surface):
        return dict.fromkeys(("cause", "tool", "surface", "modelled"))
    (felt, pressed), (position, velocity) = felt_and_pressed, tool
    wall = {key: float(master[key][row]) for key in BOUND_SIGNALS}
    depth, modelled = position - surface, 0.0
    if depth > 0.0:
        modelled = wall["true_stiffness"] * depth + wall["true_damping"] * max(0.0, velocity)
    cause: Cause = "other"
    missing = pressed - felt
    if modelled < felt + EXPLAINED * missing and missing > trial.contact.onset_force:
        cause = "model"
    elif any(wall[f"rendered_{key}"] < wall[f"true_{key}"] for key in ("stiffness", "damping")):
        cause = "bound"
    return {"cause": cause, "tool": position, "surface": surface, "modelled": modelled}
