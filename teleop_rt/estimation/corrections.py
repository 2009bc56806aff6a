"""Corrections of a sample before the estimators use it: its position, or whether it counts.

A tip that lags or bends is followed by the effect itself, from the encoder alone; a slow force
channel is paired with a position that is as slow. Errors without a causal inverse are masked:
forces at the saturation's level, isolated outliers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.contact.effects.sensor import range_of
from teleop_rt.contact.fitted import FittedEffect
from teleop_rt.contact.law import touches

_SATURATED_SHARE, _BENT_SHARE = 0.97, 0.8
"""The share of half a channel's range from which forces are masked: it clips, or bends softly."""
_OUTLYING = 8.0
"""Noises by which a force may differ from the line through the last two."""
_FADED = 0.01
"""Share of the largest depth below which a slow channel shows nothing of a contact that is over."""
_MOST_OUTLIERS = 3
"""More of them in a row are no outliers."""


class Corrections:
    """Corrects samples by fitted effects, tick by tick; `masked` counts those left out.

    `shift` is the correction of the newest position by effects that move the tip or the surface.
    `diagnosed_surface` is that of the recording from which the effects were found: from there the
    phase of a ripple along the stroke counts, and every depth until a surface is met. Without it
    they count from the surface met in this run, and from the encoder's zero before.
    """

    def __init__(
        self,
        effects: Sequence[FittedEffect],
        period_s: float,
        force_noise: float,
        diagnosed_surface: float | None = None,
    ) -> None:
        def acting(kind: str) -> list[FittedEffect]:
            return [f for f in effects if f.effect.acts == kind]

        self._moving = acting("moves_position")
        self._diagnosed_surface = diagnosed_surface
        self._bending = acting("deflects")
        self._slow = acting("filters_force")
        self._lowest, self._highest = _unsaturated(
            [f for f in acting("limits_force") if f.effect.amplitude.unity]
        )
        self._sparks = any(not f.effect.amplitude.unity for f in acting("limits_force"))
        self._period_s = period_s
        self._allowed = _OUTLYING * force_noise * math.sqrt(6.0)
        self._stateless = np.zeros(1)
        self._states: list[Vector] = [
            np.zeros(max(1, f.effect.state_size)) for f in (*self._moving, *self._slow)
        ]
        self.reset()

    def reset(self) -> None:
        """Forget every memory and count."""
        for state in self._states:
            state[:] = 0.0
        self.shift = 0.0
        self.masked = 0
        self._time_s = 0.0
        self._last = self._before = math.nan
        self._outliers = 0
        self._position = math.nan
        self._deepest = 0.0

    def apply(self, position: float, force: float, surface: float) -> float:
        """Return the position of the tip, as slow as the force; `surface` may be not-a-number.

        No material remembers a tool that has not met it yet.
        """
        self._time_s += self._period_s
        rate = (position - self._position) / self._period_s
        rate = rate if math.isfinite(rate) else 0.0
        self._position = position
        met = math.isfinite(surface)
        diagnosed = self._diagnosed_surface
        origin = surface if diagnosed is None else diagnosed
        along_stroke = position - origin if math.isfinite(origin) else position
        depth = position - surface if met else along_stroke
        self.shift = 0.0
        for one, state in zip(self._moving, self._states, strict=False):
            if one.effect.stage == "material" and not met:
                continue
            at = along_stroke if _repeats_along_stroke(one.effect) else depth
            value = one.effect.step(state, at, rate, 0.0, self._time_s, self._period_s, one.eta)
            self.shift += one.amplitude * value
        position += self.shift
        for one in self._bending:
            state = self._stateless
            bent = one.effect.step(state, force, 0.0, 0.0, 0.0, self._period_s, one.eta)
            position -= one.amplitude * bent
        if not self._slow:
            return position
        return self._slowed(position, rate, surface if met else position)

    def _slowed(self, position: float, rate: float, surface: float) -> float:
        """Return a position as slow as the force: the depth through the channel's own filters.

        A body presses from its surface on: a slow channel's force before it is not the body's.
        """
        depth = max(0.0, position - surface)
        for one, state in zip(self._slow, self._states[len(self._moving) :], strict=True):
            depth = one.effect.step(state, depth, rate, 0.0, self._time_s, self._period_s, one.eta)
        deepest = self._deepest = max(self._deepest, depth)
        inside = touches(position - surface)
        return surface + depth if inside or depth > _FADED * deepest else position

    def counts(self, force: float) -> bool:
        """Return whether a force may be used: neither saturated nor an outlier."""
        if not self._lowest < force < self._highest or (self._sparks and self._outlying(force)):
            self.masked += 1
            return False
        return True

    def _outlying(self, force: float) -> bool:
        expected = 2.0 * self._last - self._before
        off = abs(force - expected) > self._allowed and abs(force - self._last) > self._allowed
        if off and self._outliers < _MOST_OUTLIERS:
            self._outliers += 1
            return True
        self._outliers = 0
        self._before, self._last = (self._last, force) if not off else (force, force)
        return False


def _unsaturated(limits: Sequence[FittedEffect]) -> tuple[float, float]:
    """Return between which forces every one of these saturations leaves a force as it is."""
    lowest, highest = -math.inf, math.inf
    for fitted in limits:
        clips = all(shape.unit == "{f}" for shape in fitted.effect.shapes)  # nothing rounds it
        middle, half = range_of(fitted.effect, fitted.eta)
        half *= _SATURATED_SHARE if clips else _BENT_SHARE
        lowest, highest = max(lowest, middle - half), min(highest, middle + half)
    return lowest, highest


def _repeats_along_stroke(effect: Effect) -> bool:
    """Return whether the effect is of the rig's own parts, with a phase at each position."""
    return effect.stage == "tool" and any(shape.phase for shape in effect.shapes)
