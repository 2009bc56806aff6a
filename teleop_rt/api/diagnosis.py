"""The result of a diagnosis as objects, with the content that `teleop-rt diagnose` prints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from teleop_rt.api.model import ExtendedModel, model_of
from teleop_rt.api.source import File, Source, opened
from teleop_rt.api.values import Parameter, named, number, table
from teleop_rt.contact.effects.user import library
from teleop_rt.diagnosis.answers import extended
from teleop_rt.diagnosis.diagnose import diagnose as diagnose_recording
from teleop_rt.diagnosis.inference.rounds import Diagnosis as Found
from teleop_rt.offline.write import write_diagnosis
from teleop_rt.outputs import refuse_file, refuse_unwritable
from teleop_rt.recordings.recording import Recording, refuse_other_units
from teleop_rt.trial.folder import recording_of

Test = Source | None
Effects = File | None


@dataclass(frozen=True, slots=True, repr=False)
class NamedEffect:
    """An effect that was found, with its parameters; `belongs_to` the environment or the rig."""

    name: str
    law: str
    belongs_to: str
    parameters: Mapping[str, Parameter]

    def __repr__(self) -> str:
        return f"<{self.name} ({self.belongs_to}): {named(self.parameters)}>"


@dataclass(frozen=True, slots=True, repr=False)
class Diagnosis:
    """A verdict on a recording, and the model extended by the effects found.

    `answer` is the whole result, JSON-ready. `possible` are the sets of effects that the data
    cannot distinguish; `nrmse_before` and `nrmse_after` the held-out errors of the base and of the
    model.
    """

    answer: Mapping[str, Any]
    model: ExtendedModel
    _found: Found = field(compare=False)
    _recording: Recording = field(compare=False)
    _path: Path = field(compare=False)

    @property
    def verdict(self) -> str:
        """One of no_missing_effect, named, class, partial, unexplained."""
        return str(self.answer["verdict"])

    @property
    def effects(self) -> tuple[NamedEffect, ...]:
        """The effects that were found, those of the first set of a class."""
        return tuple(
            NamedEffect(one["name"], one["law"], one["belongs_to"], _parameters(one))
            for one in self.answer["effects"]
        )

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The parameters of the base beside the effects."""
        return _parameters(self.answer["base"])

    @property
    def possible(self) -> tuple[tuple[str, ...], ...]:
        """The sets of effects that explain the data alike."""
        return tuple(tuple(names) for names in self.answer["class"])

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks that belong to the verdict."""
        return tuple(self.answer["notes"])

    @property
    def nrmse_before(self) -> float | None:
        """Held-out error of the base alone over the force's range."""
        return self._error("before")

    @property
    def nrmse_after(self) -> float | None:
        """Held-out error of the extended model over the force's range."""
        return self._error("after")

    def _error(self, which: str) -> float | None:
        error: float | None = self.answer["error"][which]
        return error

    def write(self, folder: File) -> Path:
        """Write page, extended model and proposed motion; return the folder.

        Raises OutputError where it is a file, or nothing can be written into it.
        """
        refuse_file(Path(folder), "name another folder")
        refuse_unwritable(Path(folder), "name another folder")
        write_diagnosis(self._found, self._recording, self._path, Path(folder))
        return Path(folder)

    def __repr__(self) -> str:
        names = ", ".join(one.name for one in self.effects) or "no effect"
        errors = f"NRMSE {number(self.nrmse_before)} → {number(self.nrmse_after)}"
        return f"<Diagnosis: {self.verdict.replace('_', ' ')}: {names}; {errors}>"

    def _repr_html_(self) -> str:
        rows = [("base", self.answer["base"]["model"], named(self.parameters))]
        rows += [(one.belongs_to, one.name.replace("_", " "), named(one.parameters))
                 for one in self.effects]  # fmt: skip
        rows.append(("error", "NRMSE before → after",
                     f"{number(self.nrmse_before)} → {number(self.nrmse_after)}"))  # fmt: skip
        rows += [("note", "", note) for note in self.notes]
        caption = f"{self.answer['recording']}: {self.verdict.replace('_', ' ')}"
        return table(caption, ("", "name", "values"), rows)


def diagnose(
    source: Source, base: str = "kelvin-voigt", *, test: Test = None, effects: Effects = None
) -> Diagnosis:
    """Find the force that a base model leaves unexplained in a recording, and name its effect.

    `base` is a model id, or terms joined by commas. The errors are on `test` where it is given,
    else on held-out blocks. `effects` is a Python file with effects of the user's. Raises
    ExpectedError and ValueError with one clear message each.
    """
    recording, unseen = opened(source), None
    if test is not None:
        unseen = opened(test)
        refuse_other_units(unseen, recording)
    known = library(None if effects is None else Path(effects))
    found = diagnose_recording(recording, base, test=unseen, effects=known)
    model = model_of(recording.name, extended.document(found.answer), known)
    path = Path(recording.name) if isinstance(source, Recording) else recording_of(Path(source))
    return Diagnosis(found.answer, model, found, recording, path)


def _parameters(entry: Mapping[str, Any]) -> dict[str, Parameter]:
    return {name: Parameter.of(one) for name, one in entry["parameters"].items()}
