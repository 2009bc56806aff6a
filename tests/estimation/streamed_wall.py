"""The wall that a pipeline streams, by name."""

from typing import NamedTuple

import numpy as np

from teleop_rt.estimation import walls
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import MODEL_CODES

_MODELS = {code: name for name, code in MODEL_CODES.items()}


class Wall(NamedTuple):
    """A model as it is sent to the master, in rig units."""

    model: str
    surface: float
    k: float
    b: float
    n: float
    offset: float
    m: float
    force_std: float
    time_s: float
    surface_velocity: float
    amplitudes: tuple[float, ...]


def streamed(pipeline: Pipeline) -> Wall | None:
    """Return the wall that is streamed now, None while there is none."""
    effects = pipeline.streaming.effects
    numbers = np.zeros(walls.AMPLITUDES + len(effects))
    if not pipeline.streaming.wall_writer(numbers)():
        return None
    code, *named = numbers[: walls.COUNT].tolist()
    count = int(numbers[walls.COUNT])
    amplitudes = numbers[walls.AMPLITUDES : walls.AMPLITUDES + count].tolist()
    return Wall(_MODELS[int(code)], *named, tuple(amplitudes))
