"""The wall of a first touch, before any model: its stiffness from the slave's states.

The first wall is soft, since nothing is known: it stops the hand, and the slave can be led on. Each
later state has a force and the place where it was measured, however old both are, and two of them
are a slope: the wall is placed where that slope has no force. So a hand feels about the right
stiffness one way after the touch, before an estimator has converged.
"""

from __future__ import annotations

from teleop_rt.link.messages import StateMessage
from teleop_rt.master.walls import Wall

NEWS = 1.5
"""Factor by which a slope must differ from the last to be a new wall: each moves the tool."""


class Provisional:
    """Follows the states of a touch; `rise` is the least force over which a slope is taken.

    Slopes are taken on the way in alone: on the way out damping has the other sign.
    """

    def __init__(self, stiffness: float, rise: float) -> None:
        self._soft, self._rise = stiffness, rise
        self.reset()

    def reset(self) -> None:
        """Forget the touch."""
        self._met: StateMessage | None = None
        self._deepest = 0.0
        self._stiffness = self._soft

    def begin(self, surface: float, state: StateMessage) -> Wall:
        """Return the wall of a new touch, at a surface."""
        self.reset()
        self._met = state if state.in_contact else None
        return Wall(surface, self._soft)

    def update(self, state: StateMessage) -> Wall | None:
        """Return the wall that a newer state shows, None where it is about the same."""
        if not state.in_contact:
            return None
        met = self._met = self._met or state
        deeper, rise = state.position - met.position, state.force - met.force
        if deeper <= self._deepest:
            return None
        self._deepest, stiffness = deeper, rise / deeper
        if rise < self._rise or self._stiffness / NEWS <= stiffness <= self._stiffness * NEWS:
            return None
        self._stiffness = stiffness
        return Wall(met.position - max(0.0, met.force) / stiffness, stiffness)
