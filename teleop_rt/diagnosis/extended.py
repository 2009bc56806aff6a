"""The extended model as YAML: base, effects with their frozen shapes, and where each belongs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.contact.effects import LIBRARY


@dataclass(frozen=True)
class FittedEffect:
    """An effect with the amplitude and the shape parameters that diagnosis found."""

    effect: Effect
    amplitude: float
    eta: Vector


class ExtendedModelError(Exception):
    """A file is no extended model: says which key, and what was expected."""


def document(answer: dict[str, Any]) -> dict[str, Any]:
    """Return the extended model of a diagnosis' answer, ready to be written."""
    return {
        "base": {
            "model": answer["base"]["model"],
            "parameters": {k: p["value"] for k, p in answer["base"]["parameters"].items()},
        },
        "effects": [
            {
                "name": effect["name"],
                "law": effect["law"],
                "belongs_to": effect["belongs_to"],
                "compensation": effect["compensation"],
                "parameters": {k: p["value"] for k, p in effect["parameters"].items()},
            }
            for effect in answer["effects"]
        ],
    }


def write(path: Path, answer: dict[str, Any]) -> None:
    """Write the extended model of an answer."""
    path.write_text(yaml.safe_dump(document(answer), sort_keys=False))


def read(path: Path, library: tuple[Effect, ...] = LIBRARY) -> tuple[FittedEffect, ...]:
    """Return the effects of an extended model; raises ExtendedModelError."""
    loaded = yaml.safe_load(path.read_text())
    if not isinstance(loaded, dict) or set(loaded) != {"base", "effects"}:
        raise ExtendedModelError(f"{path}: expected the keys base and effects")
    return tuple(_fitted(path, entry, library) for entry in loaded["effects"])


def _fitted(path: Path, entry: dict[str, Any], library: tuple[Effect, ...]) -> FittedEffect:
    name, law = entry.get("name"), entry.get("law", "")
    known = [e for e in library if e.name == name and e.law == law]
    if not known:
        raise ExtendedModelError(f"{path}: effects: no effect {name!r} of law {law!r}")
    effect, values = known[0], entry.get("parameters", {})
    wanted = [shape.name for shape in effect.shapes]
    if not effect.amplitude.unity:
        wanted.append(effect.amplitude.name)
    lacking = [key for key in wanted if not isinstance(values.get(key), float | int)]
    if lacking:
        raise ExtendedModelError(f"{path}: effects: {name}: no number for {', '.join(lacking)}")
    amplitude = 1.0 if effect.amplitude.unity else float(values[effect.amplitude.name])
    eta = np.array([float(values[shape.name]) for shape in effect.shapes] or [0.0])
    return FittedEffect(effect, amplitude, eta)
