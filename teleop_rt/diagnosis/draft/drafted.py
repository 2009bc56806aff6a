"""A drafted law for an unexplained residual: draft, declare, refit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.contact.effects.user import load_file
from teleop_rt.diagnosis.answers.answer import (
    base_entry,
    covariance,
    effect_entry,
    parameters_of_effect,
)
from teleop_rt.diagnosis.answers.errors import Blocks, HeldOut
from teleop_rt.diagnosis.answers.residuals import predict_recording
from teleop_rt.diagnosis.draft.choice import Law, law_of
from teleop_rt.diagnosis.draft.declaration import FILE, NAME, identity, text_of
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.recordings.recording import Recording

_SIGMAS = 2.0  # standard deviations below which a weight does not differ from zero
_EVALUATIONS = 30  # of the descent: a draft's start is coarse, and is refined once


@dataclass(frozen=True)
class Drafted:
    """A law that was declared in `file`, and the base refitted with it."""

    law: Law
    file: Path
    fit: Fit
    found: Diagnosis
    units: tuple[str, str]

    @property
    def effect(self) -> dict[str, Any]:
        """The law as an effect of the answer; `explains` is its share of the base's mean square."""
        effect = self.fit.model.effects[-1]
        member = len(self.fit.model.effects) - 1
        spread = covariance(self.found.problem, self.fit, self.found.input_errors)
        parameters = parameters_of_effect(self.found.problem, self.fit, member, spread, self.units)
        return effect_entry(effect, parameters, self._explains)

    @property
    def _explains(self) -> float:
        problem = self.found.problem
        where = held_out.counted(problem, self.found.base) > 0.0
        before, after = (problem.mean_square(f, where) for f in (self.found.base, self.fit))
        return max(0.0, 1.0 - after / max(before, 1e-300))

    @property
    def base(self) -> dict[str, Any]:
        """The base beside the law, as in the answer."""
        return base_entry(self.fit, self.found.problem, self.found.input_errors, self.units)

    def predicted(self, test: Recording, surface: float | None = None) -> HeldOut:
        """Return the prediction of another recording by the base alone, and with the law."""
        base = self.found.predicting or self.found.base
        unseen = predict_recording(test, base, self.fit, self.found.problem, surface)
        return self._where_drafted(unseen)

    def errors_on_blocks(self) -> dict[str, Any]:
        """Return the errors on held-out blocks, with which the terms of the law were chosen."""
        problem, base = self.found.problem, self.found.base
        noise = self.found.noise_levels(self.fit).perfect()
        unseen = Blocks(problem, problem, base).predicted(self.fit, noise)
        return self._where_drafted(unseen).errors

    def _where_drafted(self, unseen: HeldOut) -> HeldOut:
        """Return the prediction of the samples of the base, whose residual the law describes."""
        return replace(unseen, where=held_out.counted(unseen.problem, self.found.base))

    def entry(self, test: Recording | None, surface: float | None = None) -> dict[str, Any]:
        """Return the answer's `draft`: file, quantities, the law, and errors with it."""
        error = self.errors_on_blocks() if test is None else self.predicted(test, surface).errors
        return {
            "file": str(self.file),
            "terms": self.law.words,
            "effect": self.effect,
            "error": {key: error[key] for key in ("metric", "on", "before", "after")},
        }


def drafted(
    found: Diagnosis, recording: Recording, folder: Path, own: Path | None = None
) -> Drafted | None:
    """Draft a law of a diagnosis's residual, write it into `folder`, and refit the base with it.

    `own` is the user's file of effects, which the written one loads as well. None where no term
    lowers the error on hidden blocks; terms in time are none of it (see `law_of`).
    """
    law = law_of(found.problem, found.best, of_time=False)
    if law is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    while True:
        made = _written(law, found, recording, folder / FILE, own)
        if (weak := _weakest(made)) is None:
            return made
        law = law.without(weak)


def _written(
    law: Law, found: Diagnosis, recording: Recording, path: Path, own: Path | None
) -> Drafted:
    """Write a law into a file, and refit the base with it."""
    text = text_of(law, recording.name, recording.units, own, identity(recording))
    path.write_text(text, encoding="utf-8")
    effect = next(e for e in load_file(path) if e.name == NAME)
    best = found.best
    model = replace(best.model, effects=(*best.model.effects, effect))
    start = np.concatenate([best.zeta, [shape.start for shape in effect.shapes]])
    fit = found.problem.refine(model, start, _EVALUATIONS)
    return Drafted(law, path, fit, found, recording.units)


def _weakest(made: Drafted) -> int | None:
    """Return the term whose weight differs least from zero, None if each does by its deviation."""
    parameters = made.effect["parameters"]
    weights = {i: parameters[f"weight_{i + 1}"] for i in range(1, len(made.law.terms))}
    ratios = {i: abs(one["value"]) / one["std"] for i, one in weights.items() if one["std"]}
    weakest = min(ratios, key=lambda i: ratios[i], default=None)
    return weakest if weakest is not None and ratios[weakest] < _SIGMAS else None
