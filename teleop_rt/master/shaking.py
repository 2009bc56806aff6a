"""Reaction to a handle that oscillates by itself: bound the energy, render softer, let go.

A hand that shakes and a wall that shakes the hand look alike while they last: on a device as
damped as it says, a wall at its bound feeds every swing with just the device's losses. They
differ in their end. Where force is given back only as far as energy was taken, a handle that
lived on the wall's energy comes to rest, and begins again when that ends; a trembling hand goes on.
So the bounding is always first, for it is hardly felt, and walls are rendered softer only where an
oscillation stopped by it came back, or where one goes on for so long that no hand makes it.
"""

from __future__ import annotations

from teleop_rt.master.swings import NO_SHAKING, SwingWatch

SOFTER = 0.5
"""Share of the damping counted on so far that is counted on after an oscillation."""
SOFTENINGS = 3
"""An eighth of the damping is friction of bearings alone: a handle that shakes then is let go."""
BOUNDING_S = 1.0
"""How long force is given back only as energy was taken: three swings of the slowest watched."""
QUIET_SHARE = 0.25
"""Swings in the second half of it below this share of those before: the wall had fed them."""
RETURN_S = 3.0
"""An oscillation that comes back within so long after it is the one that was stopped."""
RETURNS = 2
"""Times that it must do so: once, tremor that waxes and wanes may."""
TIRELESS = 14
"""Swings in a row that do not decay, which tremor, a narrow band of noise, makes once in hours."""


class ShakeGuard:
    """Answers swings that grow or last; `trust` is the share of the device's damping counted on.

    A growing oscillation is stopped at its second swing by bounding the energy that is given back.
    """

    def __init__(self, period_s: float, device_damping: float) -> None:
        self._watch = SwingWatch(period_s, device_damping)
        self._period_s = period_s
        self.reset()

    def reset(self) -> None:
        """Trust the device as it says."""
        self._watch.reset()
        self.trust = 1.0
        self.softenings = self.boundings = self._returns = 0
        self.lets_go = False
        self._left_s = self._returns_s = 0.0
        self._size = 0.0

    @property
    def bounding(self) -> bool:
        """Whether force is given back only as far as energy was taken."""
        return self._left_s > 0.0

    def update(self, position: float, velocity: float, force: float, made_J: float) -> bool:
        """Take in a tick; return whether walls are to be rendered softer from now on."""
        found = self._watch.update(position, velocity, force, made_J)
        self._returns_s = max(0.0, self._returns_s - self._period_s)
        if self.bounding:
            self._bounded()
            return self._watch.lasting >= TIRELESS and self._soften()
        if found is NO_SHAKING:
            return False
        self._returns = self._returns + 1 if self._returns_s > 0.0 else 0
        if self._returns == RETURNS:
            return self._soften()
        self._bound()
        return False

    def _bound(self) -> None:
        self.boundings += 1
        self._left_s = BOUNDING_S
        self._size, self._watch.largest = self._watch.largest, 0.0

    def _bounded(self) -> None:
        """Judge, when the bounding ends, whether it stopped the oscillation."""
        before_s, self._left_s = self._left_s, self._left_s - self._period_s
        if before_s >= 0.5 * BOUNDING_S > self._left_s:
            self._watch.largest = 0.0
        if self._left_s <= 0.0:
            quiet = self._watch.largest < QUIET_SHARE * self._size
            self._returns_s = RETURN_S if quiet else 0.0
            self._watch.forget()

    def _soften(self) -> bool:
        """Count on less damping, or let go; return whether walls are to be rendered softer."""
        self._returns = 0
        self._bound()
        self._watch.forget()
        if self.softenings == SOFTENINGS:
            self.lets_go = True
            return False
        self.softenings += 1
        self.trust *= SOFTER
        return True
