"""The model worth streaming: that of the selected row, as the operator's side renders it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact import detection
from teleop_rt.contact.effect import Vector
from teleop_rt.contact.fitted import FittedEffect
from teleop_rt.estimation import selection, walls
from teleop_rt.estimation import state as index
from teleop_rt.estimation.parameters import Conversion
from teleop_rt.estimation.physical import NONE
from teleop_rt.estimation.rows import RowSpec
from teleop_rt.estimation.settings import PipelineSettings
from teleop_rt.estimation.surface_motion import SurfaceMotion
from teleop_rt.kernels.jit import bound

Matrix = NDArray[np.float64]

_NO_PLACE = (0, NONE, 0.0)  # of a parameter that a row lacks


class Streaming:
    """The numbers of the selected row's model, and the effects that it is streamed with."""

    def __init__(
        self,
        rows: Sequence[RowSpec],
        settings: PipelineSettings,
        one: index.StateArray,
        state: index.BankState,
        conversions: Sequence[Conversion],
        motion: SurfaceMotion | None = None,
    ) -> None:
        self._rows = rows
        self._settings = settings
        self._one, self._state = one, state
        self._motion = motion
        self._rendered = self._environment_terms()
        moving = settings.corrections
        self._moving = [one for one in moving if one.effect.belongs_to == "environment"]
        self._plans = np.array([self._plan(one) for one in conversions])

    def _environment_terms(self) -> list[FittedEffect]:
        """Return the additive effects of the environment, with their amplitudes at the start."""
        found = []
        row, starts = self._rows[0], self._state.starts
        for place, effect in enumerate(row.effects):
            if effect.belongs_to == "environment":
                shapes = self._settings.shapes.get(effect.name, [s.start for s in effect.shapes])
                eta = np.array(list(shapes) or [0.0], dtype=np.float64)
                scale = row.scales[place] if row.scales else 1.0
                found.append(FittedEffect(effect, scale * float(starts[place]), eta))
        return found

    @property
    def selected(self) -> int:
        """The row whose model is worth streaming, -1 while none."""
        return int(self._state.choice.item(selection.SELECTED))

    @property
    def known_surface(self) -> float:
        """The surface where the tip meets it, not-a-number while unknown."""
        one = self._state.detector
        return one.item(detection.SURFACE) if one.item(detection.SURFACE_KNOWN) > 0.0 else math.nan

    def _plan(self, conversion: Conversion) -> Matrix:
        """Return from where each number of a row's wall comes: see `walls`."""
        effects = [(one.effect.name, one.amplitude) for one in self.effects]
        plan = np.zeros((walls.AMPLITUDES + len(effects), walls.N_PLAN))
        plan[:] = *_NO_PLACE, 0.0
        plan[walls.COUNT, walls.DEFAULT] = len(effects)
        named = [*enumerate(walls.NUMBERS.items(), walls.K), *enumerate(effects, walls.AMPLITUDES)]
        for i, (name, default) in named:
            plan[i] = *conversion.entries.get(name, _NO_PLACE), default
        return plan

    def wall_writer(self, out: Vector) -> Callable[[], bool]:
        """Return the function that writes the wall of the model to stream as `walls` has it.

        It returns false while there is none. `out` may have room for fewer effects than there are.
        """
        motion, arrays = self._motion, (self._one, self._plans, out)
        write = bound(walls.write_selected, arrays, 0.0, 0.0)
        if motion is None:
            return partial(write, 0.0, 0.0)
        return lambda: write(motion.shift, motion.velocity)

    @property
    def effects(self) -> tuple[FittedEffect, ...]:
        """The effects whose amplitudes a wall has, with those at the start."""
        return (*self._rendered, *self._moving)

    def write_effects(self, out: Matrix, column: int) -> None:
        """Write the environment's additive effects' values per unit amplitude, as streamed."""
        if not self._rendered:
            return
        row, slot = self._rows[0], 0
        for place, effect in enumerate(row.effects):
            if effect.belongs_to == "environment":
                scale = row.scales[place] if row.scales else 1.0
                out[slot, column] = self._state.terms[place] / scale
                slot += 1
