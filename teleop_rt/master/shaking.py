"""What is done about a handle that oscillates by itself: bound it, render softer, let go."""

from __future__ import annotations

from teleop_rt.master.swings import Shaking, SwingWatch

SOFTER = 0.5
"""Share of the damping counted on so far that is counted on after an oscillation."""
SOFTENINGS = 3
"""An eighth of the damping is friction of bearings alone: what shakes then is let go."""
BOUNDING_S = 1.0
"""How long force is given back only as energy was taken: three swings of the slowest watched."""


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
        self.softenings = 0
        self.lets_go = False
        self._bounding_s = 0.0

    @property
    def bounding(self) -> bool:
        """Whether force is given back only as far as energy was taken."""
        return self._bounding_s > 0.0

    def update(self, position: float, velocity: float, force: float, made_J: float) -> bool:
        """Take in a tick; return whether walls are to be rendered softer from now on."""
        self._bounding_s = max(0.0, self._bounding_s - self._period_s)
        found = self._watch.update(position, velocity, force, made_J)
        if found is Shaking.NO:
            return False
        self._watch.forget()
        self._bounding_s = BOUNDING_S
        if self.softenings == SOFTENINGS:
            self.lets_go = True
            return False
        self.softenings += 1
        self.trust *= SOFTER
        return True
