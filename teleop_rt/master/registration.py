"""Where the master's wall lies: the offset o = x_m - x_s and the first contact under delay.

The slave meets a wall one delay before the master hears of it; by then the hand is deeper.
Every question is answered by geometry alone, with x_v = x_m - o, the hand in the slave's
coordinates, which is also the target that is sent:

- A wall arrives while the hand is inside a wall that is rendered: the force is blended
  (`adoption.py`) and o stays. So a refined surface, a stiffer model, or the news of a contact
  that the hand felt one round trip ago never move the wall's place under the hand.
- A wall arrives while the hand is outside of all that is rendered, and x_v is in front of it:
  nothing but the wall changes, its force and energy are zero there.
- A wall arrives while the hand is outside and x_v would be inside it, as at first contact: the
  wall is adopted where the hand is, o = x_m - surface. Penetration, force and energy are zero
  at that tick; the target steps back to the surface, where the slave holds.

So loss, jitter and reordering can only delay an adoption, never make a wrong one: it depends
on where the hand is when the news come, not on which packet came. The contact is acknowledged
with the wall that was adopted for it, or at once where the hand already presses on its own wall.
On later contacts with a known wall the hand meets the rendered wall first and the slave the
real one a delay later; the third case does not arise and no offset is made. If the environment
has come nearer meanwhile, it does, and the new wall is again adopted at the hand.

State messages report a contact before any model exists. Without a wall of its own the
master then renders a soft provisional one at the slave's position, so that the hand is stopped
and the slave can be led on to press and identify.

Two walls are taken over by force instead: the first model in the place of a provisional wall,
because the depth of the hand in that says nothing about the real wall; and a wall that stores more
energy under the hand than the tank can pay, as where a soft material has turned into a stiff one.
Their spring gives at once the force that the hand feels at that moment, o = x_m - surface -
(f/k)^(1/n): no jump, no push, and the slave comes back to where the environment gives the
operator's force.

The offset vanishes only out of contact, while the hand moves: by at most half of its motion, so
that the tool goes where the hand goes, at 0.5 to 1.5 times its pace, and at most at
`offset_speed`. It never moves x_v into a wall or closer than `clearance` to it, and motion within
`REST_SHARE` of that, as of a trembling encoder, is rest: a hand at rest drives the slave nowhere.
"""

from __future__ import annotations

import math

from teleop_rt.link.messages import StateMessage
from teleop_rt.master.walls import Wall

VANISHING_SHARE = 0.5
"""Of the hand's motion, by which the offset vanishes: 1 would stop the tool of a hand that
withdraws, and more would drive it against the hand."""
REST_SHARE = 0.1
"""Of the clearance: the play within which motion of the hand counts as rest."""
PHANTOM_STATES = 20
"""States in a row that must find free space inside the wall before it is withdrawn."""


class HandMotion:
    """The motion of the hand from call to call, beyond a play: a trembling encoder is at rest."""

    def __init__(self, clearance: float) -> None:
        self._play = REST_SHARE * clearance
        self.reset()

    def reset(self) -> None:
        """Begin at the operator's start."""
        self._moved_from = 0.0

    def by(self, hand: float) -> float:
        """Return by how much the hand has moved since the last call."""
        before, play = self._moved_from, self._play
        self._moved_from = min(max(before, hand - play), hand + play)
        return abs(self._moved_from - before)


class Registration:
    """The offset between hand and slave, in the rig's unit of position."""

    def __init__(self, offset_speed: float, clearance: float) -> None:
        self._offset_speed = offset_speed
        self._clearance = clearance
        self._moves = HandMotion(clearance)
        self.reset()

    def reset(self) -> None:
        """Forget the offset."""
        self.offset = 0.0
        self._moves.reset()

    def index(self, hand: float, slave: float) -> None:
        """Count the hand's motion from where the slave stands."""
        self.offset = hand - slave

    def adopt_at_hand(self, hand: float, wall: Wall) -> None:
        """Put the hand onto the wall's surface if it would be inside; for walls not yet felt."""
        if wall.bilateral or hand - self.offset <= wall.surface:
            return
        self.offset = hand - wall.surface
        if hand - self.offset > wall.surface:
            self.offset += math.ulp(hand)

    def place(self, hand: float, position: float) -> None:
        """Put the hand to a position of the slave's."""
        self.offset = hand - position

    def relax(self, hand: float, wall: Wall, dt_s: float) -> None:
        """Let some of the offset vanish; only to be called out of contact."""
        step = min(self._offset_speed * dt_s, VANISHING_SHARE * self._moves.by(hand))
        if self.offset < 0:
            self.offset = min(0.0, self.offset + step)
        elif self.offset > 0:
            nearest = hand - (wall.surface - self._clearance)
            self.offset = min(self.offset, max(0.0, self.offset - step, nearest))


class PhantomWatch:
    """Finds that the slave stands, free, where the rendered wall would push noticeably."""

    def __init__(self, noticeable_force: float) -> None:
        self._noticeable_force = noticeable_force
        self.reset()

    def reset(self) -> None:
        """Forget the registration."""
        self._count = 0
        self._depth = 0.0

    def update(self, slave: StateMessage, wall: Wall) -> float | None:
        """Return the depth to which the wall is to be withdrawn, or None; one call per state."""
        free = min(slave.position, slave.verified_free)
        force = wall.elastic_force(free)
        # Below its onset force a contact is not yet seen; a force as the wall's is no free space.
        touched = slave.in_contact or slave.force >= force + min(wall.b * slave.velocity, 0.0)
        if touched or wall.bilateral or force < self._noticeable_force:
            self._count = 0
            return None
        self._depth = free if self._count == 0 else min(self._depth, free)
        self._count += 1
        if self._count < PHANTOM_STATES:
            return None
        self._count = 0
        return self._depth
