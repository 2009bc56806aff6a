"""Effects that a user adds: declarations in a file of his own, or in an installed package."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from types import FunctionType, ModuleType
from typing import get_args

import numpy as np

from teleop_rt.contact.effect import (
    MOST_SHAPES,
    Acts,
    Amplitude,
    BelongsTo,
    Compensation,
    Effect,
    Family,
    Scale,
    Shape,
    Stage,
    StepFunction,
    Vector,
)
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.errors import ExpectedError
from teleop_rt.kernels.jit import kernel

ENTRY_POINT_GROUP = "teleop_rt.effects"
_CHOICES = {
    "family": Family, "belongs_to": BelongsTo, "stage": Stage, "compensation": Compensation,
    "acts": Acts,
}  # fmt: skip
_TRIED = (
    (1e-3, 1e-2, 0.1), (1e-3, -1e-2, -0.1), (1e3, 1e-2, 0.1), (0.0, 0.0, 0.0), (-1e-3, 1e-2, 0.1),
)  # fmt: skip
"""Penetrations, velocities and accelerations at which a step is tried, in the rig's units.

These are a press, a retreat, a press beyond each depth of a shape, rest, and free air: a step
branches between them.
"""


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
    """Return the declarations, their steps compiled, if each is sound and its step runs.

    Raises EffectError.
    """
    if not isinstance(declared, tuple | list) or not declared:
        raise EffectError(f"{place}: no tuple of effects: write EFFECTS = (Effect(...),)")
    taken, sound = {(effect.name, effect.law) for effect in LIBRARY}, []
    for effect in declared:
        if not isinstance(effect, Effect):
            raise EffectError(
                f"{place}: EFFECTS contains {type(effect).__name__}: write Effect(...)"
            )
        if (effect.name, effect.law) in taken:
            raise EffectError(f"{place}: {effect.name} ({effect.law}) exists: take another law")
        if len(effect.shapes) > MOST_SHAPES:
            raise EffectError(
                f"{place}: {effect.name} has {len(effect.shapes)} shapes: declare at most"
                f" {MOST_SHAPES}, the others as constants in the step"
            )
        taken.add((effect.name, effect.law))
        _refuse_misspelt(place, effect)
        sound.append(_tried(place, effect))
    return tuple(sound)


def _tried(place: str, effect: Effect) -> Effect:
    """Return a declaration whose step is compiled and has run. Raises EffectError."""
    _refuse_foreign_memory(place, effect)
    if isinstance(effect.step, FunctionType):
        effect = replace(effect, step=kernel(effect.step))
    try:
        value = effect.step(*_arrays(effect, *_TRIED[0]))
    except Exception as error:
        raise EffectError(
            f"{place}: the step of {effect.name} fails: {error}: correct it for numbers"
        ) from error
    if not np.isfinite(value):
        raise EffectError(
            f"{place}: the step of {effect.name} starts with {value}: return a finite number"
        )
    return effect


def _refuse_foreign_memory(place: str, effect: Effect) -> None:
    """Raise EffectError for a step that uses more of `state` or `eta` than it declares.

    Compiled, it would read and write memory beyond them; as Python, each index is checked. All
    other errors are those of the compiled step, which is tried next.
    """
    python: StepFunction = getattr(effect.step, "py_func", effect.step)
    for motion in _TRIED:
        try:
            python(*_arrays(effect, *motion))
        except IndexError as error:
            raise EffectError(
                f"{place}: the step of {effect.name} goes beyond its arrays ({error}): state has"
                f" state_size={effect.state_size} values, eta one of each shape,"
                f" {len(effect.shapes)}: declare all that it uses"
            ) from None
        except Exception:  # noqa: BLE001 - see above
            return


def _arrays(
    effect: Effect, x: float, v: float, a: float
) -> tuple[Vector, float, float, float, float, float, Vector]:
    """Return the arguments of a step at a motion [rig units], 0.5 s into it, ticks of 1 ms."""
    eta = np.array([shape.start for shape in effect.shapes])
    return np.zeros(effect.state_size), x, v, a, 0.5, 1e-3, eta


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
