"""The log of a run, one JSON object a line, written outside the loop's process.

The recorder sees every row of the slave; a change of its safety state or fault becomes an event
here, so the loop itself never logs.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import structlog
from numpy.typing import NDArray

from teleop_rt.signals import SLAVE, columns
from teleop_rt.slave.faults import FAULTS, State

_COLUMN = columns(SLAVE)
_STAMP, _STATE, _FAULT = _COLUMN["stamp_ns"], _COLUMN["state"], _COLUMN["fault"]
_CONTACT, _SURFACE = _COLUMN["contact_id"], _COLUMN["surface"]


class EventLog:
    """Writes events to log.jsonl, or to standard error where that is already the log."""

    def __init__(self, path: Path | None = None) -> None:
        self._file: TextIO = path.open("a", encoding="utf-8") if path else sys.stderr
        self._log: Any = structlog.wrap_logger(
            structlog.PrintLogger(self._file),
            processors=[structlog.processors.JSONRenderer()],
        )
        self._state = self._fault = -1
        self._contact_id = 0

    def write(self, event: str, stamp_ns: int, **content: Any) -> None:
        """Write one event."""
        self._log.info(event, stamp_ns=stamp_ns, **content)

    def watch_slave(self, rows: NDArray[np.float64]) -> None:
        """Tell changes of state, fault and contact in rows (n, columns of SLAVE)."""
        codes = rows[:, [_STATE, _FAULT, _CONTACT]]
        before = np.vstack(([self._state, self._fault, self._contact_id], codes[:-1]))
        for index in np.flatnonzero(np.any(codes != before, axis=1)):
            self._tell(rows[index])
            self._state, self._fault, self._contact_id = (int(code) for code in codes[index])

    def close(self) -> None:
        """Close the file, if it is ours."""
        if self._file is not sys.stderr:
            self._file.close()

    def _tell(self, row: NDArray[np.float64]) -> None:
        stamp_ns = int(row[_STAMP])
        if int(row[_STATE]) != self._state:
            self.write("state", stamp_ns, state=State(int(row[_STATE])).name)
        if int(row[_FAULT]) not in {self._fault, 0}:
            fault = FAULTS[int(row[_FAULT])]
            self.write(
                "fault", stamp_ns, fault=fault.name, cause=fault.cause, next_step=fault.next_step
            )
        if int(row[_CONTACT]) > self._contact_id:
            surface = float(row[_SURFACE])
            self.write(
                "contact",
                stamp_ns,
                contact_id=int(row[_CONTACT]),
                surface=surface if np.isfinite(surface) else None,
            )
