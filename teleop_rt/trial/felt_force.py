"""The force felt at the master beside the force of the true environment under the same motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.operator import DeviceOperator
from teleop_rt.config.trial import TrialConfig
from teleop_rt.trial.folder import TRUTH
from teleop_rt.trial.summary_file import written_json

Array = NDArray[np.float64]
Columns = Mapping[str, Array]
EnvironmentForce = Callable[[Mapping[str, Any], Array, Array, float], Array]
"""(truth, position (n,), velocity (n,), period [s]) -> force (n,) of the true environment."""

SIGNALS = (
    "stamp_ns",
    "tick",
    "position",
    "velocity",
    "offset",
    "rendered_force",
    "reflected_force",
    "contact_id",
)
"""The signals of the master that this needs."""
_SETTLING_S = 2.0
"""Time after the first model before the felt force is judged, beside the round trip."""


@dataclass(frozen=True, slots=True)
class Felt:
    """Forces in the environment's scale, one row per tick of the master (n,).

    `true` is the true environment's answer to the motion that the master rendered for, `rendered`
    the force on the operator, `reflected` the slave's force as it arrived; `converged` marks rows
    in converged contact, lift-offs in between included.
    """

    stamp_ns: Array
    true: Array
    rendered: Array
    reflected: Array
    converged: NDArray[np.bool_]


def read_truth(folder: Path) -> Mapping[str, Any] | None:
    """Return the truth that the simulated plant wrote; None where it wrote none, or no whole one.

    Raises RecordingError where it may not be read.
    """
    return written_json(folder / TRUTH)


def felt_force(
    trial: TrialConfig,
    master: Columns,
    truth: Mapping[str, Any],
    environment_force: EnvironmentForce,
) -> Felt:
    """Return the felt force beside the true one; `master` has a row for every tick."""
    scale = trial.master.position_scale
    felt_at = scale * master["position"] - master["offset"]
    period_s = 1.0 / trial.master.rate_hz
    velocity = master["velocity"]
    if isinstance(trial.operator, DeviceOperator):  # its own is low-passed, and lags
        velocity = np.gradient(master["position"], period_s)
    return Felt(
        stamp_ns=master["stamp_ns"],
        true=environment_force(truth, felt_at, scale * velocity, period_s),
        rendered=master["rendered_force"] / trial.master.force_scale,
        reflected=master["reflected_force"],
        converged=converged(trial, master),
    )


def converged(trial: TrialConfig, master: Columns) -> NDArray[np.bool_]:
    """Return a mask of the master's rows in converged contact, including lift-offs in between.

    A contact counts as converged one round trip and two seconds after the master first received
    it; the transient of finding and adopting the wall is left out.
    """
    stamps = master.get("stamp_ns", np.empty(0))
    onset = np.flatnonzero(master["contact_id"] > 0) if stamps.size else np.empty(0, np.int64)
    if onset.size == 0:
        return np.zeros(stamps.shape, dtype=np.bool_)
    settled_s = _SETTLING_S + trial.link.round_trip_ms * 1e-3
    later: NDArray[np.bool_] = stamps >= stamps[onset[0]] + settled_s * 1e9
    return later


def moves(trial: TrialConfig, force: Array) -> bool:
    """Return whether a force (n,) moves by more than an onset of contact takes.

    Where it moves less, its correlation with another is that of noise and settling models.
    """
    known = force[np.isfinite(force)]
    return bool(known.size) and float(np.ptp(known)) > trial.contact.onset_force


def rows_to_compare(slave: Columns, master: Columns) -> Columns:
    """Return the master's rows up to the slave's last tick, with a row for every tick.

    After the slave's last tick there is nothing to feel; a tick that was not recorded gives
    not-a-number.
    """
    if not slave or not master:
        return master
    beside = master["stamp_ns"] <= slave["stamp_ns"][-1]
    if not beside.any():
        return {}
    kept = {name: values[beside] for name, values in master.items()}
    place = (kept["tick"] - kept["tick"][0]).astype(np.int64)
    whole = {name: np.full(int(place[-1]) + 1, np.nan) for name in kept}
    for name, values in kept.items():
        whole[name][place] = values
    return whole
