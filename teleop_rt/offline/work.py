"""The work of `replay` and `diagnose` on each recording."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.contact.effects.user import library
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.draft.declaration import drafted_from
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.phases import enter
from teleop_rt.diagnosis.samples.exchanged import exchange_note, stands_beside_refusals
from teleop_rt.errors import FAULT, ExpectedError
from teleop_rt.offline.drafting import write_draft
from teleop_rt.offline.find import digest_of, refuse_itself
from teleop_rt.offline.load import load_any
from teleop_rt.offline.replay import Choice, replay, write_trace
from teleop_rt.offline.table import Table
from teleop_rt.offline.weak_force import weak_force
from teleop_rt.offline.write import write_diagnosis
from teleop_rt.outputs import unwritable, whole_or_nothing
from teleop_rt.realtime.scheduling import give_back_compiler
from teleop_rt.recordings.excerpt import most_active
from teleop_rt.recordings.memory import return_large_arrays
from teleop_rt.recordings.recording import Recording, refuse_other_units
from teleop_rt.trial.folder import recording_of


def _digest(effects: Path | None) -> str | None:
    """Return the digest of a file with effects, None without one."""
    return None if effects is None else hashlib.blake2b(effects.read_bytes()).hexdigest()


class UnwrittenError(ExpectedError):
    """The files of an answer could not be written; the answer is in `answer`."""

    code = FAULT

    def __init__(self, message: str, answer: dict[str, Any]) -> None:
        super().__init__(message)
        self.answer = answer


def _lasting(answer: Mapping[str, Any], recording: Path) -> dict[str, Any]:
    """Return an answer without its duration, and with its recording."""
    return {key: value for key, value in answer.items() if key != "seconds"} | {
        "recording": str(recording)
    }


@dataclass(frozen=True, slots=True)
class Replaying:
    """Run the estimators; `trace` is the NPZ file for parameters over time.

    `effects` is a Python file with effects of the user's, for recordings that ran with them. Of
    `several` recordings each has a trace of its own, named after it.
    """

    choice: Choice
    table: Table
    trace: Path | None = None
    effects: Path | None = None
    several: bool = False
    command: str = "replay"
    fills_folder: bool = False
    seconds_each: float = 0.5

    def options(self) -> dict[str, Any]:
        """Return all that an answer depends on beside the recording.

        Raises ExpectedError for a name that is unknown, before any recording is opened.
        """
        try:
            self.choice.rows()
        except ValueError as error:
            raise ExpectedError(str(error)) from None
        library(self.effects)
        return {"choice": asdict(self.choice), "table": asdict(self.table),
                "trace": None if self.trace is None else str(self.trace),
                "effects": _digest(self.effects)}  # fmt: skip

    def answer(self, recording: Path, name: str) -> dict[str, Any]:
        """Return the estimators' answer."""
        path = recording_of(recording)
        enter(f"estimators over {recording.name}")
        traces = self.trace is not None
        answer, over_time = replay(path, self.choice, self.table, self.effects, traces=traces)
        if self.trace is not None:
            trace = self._trace(name)
            try:
                write_trace(trace, over_time)
            except OSError as error:
                problem = str(unwritable(trace, error, "name another file with --trace"))
                raise UnwrittenError(problem, answer) from None
        return answer

    def written(self, name: str) -> bool:
        """Return whether the trace is there, where one was asked for."""
        return self.trace is None or self._trace(name).is_file()

    def _trace(self, name: str) -> Path:
        if self.trace is None:
            raise ValueError("no trace was asked for")
        return self.trace.with_stem(f"{self.trace.stem}-{name}") if self.several else self.trace


@dataclass(frozen=True, slots=True)
class Diagnosing:
    """Diagnose; `test` is the recording for the error, `effects` a file with the user's effects.

    Of `several` recordings each has a folder of its own below `out`, named after it.
    """

    base: str
    surface: float | None
    table: Table
    test: Path | None = None
    effects: Path | None = None
    out: Path | None = None
    several: bool = False
    command: str = "diagnose"
    fills_folder: bool = True
    seconds_each: float = 10.0

    def options(self) -> dict[str, Any]:
        """Return all that an answer depends on beside the recording.

        Raises ExpectedError for options that cannot be, before any recording is opened.
        """
        base_of(self.base)
        library(self.effects)
        if self.test is not None:
            load_any(recording_of(self.test), self.table)
        return {
            "base": self.base,
            "surface": self.surface,
            "table": asdict(self.table),
            "test": None if self.test is None else digest_of(self.test),
            "effects": _digest(self.effects),
        }

    def answer(self, recording: Path, name: str) -> dict[str, Any]:
        """Return the diagnosis' answer without its duration: the same data, the same answer."""
        path = recording_of(recording)
        enter(f"reading {recording.name}")
        give_back_compiler()  # its kernels read the parts that they need again, two fifths of it
        return_large_arrays()
        if self.test is not None:
            refuse_itself(path, recording_of(self.test))
        loaded = load_any(path, self.table)
        unseen = None
        if self.test is not None:
            unseen = load_any(recording_of(self.test), self.table)
            refuse_other_units(unseen, loaded)
        # Before the diagnosis, which takes as much memory as an hour's columns, and needs a part.
        hints = (exchange_note(loaded), weak_force(loaded) if path.suffix != ".mcap" else None)
        loaded, _ = most_active(loaded)
        with stands_beside_refusals(hints[0]):
            found = diagnose(
                loaded, self.base, test=unseen, effects=library(self.effects), surface=self.surface
            )
        found.answer["notes"] += [hint for hint in hints if hint is not None]
        found.answer["notes"] += self._of_own_draft(found.answer, loaded)
        if self.out is not None:
            self._write(found, loaded, unseen, path, self._folder(name))
        return _lasting(found.answer, path)

    def _write(
        self, found: Diagnosis, loaded: Recording, unseen: Recording | None, path: Path, out: Path
    ) -> None:
        """Write page, model and draft into a folder. Raises UnwrittenError with the answer."""
        enter("writing page and model")
        plain = deepcopy(found.answer)  # names no file that could not be written
        try:
            with whole_or_nothing(out):
                write_draft(found, loaded, out, unseen, self.surface, self.effects)
                write_diagnosis(found, loaded, path, out)
        except OSError as error:
            raise UnwrittenError(str(unwritable(out, error)), _lasting(plain, path)) from None

    def _of_own_draft(self, answer: dict[str, Any], recording: Recording) -> list[str]:
        """Return the note on an effect that was drafted from the recording that it explains."""
        shipped = {effect.name for effect in LIBRARY}
        own = [one["name"] for one in answer["effects"] if one["name"] not in shipped]
        if self.effects is None or not own or not drafted_from(self.effects, recording):
            return []
        note = (
            f"{' and '.join(own)} may be drafted from this recording, so that it fits here proves"
            " nothing, whatever its probability: judge it on another recording"
        )
        return [note]

    def written(self, name: str) -> bool:
        """Return whether the extended model is there, where it was asked for."""
        return self.out is None or (self._folder(name) / "model.yaml").is_file()

    def _folder(self, name: str) -> Path:
        if self.out is None:
            raise ValueError("no folder was asked for")
        return self.out / name if self.several else self.out
