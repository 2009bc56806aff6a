"""Effects that compete for a recording's residual: a few in each run of the suite, or all."""

from __future__ import annotations

import pytest

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY, NAMES

Effects = tuple[Effect, ...]


def rivals(*names: str) -> list[object]:
    """Return the values of a parameter: all laws of these effects, and the whole library.

    The library is played only with `--every-case`. The effects to name are those that explain a
    recording best where all are searched: the others take most of the time and decide nothing.
    Raises KeyError for a name that is no effect's.
    """
    if unknown := set(names) - set(NAMES):
        raise KeyError(f"no effects: {', '.join(sorted(unknown))}")
    near = tuple(effect for effect in LIBRARY if effect.name in names)
    further = pytest.param(LIBRARY, id="library", marks=pytest.mark.further_case)
    return [pytest.param(near, id="near"), further]
