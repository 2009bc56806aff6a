"""The force after a stall of the loop: no step into a hand that moved on meanwhile."""

from __future__ import annotations

import math

OLDEST_SAMPLE = 3
"""Ticks until a device's sample is younger than a stall: a bus answers a cycle later, or two."""


class StalledForce:
    """Lets a force fall at once after a stall, and removes the difference by steps.

    The hand moved on against the old force meanwhile, and the wall's is another by now. The
    difference shrinks by a step a tick; the hand's own motion is followed all along.
    """

    def __init__(self, force_step: float) -> None:
        self._force_step = force_step
        self.reset()

    def reset(self) -> None:
        """Forget the stall."""
        self._behind, self._missing = 0, 0.0

    def begin(self) -> None:
        """Note that the loop has stood still."""
        self._behind = OLDEST_SAMPLE

    def without_a_step(self, force: float, before: float) -> float:
        """Return a wanted force as it may be after the one of the tick before."""
        if self._behind > 0:
            self._behind -= 1
            most = self._force_step + max(0.0, math.copysign(before, before * force))
            self._missing = max(0.0, abs(force) - most)
        elif self._missing > 0.0:
            self._missing = max(0.0, self._missing - self._force_step)
        return math.copysign(max(0.0, abs(force) - self._missing), force)
