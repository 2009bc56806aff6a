"""A model extended by diagnosis, as the estimators take it: terms to estimate, samples to correct.

Of an additive effect the amplitude is estimated on-line, beside the base's parameters; its shape
parameters keep the diagnosed values. Every other effect acts on position, force or time before
the regressions see them; it is taken as found, for it enters nonlinearly. A `contact_offset`
needs no correction: the surface is found again in each run. A force channel that leaks, or whose
gain drifts, gets none: neither its memory nor its temperature is known in another run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects.user import library
from teleop_rt.contact.fitted import (
    ExtendedModelError,
    FittedEffect,
    fitted_effect,
    in_quadrature,
)
from teleop_rt.contact.models import MODELS
from teleop_rt.estimation.rows import RowSpec
from teleop_rt.estimation.settings import PipelineSettings
from teleop_rt.estimation.state import MOST_EFFECTS

_PATIENCE_S = 0.015
"""Time that a force must last to be contact where it may be friction, which is known late."""


@dataclass(frozen=True, slots=True)
class Extension:
    """Base model, additive terms and corrections of an extended model.

    `surface` is that of the recording on which the effects were fitted, None where it was given.
    """

    base: str
    terms: tuple[FittedEffect, ...] = ()
    corrections: tuple[FittedEffect, ...] = ()
    force_lag_s: float = 0.0
    surface: float | None = None

    def rows(self, rows: list[RowSpec]) -> list[RowSpec]:
        """Return those rows of the base model, with the terms: frozen first, then estimated."""
        with_terms = [
            replace(
                row,
                effects=tuple(term.effect for term in self.terms),
                scales=tuple(term.amplitude for term in self.terms),
            )
            for row in rows
            if row.model == self.base
        ]
        twice = bool(self.terms) and all(row.linear for row in with_terms)
        frozen = [replace(row, frozen=True) for row in with_terms] if twice else []
        return frozen + with_terms

    def settings(self, settings: PipelineSettings) -> PipelineSettings:
        """Return the settings with the effects' shape parameters, and with the channel's lag.

        Friction is known one filter's lag after the motion turns; for so long no force that may be
        friction is taken for contact. The surface is still that of the first sample.
        """
        rig = [term.effect for term in self.terms if term.effect.belongs_to == "rig"]
        guessed = any(effect.derivative_order for effect in rig)
        patience = math.ceil(_PATIENCE_S / settings.period_s) if guessed else 0
        return replace(
            settings,
            onset_samples=max(settings.onset_samples, patience),
            shapes={t.effect.name: t.eta[: len(t.effect.shapes)].tolist() for t in self.terms},
            starts=tuple(term.share for term in self.terms),
            corrections=self.corrections,
            diagnosed_surface=self.surface,
            force_lag_s=settings.force_lag_s + self.force_lag_s,
            lets_go=any(_remembers(term.effect) for term in self.terms),
        )


def _remembers(effect: Effect) -> bool:
    """Return whether an effect is a memory within the body, which may pull against its spring."""
    return effect.stage == "material" and effect.only_in_contact and effect.state_size > 0


def extension_from(
    place: str, document: Mapping[str, Any], effects_file: str | None = None
) -> Extension:
    """Return the extension that a document (`diagnosis/answers/extended.py`) describes.

    `place` is its origin in messages. Raises ExtendedModelError, and EffectError for
    `effects_file`.
    """
    known = library(Path(effects_file) if effects_file else None)
    fitted = tuple(
        fitted_effect(place, one["name"], one.get("law", ""), one.get("parameters", {}), known)
        for one in document["effects"]
    )
    base = document["base"]
    extension = extension_of(place, base["model"], fitted)
    return replace(extension, surface=base.get("parameters", {}).get("surface"))


def extension_of(place: str, base: str, fitted: tuple[FittedEffect, ...]) -> Extension:
    """Return the extension of a base model by fitted effects; raises ExtendedModelError.

    `place` says where they are written.
    """
    if base not in MODELS:
        raise ExtendedModelError(
            f"{place}: base: model: {base!r} does not run on-line; one of: {', '.join(MODELS)}"
        )
    additive = [f for f in fitted if f.effect.acts == "adds_force" and f.amplitude != 0.0]
    terms = tuple(term for one in additive for term in in_quadrature(one))
    if len(terms) > MOST_EFFECTS:
        raise ExtendedModelError(f"{place}: effects: {len(terms)} terms, {MOST_EFFECTS} at most")
    return Extension(
        base,
        terms,
        tuple(
            f
            for f in fitted
            if f.effect.acts not in {"adds_force", "shifts_time"}
            and f.effect.compensation != "none"
            and f.effect.name != "contact_offset"
        ),
        sum(f.amplitude for f in fitted if f.effect.acts == "shifts_time"),
    )
