"""The watch for a handle that oscillates by itself, whatever bound and observer say.

A swing is the motion from one turn to the next. A hand that shakes a device works against the wall;
a handle that shakes the hand lives on energy that the rendered wall makes. So swings count where
they are of 3 to 40 Hz, above 0.2 mm and 0.5 N, do not decay, and the port made energy over each
pair of them. Tremor and a voluntary motion against a wall that takes energy never count.
"""

from __future__ import annotations

import math
from enum import IntEnum

LOWEST_HZ, HIGHEST_HZ = 3.0, 40.0
"""People move at will below 3 Hz; above 40 Hz flesh and friction damp any hand."""
SMALLEST_SWING, SMALLEST_FORCE = 0.2e-3, 0.5
"""In m and N, or rad and Nm."""
DECAY, GROWTH = 0.95, 1.1
"""A swing below 0.95 of the last one the same way decays; one above 1.1 of it grows."""
SUSTAINED = 5
"""Swings in a row that do not decay."""
SWINGS_THAT_GROW = 2
"""Swings in a row, each above GROWTH times the last, of a device that shakes ever more."""
MADE_SHARE = 0.1
"""Energy that the port makes counts from this share of the device's own dissipation."""


class Shaking(IntEnum):
    """The watch's finding at the end of a swing."""

    NO = 0
    GROWS = 1
    SUSTAINED = 2


NO_SHAKING = Shaking.NO
"""By this name a tick finds it at once: in Python 3.11 each look-up in an enum is a call."""


class SwingWatch:
    """Finds swings that grow or do not decay, fed by energy of the port; one update a tick.

    `lasting` is how many in a row do not decay, `largest` the largest swing since it was
    last set, whatever its cause.
    """

    def __init__(self, period_s: float, device_damping: float) -> None:
        self._period_s = period_s
        self._damping = device_damping
        self.reset()

    def reset(self) -> None:
        """Forget all swings."""
        self._extreme: float | None = None
        self._before: float | None = None
        self._direction = 0.0
        self._ticks = 0
        self.largest = 0.0
        self.forget()

    def forget(self) -> None:
        """Reset the counts; the beginning of the swing is kept."""
        self._largest_force, self._smallest_force = -math.inf, math.inf
        self._made_J = self._turned_J = self._could_J = self._turned_could_J = 0.0
        self._last = self._last_way = 0.0
        self.lasting = self._growing = 0

    def update(self, position: float, velocity: float, force: float, made_J: float) -> Shaking:
        """Take in a tick: the hand's motion, the force, and the energy that the port made in it."""
        self._largest_force = max(self._largest_force, force)
        self._smallest_force = min(self._smallest_force, force)
        self._made_J += made_J
        self._could_J += self._damping * velocity * velocity * self._period_s
        self._ticks += 1
        if self._extreme is None:
            self._extreme = self._before = position
        if (position - self._extreme) * self._direction >= 0.0:
            self._extreme = position
            self._direction = self._direction or math.copysign(1.0, velocity)
            return NO_SHAKING
        if abs(position - self._extreme) < SMALLEST_SWING:
            return NO_SHAKING
        return self._turn(position)

    def _turn(self, position: float) -> Shaking:
        """End a swing at its extreme, and judge it with the one before."""
        assert self._extreme is not None  # noqa: S101 - set by the first tick
        assert self._before is not None  # noqa: S101 - as above
        size = abs(self._extreme - self._before)
        swing_s = self._ticks * self._period_s
        made = self._made_J + self._turned_J > MADE_SHARE * (self._could_J + self._turned_could_J)
        felt = (
            size > SMALLEST_SWING
            and self._largest_force - self._smallest_force > SMALLEST_FORCE
            and 0.5 / HIGHEST_HZ < swing_s < 0.5 / LOWEST_HZ
        )
        self.largest = max(self.largest, size if felt else 0.0)
        counts = felt and made
        before = self._last_way
        self.lasting = self.lasting + 1 if counts and size >= DECAY * before else int(counts)
        grown = counts and before > 0 and size >= GROWTH * before
        self._growing = self._growing + 1 if grown else 0
        self._last_way, self._last = self._last, size if counts else 0.0
        self._before, self._extreme = self._extreme, position
        self._direction = -self._direction
        self._turned_J, self._turned_could_J = self._made_J, self._could_J
        self._made_J = self._could_J = 0.0
        self._largest_force, self._smallest_force = -math.inf, math.inf
        self._ticks = 0
        if self.lasting >= SUSTAINED:
            return Shaking.SUSTAINED
        return Shaking.GROWS if self._growing >= SWINGS_THAT_GROW else NO_SHAKING
