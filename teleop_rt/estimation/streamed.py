"""The model worth streaming: that of the selected row, as the operator's side renders it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

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

Matrix = NDArray[np.float64]

_NOWHERE = 2**31
_NO_PLACE = (0, NONE, 0.0)
_NO_EFFECTS: tuple[FittedEffect, ...] = ()


class StreamedModel(NamedTuple):
    """The model worth streaming: rig units; force_std is its open-loop error.

    `effects` are those of the environment, with amplitudes; `time_s` is the time that they see. The
    surface is where it is now, and moves at `surface_velocity`.
    """

    model: str
    parameters: dict[str, float]
    surface: float
    force_std: float
    effects: tuple[FittedEffect, ...] = ()
    time_s: float = 0.0
    surface_velocity: float = 0.0


class Wall(NamedTuple):
    """The numbers of a model that its force without inertia hangs on, in rig units.

    `amplitudes` are those of the effects that the environment adds to it.
    """

    model: str
    surface: float
    k: float
    b: float
    n: float
    offset: float
    amplitudes: tuple[float, ...]

    @classmethod
    def of(cls, model: str, laid_out: Vector) -> Wall:
        """Return a wall laid out as `walls` has it, with the effects that it has room for."""
        _, surface, k, b, n, offset, _, count, *amplitudes = laid_out.tolist()
        return cls(model, surface, k, b, n, offset, tuple(amplitudes[: int(count)]))


class Streaming:
    """The selected row's model: `write_wall` looks at its numbers, `model` makes what is sent.

    Most looks end with nothing to send, so a look makes no more than it must.
    """

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
        self._conversions = conversions
        self._motion = motion
        self._room = [np.zeros(len(one.names)) for one in conversions]
        self._rendered = self._environment_terms()
        moving = settings.corrections
        self._moving = [one for one in moving if one.effect.belongs_to == "environment"]
        self._plans = [self._plan(one) for one in conversions]
        wall = np.zeros(len(self._plans[0]))
        for row in range(len(rows)):  # compiled and loaded now, not in a tick
            self._values(row)
            walls.read_wall(one, row, self._plans[row], wall)
        names = [one.effect.name for one in self._rendered]
        self._of_effects = [_places(one.names, names) for one in conversions]

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

    def _values(self, row: int) -> list[float]:
        """Return a row's parameters; of a linear model its offset only where it is estimated."""
        values = self._room[row]
        self._conversions[row].read(self._one, values)
        found: list[float] = values.tolist()
        return found[: self._state.active.item(row)] if self._rows[row].linear else found

    def _plan(self, conversion: Conversion) -> Matrix:
        """Return from where each number of a row's wall comes: see `walls`."""
        effects = [(one.effect.name, one.amplitude) for one in self.effects]
        plan = np.zeros((walls.AMPLITUDES + len(effects), walls.N_PLAN))
        plan[walls.COUNT] = *_NO_PLACE, len(effects)
        named = [*enumerate(walls.NUMBERS.items(), walls.K), *enumerate(effects, walls.AMPLITUDES)]
        for i, (name, default) in named:
            plan[i] = *conversion.places.get(name, _NO_PLACE), default
        return plan

    def write_wall(self, out: Vector) -> bool:
        """Write the wall of the model to stream as `walls` has it; false while there is none.

        `out` may have room for fewer effects than there are.
        """
        row = self.selected
        if row >= 0:
            walls.read_wall(self._one, row, self._plans[row], out)
            if self._motion is not None:
                out[walls.SURFACE] -= self._motion.shift
        return row >= 0

    def _estimated(self, row: int, values: list[float]) -> list[float]:
        """Return the effects' amplitudes as estimated, or as diagnosis found them."""
        return [
            values[place] if place < len(values) else one.amplitude
            for place, one in zip(self._of_effects[row], self._rendered, strict=True)
        ]

    def model(self) -> StreamedModel | None:
        """Return the model to stream, or None while there is none."""
        row = self.selected
        if row < 0:
            return None
        known = self.known_surface
        values, effects = self._values(row), _NO_EFFECTS
        if math.isfinite(known):
            terms = zip(self._rendered, self._estimated(row, values), strict=True)
            effects = (*(replace(one, amplitude=a) for one, a in terms), *self._moving)
        return StreamedModel(
            model=self._rows[row].model,
            parameters=dict(zip(self._conversions[row].names, values, strict=False)),
            surface=self._surface(known),
            force_std=self.force_std,
            effects=effects,
            time_s=self.time_s,
            surface_velocity=self.surface_velocity,
        )

    @property
    def effects(self) -> tuple[FittedEffect, ...]:
        """The effects whose amplitudes a wall has, with those at the start."""
        return (*self._rendered, *self._moving)

    @property
    def force_std(self) -> float:
        """The open-loop error of the selected row's force."""
        return math.sqrt(self._state.records.item(self.selected, selection.ERROR_POWER))

    @property
    def time_s(self) -> float:
        """The time that the effects see."""
        return self._state.q.item(index.TIME)

    def _surface(self, known: float) -> float:
        surface = known if math.isfinite(known) else self._state.q.item(index.SURFACE_USED)
        return surface if self._motion is None else surface - self._motion.shift

    @property
    def surface_velocity(self) -> float:
        """How fast the surface moves by itself, as far as that is followed."""
        return 0.0 if self._motion is None else self._motion.velocity

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


def _places(names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    """Return where each wanted name is, far behind the end where it is not there."""
    return [names.index(name) if name in names else _NOWHERE for name in wanted]
