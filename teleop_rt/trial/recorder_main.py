"""The main of the recorder's process: it needs the rings and their descriptions, no trial."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from teleop_rt.config.section import Units
from teleop_rt.interrupts import StopRequest
from teleop_rt.realtime.parent import Emit, emit_to_parent, emitting_problems, end_with_parent
from teleop_rt.realtime.recording import ONLINE, RUN, SIMULATED
from teleop_rt.realtime.ring_folder import LAST_FAULT, Recorder, description
from teleop_rt.realtime.rotation import RotatingWriter, sizes_of
from teleop_rt.realtime.state_file import found
from teleop_rt.trial.event_log import EventLog
from teleop_rt.trial.folder import RECORDING

_PERIOD_S = 0.05
"""Time between two writes; the rings hold far more."""
_POLL_S = 0.01
"""Between two reads of a ring folder that is not described yet."""


def main(arguments: Sequence[str]) -> None:
    """Record a ring folder, the first argument, into a run folder, the second, until SIGTERM."""
    ring_folder, folder = map(Path, arguments)
    end_with_parent()
    with emitting_problems(emit_to_parent):
        emit_to_parent("done", **recorder_main(ring_folder, folder, StopRequest(), emit_to_parent))


def recorder_main(
    ring_folder: Path, folder: Path, should_stop: Callable[[], bool], emit: Emit
) -> dict[str, Any]:
    """Record every ring of the folder until a stop request, then their remaining rows.

    It begins as soon as the run is described, which may be after this process was started.
    """
    while (metadata := description(ring_folder)) is None:
        if should_stop():
            return {"dropped": {}, "alarm": ""}
        time.sleep(_POLL_S)
    online = metadata[ONLINE]
    units = Units.model_validate(
        {"position": online["position_unit"], "force": online["force_unit"]}
    )
    log = EventLog(simulated=SIMULATED in metadata.get(RUN, {}))
    writer = RotatingWriter(folder / RECORDING, units, metadata, sizes_of(metadata))
    recorder = Recorder(ring_folder, writer, log.watchers)
    emit("ready")
    logged = False
    try:
        while not should_stop():
            recorder.discover()
            recorder.drain()
            recorder.flush()
            recorder.publish_state()
            _watch_devices(log, ring_folder)
            if recorder.alarm and not logged:
                log.write("alarm", time.monotonic_ns(), alarm=recorder.alarm)
            logged = bool(recorder.alarm)
            time.sleep(_PERIOD_S)
    finally:
        recorder.close()
        _watch_devices(log, ring_folder)
    return {"dropped": recorder.dropped, "alarm": recorder.alarm}


def _watch_devices(log: EventLog, ring_folder: Path) -> None:
    """Log a device's report of its fault: the loop leaves it, and logs nothing itself."""
    if (last := found(ring_folder / LAST_FAULT)) is not None:
        log.watch_devices(last["said"], last["stamp_ns"], last.get("traceback", ""))
