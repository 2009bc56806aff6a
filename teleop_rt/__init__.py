"""Real-time controller for 1-DOF model-mediated teleoperation.

The names below are the public Python interface; each is imported when it is first used, so that
`import teleop_rt` costs next to nothing. See docs/python.md.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teleop_rt.api.diagnosis import Diagnosis, NamedEffect, diagnose
    from teleop_rt.api.estimator import Estimator
    from teleop_rt.api.identification import Estimate, Identification, identify
    from teleop_rt.api.model import ExtendedModel, predict, read_model
    from teleop_rt.api.source import from_arrays, read
    from teleop_rt.api.values import Parameter
    from teleop_rt.errors import ExpectedError
    from teleop_rt.recordings.recording import Recording

__version__ = "0.3.0.dev0"

__all__ = [
    "Diagnosis",
    "Estimate",
    "Estimator",
    "ExpectedError",
    "ExtendedModel",
    "Identification",
    "NamedEffect",
    "Parameter",
    "Recording",
    "diagnose",
    "from_arrays",
    "identify",
    "predict",
    "read",
    "read_model",
]

_PLACES = {
    "teleop_rt.api.diagnosis": ("Diagnosis", "NamedEffect", "diagnose"),
    "teleop_rt.api.estimator": ("Estimator",),
    "teleop_rt.api.identification": ("Estimate", "Identification", "identify"),
    "teleop_rt.api.model": ("ExtendedModel", "predict", "read_model"),
    "teleop_rt.api.source": ("from_arrays", "read"),
    "teleop_rt.api.values": ("Parameter",),
    "teleop_rt.recordings.recording": ("Recording",),
    "teleop_rt.errors": ("ExpectedError",),
}
_PLACE_OF = {name: module for module, names in _PLACES.items() for name in names}


if not TYPE_CHECKING:  # a checker would take any name for one of ours

    def __getattr__(name: str) -> object:
        if name not in _PLACE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = getattr(importlib.import_module(_PLACE_OF[name]), name)
        globals()[name] = found
        return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
