"""The target of the slave: where the hand is, but for jumps that no hand made."""

from __future__ import annotations

import math

from teleop_rt.master.engagement import ENGAGED, FROZEN, LinkState
from teleop_rt.master.registration import VANISHING_SHARE, HandMotion
from teleop_rt.master.walls import Wall


class Aim:
    """The target, kept while frozen, then rejoining the hand without a jump.

    After a freeze the gap between tool and hand vanishes as an offset does: by at most half of the
    hand's motion, at `offset_speed` at most, so that a hand at rest moves no tool. A tool that
    presses deeper than the hand draws back at once, at that speed: nobody feels its contact.

    The tool follows at the same pace a hand that a new wall has put deeper: nothing was
    measured at that depth, and no guard turns a tool in time that a step drives there. A hand
    that withdraws takes the tool with it at once.
    """

    def __init__(self, offset_speed: float, clearance: float, dt_s: float) -> None:
        self._step = offset_speed * dt_s
        self._moves = HandMotion(clearance)
        self.reset()

    def reset(self) -> None:
        """Begin at the operator's start."""
        self.target = self._offset = self._hand = 0.0
        self._moves.reset()
        self.forget()

    def forget(self) -> None:
        """Forget all that keeps the target away from the hand."""
        self._rejoining = self._deepens = False

    def update(
        self, hand: float, velocity_step: float, offset: float, state: LinkState, wall: Wall
    ) -> float:
        """Return the target of a tick, for a hand that moves by `velocity_step` in it."""
        moved, motion = hand - self._hand, self._moves.by(hand)
        offset_before = self._offset
        self._hand, self._offset = hand, offset
        if state is FROZEN:
            self._rejoining = True
            return self.target
        gap = hand - offset - self.target
        deeper = state is ENGAGED and gap > 0.0 and offset_before - offset > self._step
        self._deepens = (self._deepens or deeper) and gap > max(self._step + velocity_step, 0.0)
        if self._rejoining:
            self.target += self._rejoined(gap, moved, motion, wall)
        else:
            self.target += self._step + velocity_step if self._deepens else gap
        return self.target

    def _rejoined(self, gap: float, moved: float, motion: float, wall: Wall) -> float:
        """Return by how much the target moves towards a hand that it has lost in a freeze."""
        rest = gap - moved
        presses = rest < 0.0 and wall.holds(self.target)
        step = self._step if presses else min(self._step, VANISHING_SHARE * motion)
        self._rejoining = abs(rest) > step
        return moved + math.copysign(step, rest) if self._rejoining else gap
