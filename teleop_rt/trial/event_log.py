"""The log of a run, one JSON object a line, written outside the loop's process.

The recorder sees every row of the slave; a change of its safety state or fault becomes an event
here, so the loop itself never logs; of the master, trouble with the link, engagement, refused
models, energy of adoptions and walls that its device cannot render.
"""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from teleop_rt.link.troubles import TROUBLES
from teleop_rt.master.engagement import LinkState
from teleop_rt.master.handle_faults import HANDLE_FAULTS
from teleop_rt.signals import MASTER, MASTER_TOPIC, SLAVE, SLAVE_TOPIC, columns
from teleop_rt.slave.faults import FAULTS, HELD_BY, State
from teleop_rt.slave.simulated_advice import next_step_of

_COLUMN = columns(SLAVE)
_STAMP, _STATE, _FAULT = _COLUMN["stamp_ns"], _COLUMN["state"], _COLUMN["fault"]
_MASTER = columns(MASTER)
_REDUCED = ("true_stiffness", "rendered_stiffness", "true_damping", "rendered_damping")
_WATCHED = [
    _MASTER[name]
    for name in (
        "trouble",
        "state",
        "blend",
        "adoption_energy",
        "refused_models",
        "handle_fault",
        *_REDUCED,
    )
]
_CONTACT, _SURFACE = _COLUMN["contact_id"], _COLUMN["surface"]
_INADEQUATE, _HELD_BY = _COLUMN["inadequate"], _COLUMN["held_by"]


class EventLog:
    """Writes events to log.jsonl, or to standard error where that is already the log.

    `simulated` says whether the rig is: the next steps are then those that a simulation has.
    """

    def __init__(self, path: Path | None = None, *, simulated: bool) -> None:
        self._simulated = simulated
        self._file: TextIO = path.open("a", encoding="utf-8") if path else sys.stderr
        self._state = self._fault = -1
        self._contact_id = self._inadequate = 0
        self._said_ns = 0
        self._adoption_J, self._trouble, self._reduced = 0.0, 0, False
        self._handle_fault = 0
        self._engaged, self._refused_logged = LinkState.WAITING, False
        self._watched = np.zeros((1, len(_WATCHED)))

    @property
    def watchers(self) -> dict[str, Callable[[NDArray[np.float64]], None]]:
        """The watchers of each topic's rows."""
        return {SLAVE_TOPIC: self.watch_slave, MASTER_TOPIC: self.watch_master}

    def write(self, event: str, stamp_ns: int, **content: Any) -> None:
        """Write one event; a disk that is full loses it, and nothing else."""
        line = json.dumps({"stamp_ns": stamp_ns, **content, "event": event})
        with contextlib.suppress(OSError):
            print(line, file=self._file, flush=True)

    def watch_slave(self, rows: NDArray[np.float64]) -> None:
        """Log changes of state, fault, contact and of the model's adequacy.

        `rows` are (n, columns of SLAVE).
        """
        codes = rows[:, [_STATE, _FAULT, _CONTACT, _INADEQUATE]]
        last = [self._state, self._fault, self._contact_id, self._inadequate]
        before = np.vstack((last, codes[:-1]))
        for index in np.flatnonzero(np.any(codes != before, axis=1)):
            self._log_slave(rows[index])
            now = (int(code) for code in codes[index])
            self._state, self._fault, self._contact_id, self._inadequate = now

    def watch_master(self, rows: NDArray[np.float64]) -> None:
        """Log link trouble, engagement, adoptions that took energy, and walls rendered reduced.

        `rows` are (n, columns of MASTER). An adoption ends when its blend has come to 1.
        """
        watched = rows[:, _WATCHED]
        before = np.vstack((self._watched, watched[:-1]))
        for index in np.flatnonzero(np.any(watched != before, axis=1)):
            self._log_master(rows[index])
        if watched.size:
            self._watched = watched[-1:]

    def watch_devices(self, said: str, stamp_ns: int, traceback: str = "") -> None:
        """Log a device's own report of its fault at this stamp, or its driver's error, once."""
        if said and stamp_ns != self._said_ns:
            more = {"traceback": traceback} if traceback else {}
            self.write("device", stamp_ns, said=said, **more)
            self._said_ns = stamp_ns

    def close(self) -> None:
        """Close the file, if it is ours."""
        if self._file is not sys.stderr:
            self._file.close()

    def _log_slave(self, row: NDArray[np.float64]) -> None:
        stamp_ns = int(row[_STAMP])
        if int(row[_STATE]) != self._state:
            state = State(int(row[_STATE]))
            why = {"cause": HELD_BY[int(row[_HELD_BY])]} if state == State.HOLD else {}
            self.write("state", stamp_ns, state=state.name, **why)
        if int(row[_FAULT]) not in {self._fault, 0}:
            fault = FAULTS[int(row[_FAULT])]
            step = next_step_of(fault, simulated=self._simulated)
            self.write("fault", stamp_ns, fault=fault.name, cause=fault.cause, next_step=step)
        if int(row[_CONTACT]) > self._contact_id:
            surface = float(row[_SURFACE])
            self.write(
                "contact",
                stamp_ns,
                contact_id=int(row[_CONTACT]),
                surface=surface if np.isfinite(surface) else None,
            )

        if int(row[_INADEQUATE]) != self._inadequate:
            self.write("model inadequate" if row[_INADEQUATE] else "model adequate", stamp_ns)

    def _log_master(self, row: NDArray[np.float64]) -> None:
        stamp_ns, trouble = int(row[_MASTER["stamp_ns"]]), int(row[_MASTER["trouble"]])
        if trouble not in {self._trouble, 0}:
            name, cause = TROUBLES[trouble]
            self.write("link", stamp_ns, trouble=name, cause=cause)
        self._trouble = trouble
        code = int(row[_MASTER["handle_fault"]])
        if code not in {self._handle_fault, 0}:
            fault = HANDLE_FAULTS[code]
            self.write(
                "fault", stamp_ns, fault=fault.name, cause=fault.cause, next_step=fault.next_step
            )
        self._handle_fault = code
        self._log_engagement(row, stamp_ns)
        energy_J = float(row[_MASTER["adoption_energy"]])
        if row[_MASTER["blend"]] >= 1 and energy_J > self._adoption_J:
            sequence = int(row[_MASTER["model_sequence"]])
            spent_J = energy_J - self._adoption_J
            self.write("adoption", stamp_ns, energy_J=spent_J, model_sequence=sequence)
            self._adoption_J = energy_J
        values = {name: float(row[_MASTER[name]]) for name in _REDUCED}
        reduced = (
            values["rendered_stiffness"] < values["true_stiffness"]
            or values["rendered_damping"] < values["true_damping"]
        )
        if reduced and not self._reduced:
            self.write("passivity", stamp_ns, **values)
        self._reduced = reduced

    def _log_engagement(self, row: NDArray[np.float64], stamp_ns: int) -> None:
        """Log a change of engagement, and the first refused model; the others are counted."""
        engaged = LinkState(int(row[_MASTER["state"]]))
        if engaged != self._engaged:
            silence_ms = float(row[_MASTER["silence_ms"]])
            self.write("engagement", stamp_ns, state=engaged.name, silence_ms=silence_ms)
        self._engaged = engaged
        if row[_MASTER["refused_models"]] > 0 and not self._refused_logged:
            self._refused_logged = True
            self.write("models refused", stamp_ns)
