"""A run folder as the report reads it: its config, counts, recording and log."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.estimation.report import KEYS
from teleop_rt.realtime.mcap_index import count_messages
from teleop_rt.realtime.reading import read_topics
from teleop_rt.trial.felt_force import SIGNALS as FELT_SIGNALS
from teleop_rt.trial.felt_force import Felt
from teleop_rt.trial.folder import LOG, RECORDING, TRIAL, recording_of
from teleop_rt.trial.grades import WHOLE_S
from teleop_rt.view.gaps import without_held

TOPICS = ("/slave", "/master", "/estimates/")
MOST_ROWS = {"/slave": 600_000, "/master": 600_000, "/estimates/": 60_000}
"""So many are read one by one: ten minutes of ticks at 1 kHz; estimates are only drawn, on paper a
few thousand dots wide."""
ROWS_OF_LONGER = {"/slave": 150_000, "/master": 150_000, "/estimates/": 30_000}
"""Of a longer run one in 2, 4, 8, ... is read, down to these: six times the points of a curve on
the screen. To read 600 000 took half of the time of a report."""
MOVING = frozenset({"ARMED", "RUN", "HOLD"})
"""States of the slave in which no run ends by itself."""
MASTER_SIGNALS = (*FELT_SIGNALS, "model_sequence", "port_energy", "adoption_energy")
_SIGNALS = {
    "/slave": (
        "stamp_ns",
        "tick",
        "state",
        "fault",
        "valid",
        "force",
        "filtered_force",
        "predicted_force",
        "position",
        "target",
        "surface",
        "in_contact",
        "inadequate",
        "model_sequence",
        "wake_latency_us",
        "work_us",
    ),
    "/master": MASTER_SIGNALS,
}
"""Columns of either side in a report: fifty columns of an hour would fill the memory."""
Columns = Mapping[str, NDArray[np.float64]]
FeltOf = Callable[[Path, Columns, Columns], Felt | None]
"""(run folder, slave's ticks, master's ticks) -> felt force beside the true one, None unknown."""


@dataclass(frozen=True)
class Run:
    """One run; `trial` is trial.yaml as plain data, so that any version's can be read."""

    folder: Path
    trial: Mapping[str, Any]
    summary: Mapping[str, Any]
    topics: Mapping[str, Columns]
    events: list[dict[str, Any]]
    felt: Felt | None = None
    """Felt force beside the true one; None where the environment is not known."""
    lacks: str = ""
    """Sentence on the missing part of the recording; empty where it is whole."""

    @property
    def slave(self) -> Columns:
        """Every tick of the slave."""
        return self.topics["/slave"]

    @property
    def master(self) -> Columns:
        """Every tick of the master; empty where it did not run or was not recorded."""
        return self.topics.get("/master", {})

    @property
    def rig(self) -> Mapping[str, Any]:
        """The rig's config as plain data."""
        rig: Mapping[str, Any] = self.trial["rig"]
        return rig

    @property
    def units(self) -> Units:
        """The rig's units of position and force."""
        return Units.model_validate(self.rig["units"])

    @property
    def period_s(self) -> float:
        """The period of the slave's loop."""
        return 1.0 / float(self.rig["rate_hz"])

    @property
    def step(self) -> int:
        """How many ticks apart the rows are: more than 1 where the run was too long to read."""
        ticks = self.slave["tick"]
        return max(1, int(np.median(np.diff(ticks)))) if ticks.size > 1 else 1

    @property
    def start_ns(self) -> float:
        """When the slave's first tick began, on its clock."""
        return float(self.slave["stamp_ns"][0])

    @property
    def force_noise(self) -> float:
        """Noise of the force sensor by the rig's config."""
        return float(self.rig["sensors"][f"force_noise_{self.units.force}"])

    @cached_property
    def residual(self) -> NDArray[np.float64]:
        """Measured minus predicted force of each tick, as the estimators see them; else NaN."""
        measured: NDArray[np.float64] = self.slave["filtered_force"]
        return measured - self.slave["predicted_force"]

    @cached_property
    def settled(self) -> NDArray[np.bool_]:
        """The second half of the contact that followed the settling of the selected model.

        Earlier samples show how the estimate converged, not a missing effect.
        """
        in_contact = self.slave["in_contact"] > 0
        chosen = selected_row(self.summary)
        if chosen is None or chosen["convergence_s"] is None:
            return np.zeros(in_contact.shape, dtype=np.bool_)
        contact_s = np.cumsum(in_contact) * self.period_s * self.step
        settled_s = 0.5 * (float(chosen["convergence_s"]) + float(contact_s[-1]))
        settled: NDArray[np.bool_] = in_contact & (contact_s >= settled_s)
        return settled


def selected_row(summary: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the estimator that is streamed to the master, None where none is."""
    chosen = summary["selected"]
    for row in summary["estimators"]:
        if chosen and all(row.get(key) == chosen.get(key) for key in KEYS):
            found: Mapping[str, Any] = row
            return found
    return None


def read_recorded(folder: Path) -> Mapping[str, Columns]:
    """Return the topics of a run's recording, as far as it can be read. Raises RecordingError."""
    recording = folder / RECORDING
    if not folder.is_dir():
        what = "a file" if folder.exists() else "no such folder"
        raise RecordingError(f"{folder}: {what}: give a folder that `teleop-rt run` has written")
    recording_of(folder)
    whole = count_messages(recording).get("/slave", 0) <= MOST_ROWS["/slave"]
    topics = read_topics(recording, TOPICS, _SIGNALS, MOST_ROWS if whole else ROWS_OF_LONGER)
    if "/slave" not in topics and "/master" in topics:
        raise RecordingError(
            f"{folder}: the master ran alone here and was cut off, and a report needs both sides: "
            f"`teleop-rt live {folder}` shows this recording"
        )
    if "/slave" not in topics:
        raise RecordingError(
            f"{recording}: has no tick of a slave: the run ended before its first one; run it again"
        )
    return topics


def read_every_tick(folder: Path) -> Columns:
    """Return the data to rebuild a summary from: every tick of the slave, however many."""
    names = {"/slave": ("tick", "state", "fault", "wake_latency_us", "work_us")}
    return read_topics(folder / RECORDING, ["/slave"], names)["/slave"]


def lacks_ticks(summary: Mapping[str, Any], slave: Columns) -> bool:
    """Return whether a recording has fewer ticks, or a shorter time, than its summary was made of.

    Ticks of a longer run are not all read, and only their time is compared.
    """
    recorded_s = float(slave["stamp_ns"][-1] - slave["stamp_ns"][0]) * 1e-9
    if summary["duration_s"] - recorded_s > WHOLE_S:
        return True
    return bool(slave["tick"].size < summary["ticks"] <= MOST_ROWS["/slave"])


def lacking(rebuilt: Mapping[str, Any], written: Mapping[str, Any] | None) -> str:
    """Return the sentence on a missing part, from the summary of the rest and that of the run."""
    recorded_s, planned_s = rebuilt["duration_s"], rebuilt["planned_s"]
    if written is not None:
        lost = "cut off" if written["duration_s"] - recorded_s > WHOLE_S else "damaged"
        return (
            f"The recording is {lost}: {recorded_s:.1f} of {written['duration_s']:.1f} s of the run"
            f" and {rebuilt['ticks']} of {written['ticks']} ticks can be read, and only these are"
            " judged."
        )
    recorded = f"{recorded_s:.1f} of {planned_s:g} s are recorded."
    if rebuilt["safety"]["state"] in MOVING:
        return f"Cut off in state {rebuilt['safety']['state']}, before its end: {recorded}"
    return f"The run did not report its end: {recorded}"


def load_run(
    folder: Path,
    summary: Mapping[str, Any],
    topics: Mapping[str, Columns],
    felt_of: FeltOf = lambda _folder, _slave, _master: None,
) -> Run:
    """Return a run folder with its summary and its recorded topics. Raises RecordingError.

    `felt_of` is asked for the felt force where every tick was read. Values that the slave held
    while samples were lost are not-a-number.
    """
    run = Run(folder, read_trial(folder), summary, topics, read_events(folder / LOG))
    felt = None if run.step > 1 or not run.master else felt_of(folder, run.slave, run.master)
    return replace(run, topics={**topics, "/slave": without_held(run.slave)}, felt=felt)


def read_trial(folder: Path) -> Mapping[str, Any]:
    """Return trial.yaml as plain data. Raises RecordingError where it is none."""
    path = folder / TRIAL
    try:
        trial = yaml.safe_load(path.read_text(encoding="utf-8"))
        needed = trial["rig"]["units"], trial["rig"]["rate_hz"], trial["name"]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
        raise RecordingError(
            f"{path}: not the trial of a run: {error}"
            "; give a folder that `teleop-rt run` has written"
        ) from None
    assert all(needed)  # noqa: S101 - read above, so that a missing key is reported
    return dict(trial)


def read_events(log: Path) -> list[dict[str, Any]]:
    """Return the events of a log; other lines that processes printed become `output` events."""
    if not log.is_file():
        return []
    return [_event(text) for text in log.read_text("utf-8", errors="replace").splitlines()]


def _event(text: str) -> dict[str, Any]:
    try:
        event = json.loads(text)
    except ValueError:
        event = None
    complete = isinstance(event, dict) and "event" in event
    return dict(event) if complete else {"event": "output", "text": text}
