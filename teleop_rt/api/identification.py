"""All estimators, or some, over a recording: the output of `teleop-rt replay`, as objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.api.source import Source
from teleop_rt.api.values import Parameter, named, number, table
from teleop_rt.contact.effect import Vector
from teleop_rt.errors import ExpectedError
from teleop_rt.estimation.trace import Trace
from teleop_rt.offline.replay import Choice, online_of, online_of_recording, run_estimators
from teleop_rt.offline.table import Table
from teleop_rt.recordings.recording import Recording
from teleop_rt.trial.folder import recording_of

Names = str | Sequence[str] | None
_ESTIMATORS_SHOWN = 6
"""Estimators that `repr` names."""


@dataclass(frozen=True, slots=True, repr=False)
class Estimate:
    """One estimator's result: parameters by name, and how well they predict the force."""

    _report: Mapping[str, Any]
    _trace: Trace = field(compare=False)
    _row: int = field(compare=False)

    @property
    def model(self) -> str:
        """Id of the model."""
        return str(self._report["model"])

    @property
    def regression(self) -> str:
        """`direct` or `algebraic`."""
        return str(self._report["regression"])

    @property
    def solver(self) -> str:
        """Id of the solver."""
        return str(self._report["solver"])

    @property
    def status(self) -> str:
        """`warming up`, `estimated`, `held` or `restarted`."""
        return str(self._report["status"])

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The model's parameters by name, with a free offset where the surface is unknown."""
        return {name: Parameter.of(one) for name, one in self._report["parameters"].items()}

    @property
    def nrmse(self) -> float | None:
        """Error of open-loop predictions by earlier parameters, over the force's range."""
        error: float | None = self._report["nrmse"]
        return error

    @property
    def settled_s(self) -> float | None:
        """Time in contact after which the leading parameter stayed within 2 % of its last value."""
        settled: float | None = self._report["convergence_s"]
        return settled

    def trace(self, name: str) -> Vector:
        """Return a parameter over time (samples,), beside `Identification.time_s`.

        Raises KeyError for a name that the model does not have.
        """
        names = self._trace.names(self._row)
        if name not in names:
            raise KeyError(f"{name!r}: {self.model} has {', '.join(names)}")
        return self._trace.physical(self._row, name)

    def __repr__(self) -> str:
        label = ", ".join((self.model, self.regression, self.solver, self.status))
        return f"<Estimate: {label}; {named(self.parameters)}; NRMSE {_share(self.nrmse)}>"


@dataclass(frozen=True, slots=True, repr=False)
class Identification:
    """The estimates of a recording; `selected` is the one worth rendering, None without one.

    `time_s` (samples,) is the time of every trace. The note states that the residual rejects the
    models: their parameters have no deviations then, and `diagnose` names the missing effect.
    """

    name: str
    estimates: tuple[Estimate, ...]
    selected: Estimate | None
    time_s: Vector = field(compare=False)
    note: str

    def __getitem__(self, names: str | tuple[str, ...]) -> Estimate:
        """Return the first estimate of a model, or of (model, regression, solver).

        Raises KeyError where there is none.
        """
        wanted = (names,) if isinstance(names, str) else tuple(names)
        for one in self.estimates:
            if (one.model, one.regression, one.solver)[: len(wanted)] == wanted:
                return one
        models = ", ".join(dict.fromkeys(one.model for one in self.estimates))
        raise KeyError(f"no estimate {', '.join(wanted)}; models: {models}")

    def __repr__(self) -> str:
        count = len(self.estimates)
        notes = f"; {self.note.split(':')[0]}" if self.note else ""  # the rest is in `note`
        return (
            f"<Identification of {self.name}: {count} estimates, selected {self.selected}{notes}>"
        )

    def _repr_html_(self) -> str:
        ordered = sorted(
            self.estimates, key=lambda e: (e is not self.selected, e.nrmse is None, e.nrmse)
        )
        rows = [
            ("★" if one is self.selected else "", one.model, one.regression, one.solver,
             one.status, named(one.parameters), _share(one.nrmse))
            for one in ordered[:_ESTIMATORS_SHOWN]
        ]  # fmt: skip
        caption = f"{self.name}: the best {len(rows)} of {len(ordered)} estimates"
        caption += f"; {self.note}" if self.note else ""
        header = ("", "model", "regression", "solver", "status", "parameters", "NRMSE")
        return table(caption, header, rows)


def identify(
    source: Source, models: Names = None, *, regressions: Names = None, solvers: Names = None
) -> Identification:
    """Run the estimators over a recording, by the kernels that run on-line.

    All models, regressions and solvers unless some are named; the recording of a run is replayed
    as it ran unless some are. Raises ExpectedError for an unknown name or an unusable recording.
    """
    choice = Choice(_listed(models), _listed(regressions), _listed(solvers))
    try:
        choice.rows()
    except ValueError as error:
        raise ExpectedError(str(error)) from None
    if isinstance(source, Recording):
        name, online = source.name, online_of_recording(source, choice)
    else:
        path = recording_of(Path(source))
        name, online = path.name, online_of(path, choice, Table({}, {}, None))
    rows, selected, trace, doubt = run_estimators(online)
    estimates = tuple(Estimate(row, trace, index) for index, row in enumerate(rows))
    time_s = trace.period_s * np.arange(len(trace.signals), dtype=np.float64)
    chosen = estimates[selected] if selected >= 0 else None
    return Identification(name, estimates, chosen, time_s, doubt)


def _listed(names: Names) -> list[str] | None:
    if names is None:
        return None
    return [names] if isinstance(names, str) else list(names)


def _share(value: float | None) -> str:
    return number(None if value is None else float(f"{value:.3g}"))
