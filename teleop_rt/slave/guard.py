"""The slave's own limits on its target: at a first contact, and by force.

First contact under delay. The slave meets a wall one link delay before the master is informed.
Within that tick it stops following, and holds its target there until the master's motion
acknowledges the contact. From then on the master's target counts from the wall that it renders.
A contact is unexpected if no surface was known, or if the known one lies elsewhere.

Depth by the model. In contact the target never goes deeper than the depth at which the model
reaches the force cap. While no model gives that depth, or the master has not received it, the
operator feels only a soft provisional wall. The tool then goes no deeper once the force reaches
a share of the cap: the rest is for the force that a stiff wall adds until the drive stands.

Depth by measurement. A model is late for a wall that stiffens, so two measurements bound the
target as well.

- The secant f/d, of force f and depth d. The target goes no deeper than DEPTH_SHARE cap d/f.
  Above the cap, it is at once at least one step of the retreat outside of the tool.
- The newest slope. A wall that stiffens is steeper ahead than its secant, so the slope counts
  AHEAD times, from the force as it will be once a command has turned the drive. That gives the
  room that is left below the cap. It counts from the tool, or from the command if the tool is
  still to be drawn back to it: the way back into a damped body adds force, too. Within the known
  surface the room counts at any force: a tool on its way out of a damped body feels none, and
  would otherwise return at its fastest and chatter.

Pace. A tool at speed v goes on by v TURN_S whatever is commanded. The command therefore uses up
the room in no less than TURN_S: if the target jumps, the tool meets a locking foam slowly enough
to be turned in it. The slope sets only the pace: while it is more than half of the true one, the
force settles at the same share of the cap.

Memory. Steeper slopes and secants count at once; softer ones only as the memory fades, because
damping makes a wall look soft while the tool draws back. A slope fades only while another is
measured: a tool that stands at the cap measures none, and would ring each time it had forgotten.

A body that has come nearer. A tool that is pressed before the known surface has no secant, and
its slope may be the body's own motion. The rig's stiffest wall is then assumed.

Remaining force. No guard prevents the force of a wall that becomes stiffer around the tool, nor
the depth added until a sample shows the force and the drive, commanded to go in at v, has
reversed: F <= max(cap, F_found + k (v t_turn + v²/2a)).
"""

from __future__ import annotations

import math

from teleop_rt.contact.law import touches
from teleop_rt.kernels.jit import kernel
from teleop_rt.slave.pace import DEPTH_SHARE, PROBING_SHARE, stopping_speed
from teleop_rt.slave.record import Tick, TickRecord

UNEXPECTED_SHARE = 0.02
"""A contact further than this share of the axis range before the known surface is unexpected."""
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


@kernel
def forget_walls(tick: Tick) -> None:
    """Forget every wall."""
    tick.wall_stiffness = tick.wall_force = tick.pressed = tick.pressed_force = 0.0
    tick.known_surface = tick.hold_at = tick.slope_from = math.nan
    tick.nearer = math.inf
    tick.met_contact = tick.waiting_for = tick.slope_place = 0
    tick.secant = tick.slope = tick.slope_from_force = 0.0
    tick.slope_kept = 1.0


@kernel
def force_ahead(tick: Tick, position: float, force: float) -> float:
    """Take in a sample; return the force that is there once a command has turned the tool.

    `slope` is how steep the wall is where the tool is. It has faded by `slope_kept` once there is
    another to compare it with.
    """
    if math.isnan(tick.slope_from):
        tick.slope_from, tick.slope_from_force = position, force
        for i in range(tick.slope_count):
            tick.forces[i] = force
    before = tick.forces[tick.slope_place]
    tick.forces[tick.slope_place] = force
    tick.slope_place = (tick.slope_place + 1) % tick.slope_count
    tick.slope_kept *= tick.fading
    moved = position - tick.slope_from
    if abs(moved) >= tick.slope_step:
        tick.slope = max(tick.slope * tick.slope_kept, (force - tick.slope_from_force) / moved)
        tick.slope_kept = 1.0
        tick.slope_from, tick.slope_from_force = position, force
    return float(force + max(0.0, force - before - tick.slope_noticed))


@kernel
def depth_by_secant(tick: Tick, depth: float, force: float) -> float:
    """Return the depth of DEPTH_SHARE of the cap by measurement; infinite while unknown."""
    tick.secant *= tick.fading
    if touches(depth) and force > PROBING_SHARE * tick.force_cap:
        tick.secant = max(tick.secant, force / depth)
    if tick.secant > 0.0:
        return DEPTH_SHARE * tick.force_cap / tick.secant
    return math.inf


@kernel
def remember_wall(tick: Tick, position: float, depth: float, force: float) -> None:
    """Keep how deep it was pressed, and the secant where the last contact pressed hardest.

    `nearer` is where it was pressed before its surface: it has come nearer, by more than is known.
    """
    if depth > tick.pressed:
        tick.pressed, tick.pressed_force = depth, force
    if not touches(depth) and force > PROBING_SHARE * tick.force_cap:
        tick.nearer = min(tick.nearer, position)
    elif position > tick.nearer and force < tick.slope_noticed:
        tick.nearer = math.inf
    if touches(depth) and force > max(PROBING_SHARE * tick.force_cap, tick.wall_force):
        tick.wall_force, tick.wall_stiffness = force, force / depth


@kernel
def meet(tick: Tick, contact_id: int, acknowledged: int, command: float, surface: float) -> None:
    """Take in a contact that is new; an unexpected one is waited for."""
    known = tick.known_surface
    tick.met_contact = contact_id
    tick.known_surface = surface
    tick.wall_force, tick.nearer = 0.0, math.inf
    if abs(surface - known) > tick.tolerance:
        tick.wall_stiffness = tick.pressed = tick.pressed_force = 0.0
    tick.secant = max(tick.secant, tick.wall_stiffness)
    if acknowledged >= contact_id:
        return
    if math.isnan(known) or abs(surface - known) > tick.tolerance:
        tick.waiting_for = contact_id
        tick.hold_at = command


@kernel
def guarded(
    tick: Tick,
    target: float,
    command: float,
    position: float,
    force: float,
    contact_id: int,
    acknowledged: int,
    surface: float,
    depth_cap: float,
    probing: bool,
) -> float:
    """Return the target that the axis may follow in this cycle: see `ContactGuard.update`."""
    if contact_id > tick.met_contact:
        meet(tick, contact_id, acknowledged, command, surface)
    if acknowledged >= tick.waiting_for:
        tick.waiting_for = 0
    if tick.waiting_for > 0:
        target = min(target, tick.hold_at)
    if math.isfinite(surface):
        remember_wall(tick, position, position - surface, force)
        depth_cap = min(depth_cap, depth_by_secant(tick, position - surface, force))
        target = min(target, surface + depth_cap)
    ahead = force_ahead(tick, position, force)
    steep, presses = tick.slope, ahead > PROBING_SHARE * tick.force_cap
    if presses:
        steep = max(steep, tick.secant)
        # False for an unknown surface (NaN), for which `not touches(...)` would be true.
        if position <= surface and math.isfinite(tick.stiffest):
            steep = max(steep, tick.stiffest)
    if steep > 0.0 and (presses or touches(position - surface)):
        room = (DEPTH_SHARE * tick.force_cap - ahead) / (AHEAD * steep)
        left = room - max(0.0, command - position)
        if left > 0.0:
            left = stopping_speed(left, TURN_S, tick.acceleration) * tick.period_s
        target = min(target, command + left)
    if probing and force > PROBING_SHARE * tick.force_cap:
        target = min(target, command)
    if force > tick.force_cap:
        target = min(target, min(command, position) - tick.retreat_step)
        tick.hold_at = min(tick.hold_at, target)
    return target


@kernel
def retreated(tick: Tick, command: float, surface: float) -> float:
    """Return a target on the way back to the surface, for when nobody leads."""
    if not math.isfinite(surface) or command <= surface:
        return command
    return max(surface, command - tick.retreat_step)


class ContactGuard:
    """Turns the master's target into one that is safe for the environment."""

    def __init__(
        self,
        force_cap: float,
        retreat_speed: float,
        axis_range: float,
        period_s: float,
        record: TickRecord | None = None,
        *,
        acceleration: float,
        unknown_speed: float = math.inf,
        stiffest: float = math.inf,
        late_s: float = TURN_S,
    ) -> None:
        self._tick = tick = (record or TickRecord()).tick
        tick.force_cap, tick.period_s = force_cap, period_s
        tick.acceleration, tick.unknown_speed = acceleration, unknown_speed
        tick.stiffest, tick.late_s = stiffest, late_s
        tick.retreat_step = retreat_speed * period_s
        tick.fading = math.exp(-period_s / FADING_S)
        tick.tolerance = UNEXPECTED_SHARE * axis_range
        tick.slope_step, tick.slope_noticed = SLOPE_SHARE * axis_range, RISE_SHARE * force_cap
        tick.slope_count = max(1, round(TURN_S / period_s))
        self.reset()

    def reset(self) -> None:
        """Forget every wall."""
        forget_walls(self._tick)

    @property
    def waiting_for(self) -> int:
        """The contact that the master must acknowledge before it is followed deeper; 0 for none."""
        return int(self._tick.waiting_for)

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
        news = (contact_id, acknowledged, surface, depth_cap, probing)
        return guarded(self._tick, target, command, position, force, *news)

    def retreat(self, *, command: float, surface: float) -> float:
        """Return a target on the way back to the surface, for when nobody leads."""
        return retreated(self._tick, command, surface)
