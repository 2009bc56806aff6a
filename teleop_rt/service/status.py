"""What a daemon says of itself: put together from shared memory, without asking the loop."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from teleop_rt.realtime.histogram import KINDS, TimingHistograms
from teleop_rt.realtime.ring import RingReader
from teleop_rt.realtime.session import RECORDER_STATE
from teleop_rt.signals import SLAVE, columns
from teleop_rt.slave.faults import FAULTS, State

DESCRIPTION = "daemon.json"
"""What the daemon wrote of itself at its start: pid, rig, trial, folder, privileges."""
PROBLEM = "problem.txt"
"""Why the devices could not be configured again."""
SLAVE_RING = "slave.ring"
_SHOWN = ("position", "force", "in_contact", "surface", "command", "missing")
_COLUMN = columns(SLAVE)


def read_status(session: Path) -> dict[str, Any]:
    """Return the status of the daemon whose rings lie in `session`; what is unknown is None."""
    description = json.loads((session / DESCRIPTION).read_text(encoding="utf-8"))
    row = RingReader(session / SLAVE_RING).newest()
    values = {} if row is None else {name: float(row[_COLUMN[name]]) for name in _COLUMN}
    fault = FAULTS[int(values.get("fault", 0))]
    timing = TimingHistograms(session)
    return {
        **description,
        "session": str(session),
        "state": State(int(values.get("state", State.BOOT))).name,
        "fault": {
            "code": fault.code,
            "name": fault.name,
            "cause": fault.cause,
            "next_step": fault.next_step,
        },
        "tick": int(values.get("tick", 0)),
        **{name: _plain(values.get(name)) for name in _SHOWN},
        "timing_us": {kind: timing.quantiles(kind) for kind in KINDS},
        "recorder": _recorder(session),
    }


def _plain(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _recorder(session: Path) -> dict[str, Any] | None:
    path = session / RECORDER_STATE
    if not path.exists():
        return None
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found
