"""A tool that is led into a wall at a hand's speed: its force stays within the cap."""

import math

import pytest

from teleop_rt.config.rig import Limits
from teleop_rt.slave import coupling
from teleop_rt.slave.catch_up import CatchUp
from teleop_rt.slave.depth import LINEAR, NO_MODEL, depth_cap
from teleop_rt.slave.guard import ContactGuard
from teleop_rt.slave.limiter import Limiter, limit
from teleop_rt.slave.pace import stopping_speed
from teleop_rt.slave.record import TickRecord
from teleop_rt.slave.step import followed

CAP, SURFACE, PERIOD_S, ACCELERATION = 90.0, 0.0137, 1e-3, 60.0
LIMITS = Limits(
    position_min=-0.06, position_max=0.06, velocity_max=1.5, acceleration_max=ACCELERATION,
    force_max=400.0,
)  # fmt: skip
SLOWLY = stopping_speed(0.65 * CAP / 40_000, 5e-3, ACCELERATION)
"""At which an unknown wall of 40 kN/m is met, 5 ms before the drive brakes."""


class Tool:
    """Behind a drive of 100 Hz, its samples a cycle old and its force one more; 40 kN/m at most."""

    def __init__(self, stiffness, step_at=math.inf, stiffer=0.0):
        self.record = TickRecord()
        ContactGuard(
            CAP, 0.1, 0.12, PERIOD_S, self.record, acceleration=ACCELERATION, unknown_speed=SLOWLY,
            stiffest=40_000.0,
        )  # fmt: skip
        CatchUp(0.1, PERIOD_S, self.record)
        self.limiter = Limiter(LIMITS, PERIOD_S, self.record)
        self.limiter.reset(-0.04)
        self.tick = tick = self.record.tick
        tick.mode, tick.following, tick.model = coupling.MODEL, 1, NO_MODEL
        tick.verified_free, tick.surface = -0.04, math.nan
        self.x, self.v, self.late = -0.04, 0.0, [(-0.04, 0.0)] * 3
        self.largest = self.fastest = 0.0
        self.wall = (stiffness, step_at, stiffer)
        self.above = 0

    def force(self):
        stiffness, step_at, stiffer = self.wall
        depth = max(0.0, self.x - SURFACE)
        return stiffness * depth + stiffer * max(0.0, depth - step_at)

    def knows(self, stiffness):
        """Give it a model, and the surface, up to which all is verified free."""
        tick = self.tick
        tick.surface, tick.surface_known, tick.verified_free = SURFACE, 1, SURFACE
        tick.known_surface, tick.acknowledged = SURFACE, 100
        if stiffness is not None:
            tick.model, tick.model_k, tick.model_n = LINEAR, stiffness, 1.0

    def lead(self, target, velocity):
        """Run a tick towards the master's target."""
        tick = self.tick
        tick.lead, tick.lead_velocity = target, velocity
        tick.position, tick.force = self.late[0]
        self.above = self.above + 1 if tick.force > 0.4 else 0
        if self.above == 3 and not tick.in_contact:
            tick.in_contact, tick.contact_id = 1, tick.contact_id + 1
            tick.surface, tick.surface_known = SURFACE, 1
        if tick.force < 0.2:
            tick.in_contact = 0
            tick.verified_free = max(tick.verified_free, min(tick.position, SURFACE))
        tick.target = followed(tick)
        command, steps, natural = limit(tick, tick.target), 20, 2 * math.pi * 100
        rate, here = tick.command_velocity, command - tick.command_velocity * PERIOD_S
        for i in range(1, steps + 1):
            reference = here + rate * PERIOD_S * i / steps
            pull = natural**2 * (reference - self.x) + 2 * natural * (rate - self.v)
            self.v += (pull - self.force() / 2.0) * PERIOD_S / steps
            self.x += self.v * PERIOD_S / steps
        self.late = [*self.late[1:], (self.x, self.force())]
        self.largest = max(self.largest, self.force())
        self.fastest = max(self.fastest, tick.command_velocity)


def led(tool, speed, ticks=400, start=-0.04, end=0.05):
    """Lead a tool at this speed, then let it stand; return its largest force over the cap."""
    for i in range(ticks):
        tool.lead(min(end, start + speed * i * PERIOD_S), speed)
    return tool.largest / CAP


@pytest.mark.parametrize("stiffness", [4_000.0, 15_000.0, 40_000.0])
@pytest.mark.parametrize("speed", [0.3, 0.8, 1.0])
def test_a_wall_that_nobody_knows_is_met_within_the_cap_by_a_fast_hand(speed, stiffness):
    assert 0.05 < led(Tool(stiffness), speed) < 1.0


@pytest.mark.parametrize("stiffness", [15_000.0, 40_000.0])
def test_a_known_wall_is_met_within_the_cap_at_one_metre_a_second(stiffness):
    tool = Tool(stiffness)
    tool.knows(stiffness)
    assert 0.5 < led(tool, 1.0) < 1.0
    assert tool.fastest > 0.8, "the space before it is known: there the tool is as fast as led"


@pytest.mark.parametrize("speed", [0.3, 0.8])
def test_a_wall_without_a_model_is_known_by_its_last_contact(speed):
    """It was pressed to half of the cap, then left; the hand comes back fast."""
    tool, stiffness = Tool(15_000.0), 15_000.0
    pressed = SURFACE + 0.5 * CAP / stiffness
    for i in range(1200):
        target = min(pressed, -0.04 + 0.1 * i * PERIOD_S)
        tool.tick.acknowledged = tool.tick.contact_id
        tool.lead(target, 0.1)
    for i in range(400):
        tool.lead(pressed - 0.3 * min(i, 150) * PERIOD_S, -0.3)
    assert tool.tick.wall_stiffness == pytest.approx(stiffness, rel=0.2)
    tool.largest = tool.fastest = 0.0
    assert 0.3 < led(tool, speed, start=pressed - 0.045) < 1.0
    assert tool.fastest > 0.9 * speed


@pytest.mark.parametrize("speed", [0.3, 0.5, 1.0])
@pytest.mark.parametrize(("soft", "stiffer", "at"), [(3e3, 37e3, 0.008), (500.0, 15e3, 0.01)])
def test_a_stiffer_layer_where_the_tool_was_never_pressed_is_met_within_the_cap(
    speed, soft, stiffer, at
):
    tool = Tool(soft, at, stiffer)
    tool.knows(soft)
    assert 0.3 < led(tool, speed) < 1.0


@pytest.mark.parametrize("speed", [0.3, 0.8, 1.4])
@pytest.mark.parametrize("modelled", [True, False])
def test_a_layer_that_was_pressed_before_is_met_again_within_the_cap(speed, modelled):
    """6.8 mm of 500 N/m and of 40 kN/m, pressed to half of the cap; the hand comes back fast.

    The secant, as the model of the upper layer, has the cap at 11 mm and more.
    """
    tool = Tool(500.0, 0.006, 40_000.0)
    tool.knows(500.0 if modelled else None)
    for i in range(1200):
        tool.tick.acknowledged = tool.tick.contact_id
        tool.lead(min(SURFACE + 0.0071, -0.04 + 0.1 * i * PERIOD_S), 0.1)
    for i in range(400):
        tool.lead(SURFACE + 0.0071 - 0.3 * min(i, 200) * PERIOD_S, -0.3)
    tool.largest = tool.fastest = 0.0
    assert 0.4 < led(tool, speed, start=SURFACE - 0.05, end=SURFACE + 0.02) < 1.0
    assert tool.fastest > 0.8 * speed


def test_as_deep_as_a_body_was_pressed_the_tool_is_as_fast_as_the_hand():
    tool = Tool(1000.0)
    tool.knows(1000.0)
    led(tool, 0.1, ticks=1200, end=SURFACE + 0.02)
    for i in range(400):
        tool.lead(SURFACE + 0.02 - 0.3 * min(i, 150) * PERIOD_S, -0.3)
    tool.fastest = 0.0
    led(tool, 0.6, ticks=100, start=SURFACE - 0.025, end=SURFACE + 0.02)
    assert tool.fastest > 0.55
    depth_at = tool.tick.command - SURFACE
    assert depth_at > 0.015


def test_where_the_tool_has_been_it_is_as_fast_as_the_hand():
    tool = Tool(15_000.0)
    tool.tick.verified_free = 0.06
    tool.wall = (0.0, math.inf, 0.0)
    led(tool, 0.9, ticks=110)
    assert tool.fastest == pytest.approx(0.9, rel=0.02)


def test_where_nobody_has_been_the_tool_is_as_slow_as_the_stiffest_wall_asks():
    tool = Tool(0.0)
    led(tool, 0.9, ticks=300)
    assert tool.fastest == pytest.approx(SLOWLY, rel=0.05)


def test_a_stopping_speed_is_that_of_latency_and_braking_together():
    speed = stopping_speed(2e-3, 5e-3, 60.0)
    assert speed * 5e-3 + speed**2 / 120 == pytest.approx(2e-3)
    assert stopping_speed(2e-3, 5e-3, math.inf) == pytest.approx(0.4)
    assert depth_cap(Tool(0.0).tick) == math.inf


@pytest.mark.parametrize("speed", [0.7, 1.0, 1.4])
def test_the_tool_has_braked_to_that_speed_where_the_unknown_begins(speed):
    """A cycle is as long as the braking moves on in it: the pace is that of the cycle's end."""
    tool = Tool(0.0)
    tool.tick.verified_free = 0.0
    for i in range(300):
        tool.lead(min(0.05, -0.04 + speed * i * PERIOD_S), speed)
        if tool.tick.command > 0.0:
            assert tool.tick.command_velocity < 1.02 * SLOWLY
    assert tool.fastest > 0.8 * speed
