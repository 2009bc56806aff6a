"""An extended model: a base with named effects, which predicts the force of any motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from teleop_rt.api.source import File, Source, opened
from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.contact.effects.user import library
from teleop_rt.contact.fitted import ExtendedModelError, FittedEffect, fitted_effect
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.model import CandidateModel, Clamp, nonlinear_amplitude, phases
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.samples.outliers import OUTLIERS
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.diagnosis.samples.surface import surface_of
from teleop_rt.recordings.recording import Recording

Fitted = tuple[FittedEffect, ...]
Clamped = bool | Literal["with effects", "without damping"]
_CLAMPS: dict[Clamped, Clamp] = {
    False: "none",
    True: "base",
    "with effects": "body",
    "without damping": "elastic",
}
_SAME_SURFACE = 0.1
"""The share of the travel by which the onset of the force may miss the surface of the same rig."""


@dataclass(frozen=True, slots=True, repr=False)
class ExtendedModel:
    """A base model by name, its parameters, and effects, in the units of the rig.

    `clamped`: the force of the base is cut off below 0, or that of the base with the effects of the
    material, or that without the damping of the base.
    """

    base: str
    parameters: Mapping[str, float]
    effects: Fitted = ()
    clamped: Clamped = False

    def __repr__(self) -> str:
        values = ", ".join(f"{name} = {value:.5g}" for name, value in self.parameters.items())
        names = "".join(f" + {one.effect.name}" for one in self.effects)
        return f"<ExtendedModel: {self.base} ({values}){names}>"


def read_model(file: File, effects: File | None = None) -> ExtendedModel:
    """Return the extended model in a file that `teleop-rt diagnose --out` has written.

    `effects` is a Python file with effects of the user's. Raises ExpectedError.
    """
    path = Path(file)
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ExtendedModelError(
            f"{path}: cannot be read: {error}; give a model that `diagnose` has written"
        ) from None
    if not isinstance(document, dict) or set(document) != {"base", "effects"}:
        raise ExtendedModelError(
            f"{path}: expected the keys base and effects: give a model that `diagnose` has written"
        )
    known = library(None if effects is None else Path(effects))
    return model_of(str(path), document, known)


def model_of(place: str, document: Mapping[str, Any], known: Sequence[Effect]) -> ExtendedModel:
    """Return the model of a document (`diagnosis/answers/extended.py`).

    `place` says where it stands. Outliers are left out: they are no force. Raises
    ExtendedModelError.
    """
    base = document["base"]
    values = {name: value for name, value in base["parameters"].items() if value is not None}
    fitted = tuple(
        fitted_effect(place, one["name"], one.get("law", ""), one.get("parameters", {}), known)
        for one in document["effects"]
        if one["name"] != OUTLIERS
    )
    clamped: Clamped = bool(base.get("clamped", False))
    if clamped and base.get("clamped_with_effects", False):
        without = base.get("clamped_without_damping", False)
        clamped = "without damping" if without else "with effects"
    return ExtendedModel(base["model"], values, fitted, clamped)


def predict(model: ExtendedModel, source: Source) -> Vector:
    """Return the force (samples,) that a model predicts from the motion of a recording alone.

    In free run: the measured force is used only where a surface has to be found. Raises
    ExpectedError where the model lacks a parameter or the recording cannot be used.
    """
    recording = opened(source)
    base = base_of(model.base)
    surface = _surface(model, recording) if base.touches else 0.0
    motion = problem_of(recording, base, surface).motion
    effects = tuple(one.effect for one in model.effects)
    whole = CandidateModel(base, effects, _CLAMPS[model.clamped] if base.touches else "none")
    return force_of(whole, motion, _nonlinear(model, whole), _linear(model, whole))


def _surface(model: ExtendedModel, recording: Recording) -> float:
    """Return the surface: the given or detected one, else that of the model, if near."""
    guess, own = surface_of(recording), model.parameters.get("surface")
    near = _SAME_SURFACE * float(np.ptp(recording.position))
    if own is not None and not guess.fixed and abs(guess.position - own) < near:
        return own
    return guess.position


def _nonlinear(model: ExtendedModel, whole: CandidateModel) -> Vector:
    """Return the nonlinear parameters in the order of the model's coordinates."""
    found = [_parameter(model, "n")] if whole.base.has_power else []
    for one in model.effects:
        if nonlinear_amplitude(one.effect):
            found.append(one.amplitude)
        turned = phases(one.effect)
        shapes = zip(one.effect.shapes, one.eta, strict=False)
        found += [float(value) for shape, value in shapes if not (shape.phase and turned)]
    return np.array(found)


def _linear(model: ExtendedModel, whole: CandidateModel) -> Vector:
    """Return the linear parameters in the order of the model's columns."""
    found = [_parameter(model, term.name) for term in whole.base.terms]
    for one in model.effects:
        if one.effect.acts != "adds_force":
            continue
        if phases(one.effect):
            places = [i for i, shape in enumerate(one.effect.shapes) if shape.phase]
            angle = float(one.eta[places[0]])
            found += [one.amplitude * float(np.cos(angle)), one.amplitude * float(np.sin(angle))]
        else:
            found.append(one.amplitude)
    return np.array(found)


def _parameter(model: ExtendedModel, name: str) -> float:
    if name not in model.parameters:
        raise ExtendedModelError(
            f"base {model.base}: no number for its parameter {name}: add it to `parameters`"
        )
    return model.parameters[name]
