"""The status of a daemon, read from shared memory without asking the loop."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from teleop_rt.link.troubles import TROUBLES
from teleop_rt.realtime.alarms import of_helper, of_recorder
from teleop_rt.realtime.histogram import KINDS, TimingHistograms
from teleop_rt.realtime.ring import RingReader
from teleop_rt.realtime.ring_folder import LAST_FAULT, RECORDER_STATE
from teleop_rt.realtime.state_file import found
from teleop_rt.service.keeper import goes_on, kept, watched
from teleop_rt.signals import SLAVE, columns
from teleop_rt.slave.faults import FAULTS, State

DESCRIPTION = "daemon.json"
"""The daemon's description, written at its start: pid, rig, trial, folder, privileges."""
PROBLEM = "problem.txt"
"""Why the devices could not be configured again."""
SLAVE_RING = "slave.ring"
_NO_RECORDER: dict[str, Any] = {"stamp_ns": None, "dropped": {}, "alarm": ""}
_SILENT_S = 3.0
"""Age of the newest tick from which the loop is reported as silent."""
_SHOWN = ("position", "force", "in_contact", "surface", "command", "missing")
_LINK_COUNTS = ("packets_received", "packets_lost", "packets_rejected", "followings", "holds")
_COLUMN = columns(SLAVE)


def read_status(ring_folder: Path) -> dict[str, Any]:
    """Return the status of the daemon of this ring folder; an unknown value is None."""
    description = json.loads((ring_folder / DESCRIPTION).read_text(encoding="utf-8"))
    row = RingReader(ring_folder / SLAVE_RING).newest()
    values = {} if row is None else {name: float(row[_COLUMN[name]]) for name in _COLUMN}
    fault = FAULTS[int(values.get("fault", 0))]
    timing = TimingHistograms(ring_folder)
    recorder = (
        _NO_RECORDER | (found(ring_folder / RECORDER_STATE) or {}) | kept(ring_folder, "recorder")
    )
    commands = kept(ring_folder, "commands")
    return {
        **description,
        "ring_folder": str(ring_folder),
        "state": State(int(values.get("state", State.BOOT))).name,
        "fault": {
            "code": fault.code,
            "name": fault.name,
            "cause": fault.cause,
            "next_step": fault.next_step,
        },
        "last_fault": found(ring_folder / LAST_FAULT),
        "tick": int(values.get("tick", 0)),
        **{name: _plain(values.get(name)) for name in _SHOWN},
        "link": _link(values),
        "timing_us": {kind: timing.quantiles(kind) for kind in KINDS},
        "recorder": recorder,
        "commands": commands,
        "alarms": [
            *_of_reload(description.get("reload_refused")),
            *_silence(recorder),
            *of_recorder(recorder),
            *of_helper("command server", commands),
            *unwatched(ring_folder),
        ],
    }


def _link(values: Mapping[str, float]) -> dict[str, Any]:
    """Return the state of the link from the loop's last row, its only report."""
    name, cause = TROUBLES[int(values.get("trouble", 0))]
    return {
        "trouble": name or None,
        "cause": cause or None,
        "silence_ms": _plain(values.get("silence_ms")),
        **{count: int(values.get(count, 0)) for count in _LINK_COUNTS},
    }


def _plain(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _of_reload(refusal: str | None) -> Iterator[str]:
    if refusal:
        yield (
            f"the reloaded config was refused: {refusal}; the previous config runs:"
            " correct the file and reload again"
        )


def unwatched(ring_folder: Path) -> Iterator[str]:
    """Return alarms about killed keepers: the loop restarts nothing."""
    helpers = {
        "recorder": ("records no more", "records on, but no recorder follows one that ends"),
        "commands": ("takes no more commands", "takes commands until its command server ends"),
    }
    for name, (ended, alone) in helpers.items():
        if not watched(ring_folder, name):
            consequence = alone if goes_on(ring_folder, name) else ended
            yield (
                f"the keeper of the {name} was killed: the daemon {consequence}; end it with "
                "SIGTERM (`systemctl stop`), which stops the axis, and start it again"
            )


def _silence(recorder: Mapping[str, Any]) -> Iterator[str]:
    if recorder["stamp_ns"] is None:
        return
    silent_s = (time.monotonic_ns() - recorder["stamp_ns"]) * 1e-9
    if silent_s > _SILENT_S:
        yield (
            f"the recorder has been silent for {silent_s:.0f} s: rows beyond the last "
            "seconds are lost until it comes back; if it does not, start the daemon again"
        )
