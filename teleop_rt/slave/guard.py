"""The slave's own limits on where the master may lead it.

First contact under delay: the slave meets a wall one delay before the master is informed. It
stops following within the tick and holds where it met the wall, until the master's motion
acknowledges that contact; from then on the master's target counts from the wall that it renders.
A contact is unexpected where no surface was known, or where the known one lies elsewhere.

In contact the target never goes deeper than the depth at which the model reaches the force cap.
While no model gives that depth, or the master has not received it, the operator feels only a soft
provisional wall: then the tool goes no deeper from a share of the cap on, which leaves room for
the force that a stiff wall adds until the drive stands.

A model follows a wall that stiffens only later, so the cap is also kept by measurement. A force f
at the depth d gives the secant stiffness f/d, by which DEPTH_SHARE of the cap lies at
d DEPTH_SHARE cap/f: the target goes no deeper, and above the cap it is at once at least a step of
the retreat in front of the tool. A wall that stiffens with depth is far steeper ahead than its
secant, so the tool goes no further than the slope that was measured last, taken AHEAD times, leaves
room for, by the force as it will be once a command has turned the drive. That slope sets the pace
alone: wherever it is more than half of the true one, the force settles at the same share of the
cap. Steeper slopes and secants count at once, softer ones as their memory fades: while the tool
draws back, damping makes the wall look soft. No guard can prevent the force of a wall that
becomes stiffer around the tool, or the depth added until a sample shows it and the drive, commanded
to go in at v, has reversed: F <= max(cap, F_found + k v t_turn).
"""

from __future__ import annotations

import math

UNEXPECTED_SHARE = 0.02
"""A contact further than this share of the axis range before the known surface is unexpected."""
DEPTH_SHARE = 0.9
"""The share of the force cap for which the model's depth is computed: no estimate is exact."""
PROBING_SHARE = 0.25
"""The share of the force cap up to which an unknown material is pressed."""
FADING_S = 0.1
"""Time constant with which the memory of a stiffer secant fades."""
SLOPE_SHARE = 5e-4
"""Way over which a slope is measured, as a share of the axis range: many steps of its encoder."""
AHEAD = 2.0
"""By so much a wall may be steeper over the room that is left than where the tool is now."""
TURN_S = 0.005
"""From a force to the tool's turning: a sample, a cycle each way, and a drive's lag."""


RISE_SHARE = 0.02
"""Of the cap: a force that rises by less within TURN_S may be noise, which would add up."""


class SlopeAhead:
    """Measures how steep the wall is where the tool is; allocates nothing in a tick."""

    def __init__(self, step: float, noticed: float, period_s: float) -> None:
        self._step, self._noticed = step, noticed
        self._fading = math.exp(-period_s / FADING_S)
        self._forces = [0.0] * max(1, round(TURN_S / period_s))
        self.reset()

    def reset(self) -> None:
        """Forget the wall."""
        self.stiffness = 0.0
        self._place = 0
        self._from_force = 0.0
        self._from = math.nan

    def update(self, position: float, force: float) -> float:
        """Take in a sample; return the force that is there once a command has turned the tool."""
        if math.isnan(self._from):
            self._from, self._from_force = position, force
            self._forces[:] = [force] * len(self._forces)
        before, self._forces[self._place] = self._forces[self._place], force
        self._place = (self._place + 1) % len(self._forces)
        self.stiffness *= self._fading
        moved = position - self._from
        if abs(moved) >= self._step:
            self.stiffness = max(self.stiffness, (force - self._from_force) / moved)
            self._from, self._from_force = position, force
        return force + max(0.0, force - before - self._noticed)


class CatchUp:
    """Lets a slave that begins to follow catch up with the master at a safe speed.

    One way later than the slave began, the hand is where nobody has been: what the tool touches on
    its way there it must meet at the speed of a retreat, or of the hand, not at its own fastest.
    """

    def __init__(self, speed: float, period_s: float) -> None:
        self._speed = speed
        self._period_s = period_s
        self._behind = False

    def start(self) -> None:
        """Begin to follow."""
        self._behind = True

    def update(self, target: float, velocity: float, command: float) -> float:
        """Return the target on the way from the last command, at the master's `velocity` or so."""
        gap = target - command
        reach = (self._speed + abs(velocity)) * self._period_s
        self._behind = self._behind and abs(gap) > reach
        return command + math.copysign(reach, gap) if self._behind else target


class ContactGuard:
    """Turns the master's target into one that is safe for the environment."""

    def __init__(
        self, force_cap: float, retreat_speed: float, axis_range: float, period_s: float
    ) -> None:
        self._force_cap = force_cap
        self._retreat_step = retreat_speed * period_s
        self._fading = math.exp(-period_s / FADING_S)
        self._tolerance = UNEXPECTED_SHARE * axis_range
        self._slope = SlopeAhead(SLOPE_SHARE * axis_range, RISE_SHARE * force_cap, period_s)
        self.reset()

    def reset(self) -> None:
        """Forget every wall."""
        self._known_surface = math.nan
        self._contact_id = 0
        self.waiting_for = 0
        self._hold_at = math.nan
        self._secant = 0.0
        self._slope.reset()

    def update(
        self,
        *,
        target: float,
        command: float,
        position: float,
        force: float,
        contact_id: int,
        acknowledged: int,
        surface: float,
        depth_cap: float,
        probing: bool = False,
    ) -> float:
        """Return the target that the axis may follow in this cycle.

        `command` is the last command, `position` and `force` the newest sample's; `acknowledged`
        the contact that the master has adopted;
        `depth_cap` the depth at which the model reaches the force cap (infinite while unknown);
        `probing` says that there is no model yet, or none that the operator feels.
        """
        if contact_id > self._contact_id:
            self._meet(contact_id, acknowledged, command, surface)
        if acknowledged >= self.waiting_for:
            self.waiting_for = 0
        if self.waiting_for:
            target = min(target, self._hold_at)
        if math.isfinite(surface):
            depth_cap = min(depth_cap, self._depth_by_secant(position - surface, force))
            target = min(target, surface + depth_cap)
        ahead = self._slope.update(position, force)
        steep = max(self._slope.stiffness, self._secant)
        if steep > 0.0 and ahead > PROBING_SHARE * self._force_cap:
            room = (DEPTH_SHARE * self._force_cap - ahead) / (AHEAD * steep)
            target = min(target, position + room)
        if probing and force > PROBING_SHARE * self._force_cap:
            target = min(target, command)
        if force > self._force_cap:
            target = min(target, min(command, position) - self._retreat_step)
            self._hold_at = min(self._hold_at, target)
        return target

    def _depth_by_secant(self, depth: float, force: float) -> float:
        """Return the depth of DEPTH_SHARE of the cap by measurement; infinite while unknown."""
        self._secant *= self._fading
        if depth > 0.0 and force > PROBING_SHARE * self._force_cap:
            self._secant = max(self._secant, force / depth)
        return DEPTH_SHARE * self._force_cap / self._secant if self._secant > 0.0 else math.inf

    def retreat(self, *, command: float, surface: float) -> float:
        """Return a target on the way back to the surface, for when the master is silent."""
        if not math.isfinite(surface) or command <= surface:
            return command
        return max(surface, command - self._retreat_step)

    def _meet(self, contact_id: int, acknowledged: int, command: float, surface: float) -> None:
        known = self._known_surface
        self._contact_id = contact_id
        self._known_surface = surface
        if acknowledged >= contact_id:
            return
        if math.isnan(known) or abs(surface - known) > self._tolerance:
            self.waiting_for = contact_id
            self._hold_at = command
