"""The extended model as YAML: base, effects with their frozen shapes, and where each belongs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.contact.fitted import ExtendedModelError, FittedEffect, fitted_effect

__all__ = ["ExtendedModelError", "FittedEffect", "document", "read", "write"]

_CLAMPS = ("clamped", "clamped_with_effects", "clamped_without_damping")


def document(answer: dict[str, Any]) -> dict[str, Any]:
    """Return the extended model of a diagnosis' answer, ready to be written."""
    return {
        "base": {
            "model": answer["base"]["model"],
            "parameters": {k: p["value"] for k, p in answer["base"]["parameters"].items()},
            **{key: answer["base"][key] for key in _CLAMPS},
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
        raise ExtendedModelError(
            f"{path}: expected the keys base and effects: give a model that `diagnose` has written"
        )
    return tuple(
        fitted_effect(
            str(path), entry.get("name"), entry.get("law", ""), entry.get("parameters", {}), library
        )
        for entry in loaded["effects"]
    )
