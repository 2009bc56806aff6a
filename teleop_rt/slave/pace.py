"""How fast the tool may go towards a body that it may meet.

No guard prevents the force of a wall that a tool meets too fast, so a wall must be met slowly where
its stiffness is not known. A drive of the acceleration a stands v t + v²/2a after the wall, t being
the latency from there to its braking. On a wall that is known the command brakes in time for the
depth of DEPTH_SHARE of the cap, which a model gives. Beyond the space that was verified free, and
on a surface that was only grazed, the tool is no faster than `unknown_speed`, from which it stands
within that share on the rig's stiffest wall; it brakes for it on its way there. Deeper in a body
than it was ever pressed, it is no faster than the same share allows beyond the force that it had
there: a stiffer layer may begin there, or have begun before. A body that comes nearer within space
that was free meets a tool that may be faster.
"""

from __future__ import annotations

import math

from teleop_rt.config.rig import RigConfig
from teleop_rt.kernels.jit import kernel
from teleop_rt.slave.record import Tick

DEPTH_SHARE = 0.9
"""The share of the force cap for which the model's depth is computed: no estimate is exact."""
PROBING_SHARE = 0.25
"""The share of the force cap up to which an unknown material is pressed."""
CREEP_SHARE = 0.05
"""Of the cap, by which a body that was pressed to DEPTH_SHARE is tried deeper: damping may have
been a part of it. It leaves as much again."""
DRIVE_S = 0.002
"""By so much a drive is late: a position loop of 100 Hz follows a ramp 2 to 3 ms behind."""


@kernel
def stopping_speed(way: float, late_s: float, acceleration: float) -> float:
    """Return the speed v from which a tool stands within `way`: v late + v²/2a."""
    return 2.0 * way / (late_s + math.sqrt(late_s * late_s + 2.0 * way / acceleration))


def latency_s(rig: RigConfig) -> float:
    """Return the time from a force at the tool to where the drive brakes on its account."""
    sensors, period_s = rig.sensors, rig.period_ns * 1e-9
    slowest_hz = rig.axis.sample_rate_hz or rig.rate_hz
    force_s = 1e-3 * (max(0.0, sensors.force_lag_ms) + sensors.force_settling_ms)
    return force_s + max(period_s, 1.0 / slowest_hz) + period_s + DRIVE_S


def unknown_speed(rig: RigConfig, force_cap: float, stiffness: float) -> float:
    """Return the speed at which a wall of this stiffness may be met that nobody knows.

    The tool stands within DEPTH_SHARE of the cap; it brakes from PROBING_SHARE of it on at the
    latest.
    """
    way = (DEPTH_SHARE - PROBING_SHARE) * force_cap / stiffness
    return float(stopping_speed(way, latency_s(rig), rig.limits.acceleration_max))


def met_within_cap(rig: RigConfig, force_cap: float, speed: float) -> float:
    """Return the stiffest unknown wall that may be met at this speed."""
    way = speed * latency_s(rig) + speed * speed / (2.0 * rig.limits.acceleration_max)
    return (DEPTH_SHARE - PROBING_SHARE) * force_cap / way


@kernel
def pace(tick: Tick, deepest: float) -> float:
    """Return the speed at which the tool can meet any body that may be there.

    `deepest` is the depth of the cap by the model, infinite while there is none.
    """
    slowest = tick.unknown_speed
    if math.isinf(slowest):
        return math.inf
    nearest = tick.verified_free
    if tick.surface_known > 0 and nearest >= tick.surface - tick.tolerance:
        nearest = tick.surface
        if math.isfinite(deepest) or tick.wall_stiffness > 0.0:
            nearest += tick.pressed
            left = DEPTH_SHARE * tick.force_cap - max(tick.force, tick.pressed_force)
            room = max(left, CREEP_SHARE * tick.force_cap) / tick.stiffest
            slowest = stopping_speed(room, tick.late_s, tick.acceleration)
    if tick.nearer < nearest:
        nearest, slowest = tick.nearer, tick.unknown_speed
    way, step = max(0.0, nearest - tick.command), tick.acceleration * tick.period_s
    square = step * step + slowest * slowest + 2.0 * tick.acceleration * way
    return max(slowest, math.sqrt(square) - step)
