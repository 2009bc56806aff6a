"""The wall of a first touch, before any model: its stiffness from the slave's states.

The first wall is soft, since nothing is known: it stops the hand, and the slave can be led on. Each
later state has a force and the place where it was measured, however old both are, and two of them
are a slope: the wall is placed where that slope has no force. So a hand feels about the right
stiffness one way after the touch, before an estimator has converged.

The wall promises no more than was measured: where a tool at rest feels less than the wall would
give at its place, as after a jolt or a fast approach through damping, the wall is lowered to the
measured force. A moving tool shows little of a spring: damping acts, and the force is late.
"""

from __future__ import annotations

import math
from collections import deque

from teleop_rt.link.messages import StateMessage
from teleop_rt.master.walls import Wall

NEWS = 1.5
"""Factor by which a slope must differ from the last, or the wall's force exceed the one measured
at rest, for a new wall: each new wall moves the tool."""
STATES_AT_REST = 10
"""So many states in a row must have no more than the margin of the wall's force between them."""


class Provisional:
    """Follows the states of a touch; `rise` is the least force over which a slope is taken.

    `wall` is the part known of it, `slope` the last measured one, 0 before that. The rise is also
    a margin by which the wall may exceed a force measured at rest. Slopes are taken on the way in
    alone: on the way out damping has the other sign.
    """

    def __init__(self, stiffness: float, rise: float) -> None:
        self._soft, self._rise = stiffness, rise
        self.reset()

    def reset(self) -> None:
        """Forget the touch."""
        self._met: StateMessage | None = None
        self._deepest, self.gives_way = 0.0, False
        self.wall, self.slope = Wall(math.inf, self._soft), 0.0
        self._places: deque[float] = deque(maxlen=STATES_AT_REST)

    def begin(self, surface: float, state: StateMessage) -> Wall:
        """Return the wall of a new touch, at a surface."""
        self.reset()
        self._met = state if state.in_contact else None
        self.wall = Wall(surface, self._soft)
        return self.wall

    def update(self, state: StateMessage) -> Wall | None:
        """Return the wall that a newer state shows, None where it is about the same.

        `gives_way` says whether it is the one before that has given way to the tool's force.
        """
        self.gives_way = False
        if not state.in_contact:
            return None
        met = self._met = self._met or state
        self._places.append(state.position)
        deeper, rise = state.position - met.position, state.force - met.force
        known, slope = self.wall, rise / deeper if deeper > 0.0 else 0.0
        goes_on = deeper > self._deepest and rise >= self._rise
        self._deepest = max(self._deepest, deeper)
        self.slope = slope if goes_on else self.slope
        if goes_on and not known.k / NEWS <= slope <= known.k * NEWS:
            self.wall = Wall(met.position - max(0.0, met.force) / slope, slope)
        promised = self.wall
        self.wall = self._supported(state, met)
        self.gives_way = promised is known and self.wall is not known
        return self.wall if self.wall is not known else None

    def _supported(self, state: StateMessage, met: StateMessage) -> Wall:
        """Return the wall, moved or else softened where it exceeds the force of a state.

        It is not moved behind the place where the touch was met.
        """
        wall, felt = self.wall, max(0.0, state.force)
        moved = max(self._places) - min(self._places)
        at_rest = len(self._places) == STATES_AT_REST and wall.k * moved <= self._rise
        if not at_rest or wall.elastic_force(state.position) <= NEWS * felt + self._rise:
            return wall
        given = max(felt, self._rise)
        surface = state.position - given / wall.k
        if surface <= met.position:
            return Wall(surface, wall.k)
        return Wall(met.position, given / (state.position - met.position))
