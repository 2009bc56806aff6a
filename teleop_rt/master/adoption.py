"""Adopting a new wall without a jump: blended forces, a force-step limit and an energy tank.

f = (1 - w) f_old + w f_new. A step Δw changes the force by Δw (f_new - f_old) and the energy
stored under the hand by ΔE = Δw (V_new - V_old). The change of force is limited per tick; the
energy is paid from a tank that the hand's own dissipation fills (Franken et al. 2011).

Duration. A force that changes within a tenth of a second is a kick: a hand on a wall rings after
it. So w follows a cosine over `BLEND_S`, which has no tones far above 1/BLEND_S. A large change
takes longer. A change below the force step takes proportionally less time, so that the wall
follows converging estimates.

New walls during a blend. A wall that arrives waits, and replaces one that waits already. It
becomes `new` as soon as the tank can pay the exchange, or when w is 1. Blends do not go back for
a newer wall: if walls came faster than a blend lasts, the force would swing. Only a blend that
the tank cannot pay goes back, to w = 0, where an exchange costs nothing; it therefore never
blocks a later and cheaper wall.

Walls at the same force. A wall placed so that its spring gives the present force is taken
without a blend of that spring: at once, or over the time for the change of its damping. In a
blend, a hand that still goes deeper would meet a wall that is too soft, and would soon store
more energy than the tank can pay.
"""

from __future__ import annotations

import math
from dataclasses import replace

from teleop_rt.kernels.jit import bound
from teleop_rt.master.tank import Tank
from teleop_rt.master.wall_law import felt, within
from teleop_rt.master.walls import NO_WALL, Wall

Felt = tuple[float, float, float]
"""Of a wall at the hand: its force, its spring's, neither beyond the largest, and the energy."""

BLEND_S = 0.2
"""How long a blend takes that changes the force by its step or more: a hand rings at 4 to 10 Hz."""
GENTLE_STEPS = 4.0
"""Force steps up to which a change takes `BLEND_S`; a larger one takes longer by the root of it.

The tones of a cosine of length T fall with the square of fT, so that the ringing stays the same: at
5 Hz on 6 kN/m swings of 0.2 mm, as after 0.2 s for the 2 N of four steps of the shipped handles.
"""
LONGEST_S = 0.5
"""The longest blend, for a wrong wall is felt so long: at 4 Hz a fifteenth of a change rings."""
STARVED_S = 0.1
"""A blend for which the tank has had nothing for so long is at a standstill."""
PLACE_HALVINGS = 16
"""Of the depth, to place a hand in a wall: below a ten-thousandth of it."""


class Adoption:
    """The rendered wall: an old one and a new one, blended.

    `stored_J` is the energy of the springs at the hand in this tick.
    """

    def __init__(self, force_max: float, force_step: float, tank: Tank) -> None:
        self._force_max = force_max
        self._force_step = force_step
        self.tank = tank
        self._of_law = bound(felt, (), *NO_WALL.law, 0.0, 0.0, 0.0)
        self._felts: dict[int, Felt] = {}
        self.reset()

    def reset(self) -> None:
        """Forget every wall and fill the tank."""
        self.tank.reset()
        self.drop()
        self.energy_J = 0.0
        self.largest_step = 0.0

    def drop(self) -> None:
        """Forget every wall."""
        self.old = self.new = NO_WALL
        self._waiting: Wall | None = None
        self.weight = 1.0
        self._lasts_s: float | None = None
        self._next_lasts_s: float | None = None
        self._starved_s = 0.0
        self.stored_J = self.stepped_J = 0.0

    @property
    def newest(self) -> Wall:
        """The wall offered last."""
        return self.new if self._waiting is None else self._waiting

    @property
    def starved(self) -> bool:
        """Whether the tank cannot pay for the blend, and has not for a while."""
        return self.weight < 1 and self._starved_s > STARVED_S

    def holds(self, position: float) -> bool:
        """Return whether the hand is inside a wall that is rendered now."""
        return self.new.holds(position) or (self.weight < 1 and self.old.holds(position))

    def affords(self, wall: Wall, position: float) -> bool:
        """Return whether the tank has the energy for a complete blend to `wall` here."""
        return self._energy(wall, position) - self.stored(position) <= self.tank.level_J

    def stored(self, position: float) -> float:
        """Return the energy [J] that the springs hold as blended."""
        if self.weight >= 1:
            return self._energy(self.new, position)
        old = (1 - self.weight) * self._energy(self.old, position)
        return old + self.weight * self._energy(self.new, position)

    def place_of(self, wall: Wall, position: float) -> float:
        """Return where in `wall` the hand at `position` is to be placed: where it pushes as felt.

        A softer wall of the same force holds more energy. Where the tank cannot pay for that, the
        hand is placed less deep, at the energy that there is, and feels less.
        """
        place = wall.position_of(self.elastic_force(position))
        most_J = self.stored(position) + max(0.0, self.tank.level_J)
        if self._energy(wall, place) <= most_J:
            return place
        low, high = wall.surface_now, place
        for _ in range(PLACE_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._energy(wall, middle) < most_J else (low, middle)
        return low

    def shift(self, distance: float) -> None:
        """Move the rendered walls with the hand's coordinate; the force stays."""
        self.old = replace(self.old, surface=self.old.surface + distance)
        self.new = replace(self.new, surface=self.new.surface + distance)
        self._waiting = None

    def reflect(self, wall: Wall, position: float, force: float) -> None:
        """Render a wall alone, moved to where its spring gives a force, a step nearer at most."""
        felt = self.elastic_force(position)
        change = within(within(force, self._force_max) - felt, self._force_step)
        self.drop()
        self.old = self.new = replace(wall, surface=position - (felt + change) / wall.k)

    def move(self, position: float, dt_s: float, most_W: float) -> float:
        """Let the surfaces move for a tick; return the energy [J] that they put into the springs.

        They move more slowly where they would work on the hand with more than `most_W`.
        """
        if self.new.surface_velocity == 0.0 == self.old.surface_velocity:
            return 0.0
        old, new, stored_J = self.old, self.new, self.stored(position)
        share = 1.0
        self.old, self.new = old.moved(dt_s), new.moved(dt_s)
        work_J = self.stored(position) - stored_J
        if abs(work_J) > most_W * dt_s:
            share = most_W * dt_s / abs(work_J)
            self.old, self.new = old.moved(dt_s, share), new.moved(dt_s, share)
            work_J = self.stored(position) - stored_J
        if self._waiting is not None:
            self._waiting = self._waiting.moved(dt_s, share)
        return work_J

    def offer(self, wall: Wall, lasts_s: float | None = None) -> None:
        """Take a wall to be adopted over the next ticks: in `lasts_s`, or 0 as fast as may be.

        Without, it takes as long as a hand needs that is not to ring.
        """
        self._starved_s = 0.0
        if self.weight >= 1:
            self.old, self.new, self.weight = self.new, wall, 0.0
            self._lasts_s = lasts_s
        else:
            self._waiting, self._next_lasts_s = wall, lasts_s

    def update(self, position: float, velocity: float, dt_s: float) -> float:
        """Move the blend as far as this tick allows, and return the force.

        `stored_J` is then the energy of the springs, `stepped_J` the part from this tick's blend.
        """
        self.stepped_J = 0.0
        if not self.holds(position) and not self.newest.holds(position):
            self.old = self.new = self.newest
            self._waiting, self.weight = None, 1.0
            self.stored_J = 0.0
            self.tank.fill(0.0, dt_s)
            return 0.0
        self._felts.clear()
        if self.weight < 1:
            before = self._rendered(position, velocity)[0]
            self._blend(position, velocity, self._exchange(position, velocity), dt_s)
            step = abs(self._rendered(position, velocity)[0] - before)
            self.largest_step = max(self.largest_step, step)
        force, elastic, self.stored_J = self._rendered(position, velocity)
        deeper = velocity - self.new.surface_velocity
        damping = force - elastic - self.new.calming * deeper
        self.tank.fill(damping * deeper * dt_s, dt_s)
        return force

    def elastic_force(self, position: float) -> float:
        """Return the force of the springs as blended."""
        new = within(self.new.elastic_force(position), self._force_max)
        old = within(self.old.elastic_force(position), self._force_max)
        return (1 - self.weight) * old + self.weight * new

    def _energy(self, wall: Wall, position: float) -> float:
        if wall.terms:
            return wall.energy(position, self._force_max)
        return self._of_law(*wall.law, position - wall.surface, 0.0, self._force_max)[2]

    def _felt(self, wall: Wall, position: float, velocity: float) -> Felt:
        """Return a wall's force on the hand in this tick; computed once."""
        found = self._felts.get(id(wall))
        if found is not None:
            return found
        most = self._force_max
        if wall.terms:
            force, spring = wall.force(position, velocity), wall.elastic_force(position)
            found = within(force, most), within(spring, most), wall.energy(position, most)
        else:
            found = self._of_law(*wall.law, position - wall.surface, velocity, most)
        self._felts[id(wall)] = found
        return found

    def _rendered(self, position: float, velocity: float) -> Felt:
        """Return the blended force on the hand."""
        new = self._felt(self.new, position, velocity)
        weight = self.weight
        if weight >= 1:
            return new
        old = self._felt(self.old, position, velocity)
        return (
            (1 - weight) * old[0] + weight * new[0],
            (1 - weight) * old[1] + weight * new[1],
            (1 - weight) * old[2] + weight * new[2],
        )

    def _exchange(self, position: float, velocity: float) -> float:
        """Put the waiting wall in the place of the new one if affordable; return the step left."""
        if self._waiting is None:
            return self._force_step
        at_once = self._next_lasts_s == 0.0
        if at_once and self._takes_over(self._waiting, position, velocity):
            return 0.0
        waiting = self._felt(self._waiting, position, velocity)
        new = self._felt(self.new, position, velocity)
        step, cost_J = self.weight * abs(waiting[0] - new[0]), self.weight * (waiting[2] - new[2])
        if step > self._force_step or cost_J > self.tank.level_J:
            return self._force_step
        self._pay(cost_J)
        self.new, self._waiting = self._waiting, None
        self._lasts_s = self._next_lasts_s
        return self._force_step - step

    def _takes_over(self, wall: Wall, position: float, velocity: float) -> bool:
        """Render a wall alone if its force equals the rendered one, and the tank covers the energy.

        Returns whether it is rendered now.
        """
        alone, rendered = self._felt(wall, position, velocity), self._rendered(position, velocity)
        step, cost_J = alone[0] - rendered[0], alone[2] - rendered[2]
        if abs(step) > self._force_step or cost_J > self.tank.level_J:
            return False
        self._pay(cost_J)
        self.old = self.new = wall
        self._waiting, self.weight = None, 1.0
        return True

    def _blend(self, position: float, velocity: float, force_step: float, dt_s: float) -> None:
        new = self._felt(self.new, position, velocity)
        old = self._felt(self.old, position, velocity)
        difference, cost_J = new[0] - old[0], new[2] - old[2]
        unpaid = (1 - self.weight) * cost_J > self.tank.level_J
        backwards = self._waiting is not None and unpaid
        room = self._unhurried(abs(difference), dt_s, backwards=backwards)
        if abs(difference) * room > force_step:
            room = force_step / abs(difference)
        starved = cost_J * room > self.tank.level_J and not backwards
        self._starved_s = self._starved_s + dt_s if starved else 0.0
        if starved:
            room = max(0.0, self.tank.level_J) / cost_J
        change = -room if backwards else room
        self._pay(change * cost_J)
        self.weight = min(1.0, max(0.0, self.weight + change))
        if self._waiting is not None and self.weight in {0.0, 1.0}:
            self.old = self.new if self.weight else self.old
            self.new, self._waiting, self.weight = self._waiting, None, 0.0
            self._lasts_s = self._next_lasts_s

    def _unhurried(self, difference: float, dt_s: float, *, backwards: bool) -> float:
        """Return by how much the weight may move in a tick: along a cosine over a blend or less.

        Faster, a blend is a step for a hand on a wall, which then rings.
        """
        steps = difference / self._force_step
        lasts_s = self._lasts_s
        if lasts_s is None:
            lasts_s = min(LONGEST_S, BLEND_S * math.sqrt(max(1.0, steps / GENTLE_STEPS)))
        lasts_s *= min(1.0, steps)
        if lasts_s <= dt_s:
            return self.weight if backwards else 1 - self.weight
        angle = math.acos(1 - 2 * self.weight)
        turn = math.pi * dt_s / lasts_s
        angle = max(0.0, angle - turn) if backwards else min(math.pi, angle + turn)
        return abs(0.5 * (1 - math.cos(angle)) - self.weight)

    def _pay(self, cost_J: float) -> None:
        self.tank.spend(cost_J)
        self.energy_J += max(0.0, cost_J)
        self.stepped_J += cost_J
