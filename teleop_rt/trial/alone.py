"""A side of a trial that was started alone: its rings, its recorder, and its command server."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from teleop_rt.config.trial import TrialConfig
from teleop_rt.link.troubles import NOTHING_TROUBLE, TROUBLES
from teleop_rt.realtime.alarms import of_helper, of_recorder
from teleop_rt.realtime.ring_folder import describe, new_ring_folder
from teleop_rt.service.keeper import kept
from teleop_rt.service.place import Claim
from teleop_rt.service.status import DESCRIPTION
from teleop_rt.trial.estimators import recording_metadata
from teleop_rt.trial.folder import LOG, date_of, write_json
from teleop_rt.trial.processes import Child, TrialProcesses, start_recorder

SERVER = "commands"
_SERVER_MODULE = "teleop_rt.service.server"
_NO_REPORT: dict[str, Any] = {
    "dropped": None,
    "alarm": "the recorder's keeper was killed: nothing was recorded from then on",
}


@dataclass(slots=True)
class Alone:
    """The helpers of a side that runs alone."""

    side: str
    trial_name: str
    trial_file: Path
    overrides: list[str]
    folder: Path
    ring_folder: Path
    processes: TrialProcesses
    recorder: Child

    @contextmanager
    def commanded(self, claim: Claim, rig_name: str, reached_by: Sequence[str]) -> Iterator[None]:
        """Hold the rig, and let `teleop-rt arm` and its like reach this process.

        Raises BusyError where another daemon holds the rig.
        """
        place = claim.take(rig_name, reached_by, self.ring_folder)
        folder_and_socket = [str(self.ring_folder), str(place.socket)]
        server = self.processes.start_kept(
            SERVER, self.ring_folder, _SERVER_MODULE, folder_and_socket
        )
        try:
            yield
        finally:
            self.processes.end([server.name])

    def describe(self, trial: TrialConfig, privileges: list[str], refusal: str) -> None:
        """Write this process's description for `status` into the ring folder.

        `refusal` is the reason why a reloaded config could not be started, if there was one.
        """
        content = {
            "pid": os.getpid(),
            "version": version("teleop-rt"),
            "rig": trial.rig.name,
            "trial": trial.name,
            "trial_file": str(self.trial_file.resolve()),
            "overrides": self.overrides,
            "folder": str(self.folder.resolve()),
            "rate_hz": trial.rig.rate_hz,
            "units": trial.rig.units.model_dump(),
            "privileges": privileges,
            "unsafe": trial.rig.unsafe,
            "reload_refused": refusal or None,
        }
        (self.ring_folder / DESCRIPTION).write_text(json.dumps(content), encoding="utf-8")

    def wait_ready(self) -> None:
        """Wait until recorder and command server can be relied on."""
        self.processes.wait_ready(*self.processes.children)

    def finish(self, outcome: dict[str, Any]) -> None:
        """End the recorder, then write this side's counts as its summary."""
        self.processes.end([self.recorder.name])
        recorded = self.recorder.events.get("done", _NO_REPORT)
        commands = kept(self.ring_folder, SERVER)
        notes = [*of_recorder(recorded), *of_helper("command server", commands)]
        notes += _rejected(outcome)
        counted = {
            "side": self.side,
            "trial": self.trial_name,
            **outcome,
            "recorder": recorded,
            "commands": commands,
            "notes": notes,
        }
        write_json(self.folder / "summary.json", counted)


@contextmanager
def alone(
    side: str, trial: TrialConfig, trial_file: Path, overrides: list[str], folder: Path
) -> Iterator[Alone]:
    """Give a side that was started alone its ring folder, which a process of its own records."""
    with new_ring_folder() as ring_folder:
        describe(ring_folder, recording_metadata(trial, date_of()))
        processes = TrialProcesses(folder / LOG, loop_cpu=trial.rig.realtime.cpu)
        try:
            recorder = start_recorder(processes, ring_folder, folder)
            run = (trial_file, overrides, folder, ring_folder)
            yield Alone(side, trial.name, *run, processes, recorder)
        finally:
            processes.close()


class PlainEvents:
    """Prints events of a side as lines for people."""

    def __init__(self, side: str) -> None:
        self._side = side

    def __call__(self, event: str, **content: Any) -> None:
        """Print an event; problems are printed at the end of the program.

        The truth of a simulated handle is numbers for a run's truth.json.
        """
        if event in {"problem", "truth"}:
            return
        lines = [_in_words(event, content)]
        if event == "done":
            lines += [*_rejected(content), *_unheard(content)]
        for line in lines:
            print(f"{self._side}: {line}", flush=True)


def _rejected(outcome: Mapping[str, Any]) -> list[str]:
    """Return a line on the packets that this side rejected, if there were any."""
    link = outcome.get("link") or {}
    if not link.get("rejected"):
        return []
    reasons = link.get("rejected_by_reason") or {}
    counted = ", ".join(f"{count} for {reason}" for reason, count in reasons.items() if count)
    return [f"{link['rejected']} packets were rejected: {counted}"]


def _unheard(outcome: Mapping[str, Any]) -> list[str]:
    """Return a line of a slave to which no packet came: its loop prints nothing while it runs."""
    unheard = "safety" in outcome and outcome["link"]["received"] == 0
    return [f"link: {TROUBLES[NOTHING_TROUBLE][1]}"] if unheard else []


def _in_words(event: str, content: dict[str, Any]) -> str:
    if event == "ready":
        lines = [f"  {line}" for line in content.get("privileges", ())]
        return "\n".join(["ready", *lines])
    if event == "done" and "safety" in content:
        fault = content["safety"]["fault"]
        link = content["link"]
        return (
            f"done, {content['missed_ticks']} ticks missed, {link['received']} packets received, "
            f"{content['safety']['state']}, fault: {fault['name']}"
        )
    if event == "link":
        return f"link: {content['cause']}"
    return event
