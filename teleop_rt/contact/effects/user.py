"""Effects that a user adds: declarations in a file of his own, or in an installed package."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import get_args

import numpy as np

from teleop_rt.contact.effect import (
    Acts,
    Amplitude,
    BelongsTo,
    Compensation,
    Effect,
    Family,
    Scale,
    Shape,
    Stage,
)
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.errors import ExpectedError

ENTRY_POINT_GROUP = "teleop_rt.effects"
_CHOICES = {
    "family": Family, "belongs_to": BelongsTo, "stage": Stage, "compensation": Compensation,
    "acts": Acts,
}  # fmt: skip


class EffectError(ExpectedError):
    """A user's declaration cannot be used; the message names it and the change it needs."""


def load_file(path: Path) -> tuple[Effect, ...]:
    """Return the declarations in the variable EFFECTS of a Python file, compiled and tried.

    The file is run, so it must be as trusted as the program itself, and as it is now: Python's
    bytecode cache compares whole seconds, so an import may miss a change. Raises EffectError.
    """
    if path.suffix != ".py" or not path.is_file():
        raise EffectError(f"{path}: no such Python file: check the path")
    module = ModuleType(f"user_effects_{path.stem}")
    module.__file__ = str(path)
    try:
        exec(compile(path.read_bytes(), path, "exec"), module.__dict__)  # noqa: S102 - see above
    except Exception as error:
        raise EffectError(
            f"{path}: {type(error).__name__}: {error}: correct it until Python runs it"
        ) from error
    return checked(str(path), getattr(module, "EFFECTS", None))


def library(file: Path | None = None) -> tuple[Effect, ...]:
    """Return our effects, those of installed packages, and those of a file. Raises EffectError."""
    return (*LIBRARY, *installed(), *(load_file(file) if file is not None else ()))


def installed() -> tuple[Effect, ...]:
    """Return the declarations of all packages with an entry point in `teleop_rt.effects`."""
    found: list[Effect] = []
    for point in entry_points(group=ENTRY_POINT_GROUP):
        found += checked(point.name, point.load())
    return tuple(found)


def checked(place: str, declared: object) -> tuple[Effect, ...]:
    """Return the declarations if each is sound and its step runs; raises EffectError."""
    if not isinstance(declared, tuple | list) or not declared:
        raise EffectError(f"{place}: no tuple of effects: write EFFECTS = (Effect(...),)")
    taken = {(effect.name, effect.law) for effect in LIBRARY}
    for effect in declared:
        if not isinstance(effect, Effect):
            raise EffectError(
                f"{place}: EFFECTS contains {type(effect).__name__}: write Effect(...)"
            )
        if (effect.name, effect.law) in taken:
            raise EffectError(f"{place}: {effect.name} ({effect.law}) exists: take another law")
        taken.add((effect.name, effect.law))
        _refuse_misspelt(place, effect)
        eta = np.array([shape.start for shape in effect.shapes] or [0.0])
        try:
            value = effect.step(
                np.zeros(max(1, effect.state_size)), 1e-3, 1e-2, 0.1, 0.5, 1e-3, eta
            )
        except Exception as error:
            raise EffectError(
                f"{place}: the step of {effect.name} fails: {error}: correct it for numbers"
            ) from error
        if not np.isfinite(value):
            raise EffectError(
                f"{place}: the step of {effect.name} starts with {value}: return a finite number"
            )
    return tuple(declared)


def _refuse_misspelt(place: str, effect: Effect) -> None:
    """Raise EffectError for an unknown keyword, which would otherwise be ignored."""
    chosen = [(key, getattr(effect, key), get_args(known)) for key, known in _CHOICES.items()]
    scaled: list[Amplitude | Shape] = [effect.amplitude, *effect.shapes]
    chosen += [
        (f"relative_to of {each.name}", each.relative_to, get_args(Scale)) for each in scaled
    ]
    for key, word, known in chosen:
        if word not in known:
            choice = ", ".join(repr(one) for one in known)
            raise EffectError(f"{place}: {effect.name}: {key} is {word!r}: take one of {choice}")
    names = [] if effect.amplitude.unity else [effect.amplitude.name]
    names += [shape.name for shape in effect.shapes]
    try:
        effect.sentence.format(**dict.fromkeys(names, ""))
        effect.turned.format(**dict.fromkeys([f"-{name}" for name in names] + names, ""))
    except (KeyError, IndexError, ValueError) as error:
        raise EffectError(
            f"{place}: the sentence of {effect.name} cannot be filled in: {error!r}; name only"
            f" {', '.join(f'{{{name}}}' for name in names)}, without a format"
        ) from None
