"""The samples of a recording of ours as the estimators had them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.estimation.grid import with_gaps
from teleop_rt.estimation.pairing import pairs_of
from teleop_rt.estimation.settings import PipelineSettings

Array = NDArray[np.float64]
_NOTHING = np.empty(0)


class Samples(NamedTuple):
    """Position, force and flags (ticks of the pipeline,), and when each was taken [ns]."""

    position: Array
    force: Array
    valid: NDArray[np.bool_]
    stamp_ns: Array


def estimated_samples(
    slave: dict[str, Array], settings: PipelineSettings, loop_period_ns: int
) -> Samples:
    """Return the input of the estimators, from the slave's recorded signals (cycles,).

    Position, force and flags are taken out of `slave`: of an hour both would fill the memory.
    """
    valid = slave.pop("valid", _NOTHING) > 0
    if (pairing := settings.pairing(loop_period_ns)) is not None:
        own_ns = _own_stamps(slave, "position"), _own_stamps(slave, "force")
        position, force = slave.pop("position", _NOTHING), slave.pop("force", _NOTHING)
        return Samples(*pairs_of(pairing, position, own_ns[0], force, own_ns[1], valid))
    stamp_ns = slave.get("sample_stamp_ns", _NOTHING)
    rows = (slave.pop(name, _NOTHING) for name in ("position", "force"))
    x, f = with_gaps(rows, valid, stamp_ns, loop_period_ns)
    (filled,) = with_gaps((valid,), valid, stamp_ns, loop_period_ns)
    return Samples(x, f, filled, stamp_ns)


def _own_stamps(slave: Mapping[str, Array], value: str) -> NDArray[np.int64]:
    """Return the own stamps (cycles,) [ns] of position or force by its recorded age."""
    age_ns = np.rint(1e6 * slave.get(f"{value}_age_ms", _NOTHING))
    stamps: NDArray[np.int64] = (slave.get("stamp_ns", _NOTHING) - age_ns).astype(np.int64)
    return stamps
