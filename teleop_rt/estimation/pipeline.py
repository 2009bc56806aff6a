"""The on-line pipeline: from one sample of position and force to the model worth streaming."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from functools import cached_property, partial
from typing import cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact import detection
from teleop_rt.estimation import layout, selection, watch
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import state as index
from teleop_rt.estimation.contact_found import Contact, contact_of, surface_reason
from teleop_rt.estimation.corrections import Corrections
from teleop_rt.estimation.cycle import run_ticks, sense_tick, skip, write_trace_row
from teleop_rt.estimation.estimates import Places, StoredPlaces, new_places, write_estimate
from teleop_rt.estimation.grid import SampleGrid
from teleop_rt.estimation.layout import STATUS_NAMES
from teleop_rt.estimation.pair_kernels import NO_PAIRS, Paired
from teleop_rt.estimation.parameters import (
    Conversion,
    physical_over_time,
    traced,
    traced_names,
)
from teleop_rt.estimation.rows import RowSpec
from teleop_rt.estimation.settings import PipelineSettings, allocate, clear
from teleop_rt.estimation.state import StateArray
from teleop_rt.estimation.streamed import Streaming
from teleop_rt.estimation.surface_motion import SurfaceMotion
from teleop_rt.estimation.terms import Terms
from teleop_rt.estimation.trace import Trace
from teleop_rt.kernels.jit import bound

__all__ = ["Pipeline", "PipelineSettings"]

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]
Codes = NDArray[np.uint8]

_NO_SAMPLES = (np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.bool_))
_NO_TRACE = (
    np.zeros((0, 8)), np.zeros((0, 0, layout.MAX_PARAMETERS)), np.zeros((0, 0), np.uint8),
)  # fmt: skip
_PIECE = 4096
"""States whose scaled parameters are kept at a time, before they are converted."""
_NO_GRID = np.zeros(0, np.int64)


class Pipeline:
    """Alignment, contact, regressions, bank and selection, one tick at a time.

    `update` allocates nothing that grows and never raises on any number.
    """

    def __init__(self, rows: Sequence[RowSpec], settings: PipelineSettings) -> None:
        if not rows or any(row.effects != rows[0].effects for row in rows):
            raise ValueError("a pipeline needs rows, all of them with the same additive effects")
        self.rows = tuple(rows)
        self.settings = settings
        effects = rows[0].effects
        self._one, self._state, self.bank = allocate(settings, rows)
        self._whole = row_kinds.whole_for(rows)
        values = self._state.terms[: len(effects)]
        self._terms = Terms(effects, settings.shapes, values, rows[0].scales) if effects else None
        self._corrections = (
            Corrections(
                settings.corrections,
                settings.period_s,
                settings.force_noise,
                settings.diagnosed_surface,
            )
            if settings.corrections
            else None
        )
        self._surface_motion = settings.surface_motion()
        self._conversions = [Conversion(row, r, len(rows), settings) for r, row in enumerate(rows)]
        self._places = new_places(len(rows))
        for conversion, place in zip(self._conversions, self._places, strict=True):
            conversion.write_places(cast("Places", place))
        self._room = np.zeros((layout.MAX_PARAMETERS, layout.MAX_PARAMETERS))
        self.streaming = Streaming(
            self.rows, settings, self._one, self._state, self._conversions, self._surface_motion
        )
        count = len(rows)
        self.theta: Matrix = self.bank.theta[:count]
        self.restarts: Vector = self.bank.restarts[:count]
        self.lambda_: Vector = self.bank.lambda_[:count]
        self.predicted: Vector = self._state.records[:count, selection.PREDICTED]
        self.reset()
        for row in range(count):
            self.estimate(row)  # compiled and loaded now, not in a tick

    def reset(self) -> None:
        """Forget everything."""
        clear(self.settings, self._state, self.bank)
        self._surface_met = self.settings.surface is not None
        if self._terms is not None:
            self._terms.reset()
        if self._corrections is not None:
            self._corrections.reset()
        if self._surface_motion is not None:
            self._surface_motion.reset()

    def update(self, position: float, force: float, valid: bool) -> None:
        """Take one tick's sample (rig units); `valid` false, or not a number, counts as missing."""
        if self._corrections is not None and valid:
            tip = self._corrections.apply(position, force, self.streaming.known_surface)
            position, valid = tip, self._corrections.counts(force)
        if self._surface_motion is not None and valid:
            position += self._follow_surface(self._surface_motion, position, force)
        if self._terms is None:
            self._tick(position, force, 0, valid)
        elif sense_tick(self._one, position, force, valid):
            one, m, q = self.settings, self._state.motion, self._state.q
            self._forget_the_approach()
            speed = one.length / one.time
            self._terms.advance(
                m[index.MX] * one.length + self._unmet_depth(),
                m[index.MV] * speed,
                m[index.MA] * speed / one.time,
                q[index.TIME],
                q[index.ELAPSED],
            )
            self._tick_sensed(position, force, 0, valid)

    def at_once(
        self, period_ns: int | None = None
    ) -> Callable[[float, float, int, bool], object] | None:
        """Return a function that takes a tick's sample, stamp and validity as `update` does.

        It is one kernel. With a period it ends gaps as a `SampleGrid` finds them. None where Python
        has a part.
        """
        grid = _NO_GRID if period_ns is None else SampleGrid(period_ns).words
        return self._one_tick(grid, sensed=False) if self._by_kernels else None

    def pairs_at_once(self, paired: Paired) -> Callable[[bool], int] | None:
        """Return a kernel that pairs a cycle's sample, if it is ready, and takes the pair.

        It returns as `run_ticks` does. None where Python has a part.
        """
        if not self._by_kernels:
            return None
        return partial(self._one_tick(_NO_GRID, paired, sensed=False), 0.0, 0.0, 0)

    @property
    def _by_kernels(self) -> bool:
        """Whether Python has no part in a tick."""
        python = self._terms, self._corrections, self._surface_motion
        return all(part is None for part in python)

    def _one_tick(
        self, grid: NDArray[np.int64], paired: Paired = NO_PAIRS, *, sensed: bool
    ) -> Callable[..., int]:
        """Return the kernel of a recording, bound to none: it runs one tick."""
        arrays = self._one, *_NO_SAMPLES, *_NO_TRACE, grid, paired
        how = 1, sensed, self._whole
        return partial(bound(run_ticks, arrays, *how, 0.0, 0.0, 0, True), *how)  # noqa: FBT003

    @cached_property
    def _tick(self) -> Callable[..., object]:
        return self._one_tick(_NO_GRID, sensed=False)

    @cached_property
    def _tick_sensed(self) -> Callable[..., object]:
        return self._one_tick(_NO_GRID, sensed=True)

    def _follow_surface(self, motion: SurfaceMotion, position: float, force: float) -> float:
        """Return the surface's motion towards the tool, which adds to the depth."""
        detector = self._state.detector
        known, in_contact = (
            detector[detection.SURFACE_KNOWN] > 0.0,
            bool(detector[detection.IN_CONTACT] > 0.0),
        )
        met_at = detector.item(detection.ONSET_AT) if known else math.nan
        shift = motion.update(position, force, met_at, in_contact=in_contact)
        self._state.detection[detection.FOLLOWED] = float(motion.ready)
        return shift

    def skip(self, ticks: int) -> None:
        """Let ticks pass that had no sample: the next one ends a gap of so many more."""
        skip(self._state, ticks)

    def _unmet_depth(self) -> float:
        """Return the depth of the place that counts as the surface until one is met, else 0.

        A rig's spring or weight was fitted from the diagnosed surface on, and acts before it, too.
        """
        if self._surface_met or self.settings.diagnosed_surface is None:
            return 0.0
        return self._state.q.item(index.SURFACE_USED) - self.settings.diagnosed_surface

    def _forget_the_approach(self) -> None:
        """Empty the effects' memories when the surface is met: they were of free air."""
        known = bool(self._state.detector[detection.SURFACE_KNOWN] > 0.0)
        if known and not self._surface_met and self._terms is not None:
            self._terms.reset()
        self._surface_met = known

    def run(
        self,
        position: Vector,
        force: Vector,
        valid: NDArray[np.bool_],
        decimate: int = 1,
        names_of: Callable[[RowSpec], Collection[str]] = traced_names,
    ) -> Trace:
        """Run a whole recording through the very same kernels: same numbers, bit for bit.

        position, force, valid (samples,); every `decimate`-th state is kept in the trace, and of
        each row the parameters of these names.
        """
        kept, count, one = len(position) // decimate, len(self.rows), self.settings
        signals, status = np.zeros((kept, 8)), np.zeros((kept, count), np.uint8)
        values = tuple({name: np.zeros(kept) for name in names_of(row)} for row in self.rows)
        theta = np.zeros((_PIECE, count, max(len(traced(row)) for row in self.rows)))
        p = np.ascontiguousarray(position, dtype=np.float64)
        f = np.ascontiguousarray(force, dtype=np.float64)
        ok = np.ascontiguousarray(valid, dtype=np.bool_)
        for first in range(0, len(p), _PIECE * decimate):
            piece = slice(first, first + _PIECE * decimate)
            at = slice(first // decimate, first // decimate + len(p[piece]) // decimate)
            scaled = theta[: at.stop - at.start]
            self._run_piece((p[piece], f[piece], ok[piece]), (signals[at], scaled, status[at]),
                            decimate)  # fmt: skip
            for r, row in enumerate(self.rows):
                found = physical_over_time(row, scaled[:, r], one.length, one.time)
                for name, column in zip(traced_names(row), found.T, strict=True):
                    if name in values[r]:
                        values[r][name][at] = column
        return Trace(signals, values, status, one.period_s * decimate, self.rows)

    def _run_piece(
        self,
        samples: tuple[Vector, Vector, NDArray[np.bool_]],
        kept: tuple[Matrix, NDArray[np.float64], Codes],
        decimate: int,
    ) -> None:
        """Run a piece of a recording, and keep its states: see `cycle.run_ticks`."""
        plain = self._terms is None and self._corrections is None
        if plain and self._surface_motion is None:
            how = decimate, False, self._whole
            arrays = self._one, *samples, *kept, _NO_GRID, NO_PAIRS
            run_ticks(*arrays, *how, 0.0, 0.0, 0, True)  # noqa: FBT003
            return
        for i, (position, force, ok) in enumerate(zip(*samples, strict=True)):
            self.update(position, force, bool(ok))
            if (i + 1) % decimate == 0:
                k = (i + 1) // decimate - 1
                write_trace_row(self._one, *(rows[k] for rows in kept))

    @property
    def stored(self) -> StateArray:
        """The record of estimation, as kernels take it."""
        return self._one

    @property
    def shifts(self) -> bool:
        """Whether `shift` may be other than 0."""
        return self._corrections is not None or self._surface_motion is not None

    @property
    def shift(self) -> float:
        """Motion of tip or surface, by effects or followed, which the encoder does not show."""
        shift = 0.0 if self._corrections is None else self._corrections.shift
        return shift if self._surface_motion is None else shift + self._surface_motion.shift

    @property
    def contact(self) -> Contact:
        """Present state of the contact, in encoder coordinates."""
        return contact_of(self._state, self.shift)

    @property
    def onsets(self) -> int:
        """Number of onsets that were believed: found from free air."""
        return int(self._state.detector[detection.ONSETS])

    @property
    def surface_reason(self) -> str | None:
        """Why there is no surface, or None when there is one."""
        return surface_reason(self._state)

    @property
    def status(self) -> list[str]:
        """The status of each row in words."""
        return [STATUS_NAMES[int(code)] for code in self.bank.status[: len(self.rows)]]

    def estimate(self, row: int) -> tuple[list[str], Vector, Vector | None]:
        """Return names, values and standard deviations (or None) of a row, in rig units.

        Algebraic rows have no deviations: their noise is integrated, coloured and grows.
        """
        names = self._conversions[row].names
        values, deviations = np.empty(len(names)), np.empty(len(names))
        known_deviations = self.write_estimate(row, values, deviations)
        if self.rows[row].linear:
            n = int(self.bank.active[row])
            names, values, deviations = names[:n], values[:n], deviations[:n]
        return names, values, deviations if known_deviations else None

    def write_estimate(self, row: int, values: Vector, deviations: Vector) -> bool:
        """Write a row's estimate in rig units, not-a-number where nothing is estimated.

        values and deviations: as long as the row's parameters and, of a linear model, its offset.
        Returns whether the deviations are known.
        """
        arrays = self._one, self._places, self._room
        return write_estimate(*arrays, row, values, deviations)

    @property
    def logged(self) -> tuple[StateArray, StoredPlaces, Matrix]:
        """Record, places and room to work in, as `write_logged` takes them before a row."""
        return self._one, self._places, self._room

    def condition(self, row: int) -> float | None:
        """Return the condition number of a row's (scaled) normal matrix, None before any data."""
        return self.bank.condition(row)

    @property
    def selected(self) -> int:
        """The row whose model is worth streaming, -1 while none."""
        return self.streaming.selected

    @property
    def rig_force(self) -> float:
        """Present force of the rig's known effects, which the measured force contains."""
        return self._state.q.item(index.RIG_FORCE)

    @property
    def inadequate(self) -> bool:
        """Whether the selected model leaves structure in the force (`watch.py`)."""
        return self._state.watch.item(watch.RAISED) > 0.0

    @property
    def residual_has_memory(self) -> bool:
        """Whether the selected model's residual is no white noise, as deviations assume it is."""
        return watch.has_memory(self._state.watch)

    @property
    def masked(self) -> int:
        """Number of samples that were left out because an effect spoils them."""
        return 0 if self._corrections is None else self._corrections.masked

    def predicted_force(self, row: int) -> float:
        """Return the force that a row predicts now, open loop, by its frozen parameters."""
        return float(self.predicted[row])

    def nrmse(self, row: int) -> float | None:
        """Return the normalised force error (4.1) of a row's open-loop predictions, or None."""
        record, q = self._state.records[row], self._state.q
        spread = q[index.LARGEST_FORCE] - q[index.LEAST_FORCE]
        if record[selection.SCORED] == 0.0 or not spread > 0.0:
            return None
        return float(math.sqrt(record[selection.TOTAL_POWER] / record[selection.SCORED]) / spread)
