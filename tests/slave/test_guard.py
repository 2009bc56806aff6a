import math

import numpy as np
import pytest

from teleop_rt.slave import coupling
from teleop_rt.slave.catch_up import CatchUp
from teleop_rt.slave.depth import NO_MODEL
from teleop_rt.slave.guard import ContactGuard
from teleop_rt.slave.pace import pace
from teleop_rt.slave.record import TickRecord
from teleop_rt.slave.step import followed


def guard() -> ContactGuard:
    return ContactGuard(90.0, 0.1, 0.12, 1e-3, acceleration=math.inf)


def update(guarding, target, **changes):
    known = {
        "command": 0.01,
        "position": changes.get("command", 0.01),
        "force": 0.0,
        "contact_id": 0,
        "acknowledged": 0,
        "surface": math.nan,
        "depth_cap": math.inf,
    }
    return guarding.update(target=target, **(known | changes))


def test_in_free_air_the_master_is_followed():
    assert update(guard(), 0.02) == 0.02


def test_first_contact_stops_following_within_the_tick_until_it_is_acknowledged():
    guarding = guard()
    met = {"contact_id": 1, "surface": 0.0137}
    assert update(guarding, 0.02, command=0.0138, **met) == 0.0138
    assert update(guarding, 0.05, command=0.0138, **met) == 0.0138
    assert update(guarding, 0.005, command=0.0138, **met) == 0.005
    assert update(guarding, 0.015, command=0.0138, acknowledged=1, **met) == 0.015
    assert guarding.waiting_for == 0


def test_a_contact_at_the_known_surface_is_followed_and_one_elsewhere_is_not():
    guarding = guard()
    update(guarding, 0.014, contact_id=1, acknowledged=1, surface=0.0137)
    assert update(guarding, 0.02, contact_id=2, acknowledged=1, surface=0.01372) == 0.02
    nearer = {"contact_id": 3, "acknowledged": 2, "surface": 0.005}
    assert update(guarding, 0.02, command=0.0051, **nearer) == 0.0051


def test_the_target_never_goes_deeper_than_the_force_cap_by_the_model():
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.0137, "depth_cap": 0.025}
    assert update(guard(), 0.05, **known) == 0.0137 + 0.025


def test_above_the_cap_by_measurement_the_tool_is_drawn_back_by_the_secant_at_once():
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.0137}
    pressed = known | {"command": 0.04, "position": 0.0337}
    assert update(guard(), 0.05, force=120.0, **pressed) == pytest.approx(0.0137 + 0.02 * 81 / 120)


def test_above_the_cap_the_tool_is_drawn_back_from_where_it_is_not_from_where_it_was_sent():
    unknown = {"contact_id": 1, "acknowledged": 1, "command": 0.04, "position": 0.0337}
    assert update(guard(), 0.05, force=91.0, **unknown) == 0.0337 - 1e-4
    behind = unknown | {"position": 0.045}
    assert update(guard(), 0.05, force=91.0, **behind) == 0.04 - 1e-4
    assert update(guard(), 0.05, force=89.0, **unknown) == 0.05


def paced(room, command):
    """Where a command goes in a tick of 1 ms: a fifth of its room, for a turn takes 5 ms."""
    return command + room / 5


def test_half_of_the_room_by_the_steepest_slope_is_left_and_a_softer_one_counts_slowly():
    guarding = guard()
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.01}
    assert update(guarding, 0.5, force=20.0, position=0.02, **known) == 0.5, (
        "too little for a verdict"
    )
    known |= {"position": 0.015, "command": 0.015}
    for _ in range(10):
        last = update(guarding, 0.5, force=60.0, **known)
    secant = 60 / 0.005
    assert last == pytest.approx(paced((81 - 60) / (2 * secant), 0.015))
    for _ in range(10):
        update(guarding, 0.5, force=30.0, **known)
    for _ in range(1000):
        last = update(guarding, 0.5, force=30.0, **known)
    assert last == pytest.approx(paced((81 - 30) / (2 * 30 / 0.005), 0.015))
    near = update(guarding, 0.5, force=30.0, **known | {"command": 0.03})
    assert near == pytest.approx(0.015 + (81 - 30) / (2 * 30 / 0.005)), "beyond it, at once"
    behind = update(guarding, 0.5, force=30.0, **known | {"command": 0.01})
    assert behind == pytest.approx(paced((81 - 30) / (2 * 30 / 0.005), 0.01)), (
        "a tool that was drawn back and is still to follow gives the command no way of its own"
    )


def test_a_tool_that_is_pressed_before_the_known_surface_expects_the_stiffest_wall_there():
    """The body has come nearer, and draws back while the tool follows: no slope, and no secant."""
    guarding = ContactGuard(
        90.0, 0.1, 0.12, 1e-3, acceleration=60.0, unknown_speed=0.2, stiffest=40_000.0
    )
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.0165}
    for i in range(2000):
        at = 0.013 + 1e-7 * i
        last = update(guarding, 0.018, force=72.0 - 1e-3 * i, command=at, **known)
    assert at < last < at + 0.04e-3, "room for 11 N, half of it on 40 kN/m, in five ticks"
    tick = guarding._tick
    tick.surface, tick.surface_known, tick.verified_free = 0.0165, 1, 0.0165
    tick.position, tick.command, tick.force = 0.011, 0.011, 0.0
    assert pace(tick, 0.02) < 0.6, "it braked for where the force was found, not for the surface"
    update(guarding, 0.018, force=0.0, command=0.0145, **known)
    assert pace(tick, 0.02) > 0.7, "the body has drawn back from there"


def test_above_the_cap_by_where_the_force_is_heading_the_tool_turns_before():
    guarding = guard()
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.01}
    for force in (40.0, 50.0, 60.0, 70.0, 80.0):
        last = update(guarding, 0.5, force=force, position=0.015, **known)
    assert last < 0.015, "by 10 N a tick it is above 90 N before a command turns the drive"


def led(wish, body, seconds):
    """Return the places and forces of a tool led by `wish(t)` into a `body(x, velocity, t)`.

    It is behind a drive of 100 Hz, and samples are two cycles old.
    """
    guarding, period_s, natural = guard(), 1e-3, 2 * math.pi * 100
    position = reference = wish(0.0)
    velocity, rows = 0.0, []
    late, steps = [(position, 0.0)] * 3, 20
    for tick in range(round(seconds / period_s)):
        allowed = update(
            guarding, wish(tick * period_s), command=reference, position=late[0][0],
            force=late[0][1], contact_id=1, acknowledged=1, surface=0.0,
        )  # fmt: skip
        reference += min(max(allowed - reference, -1.5e-3), 1.5e-3)
        for _ in range(steps):
            pull = natural**2 * (reference - position) - 2 * natural * velocity
            velocity += pull * period_s / steps
            position += velocity * period_s / steps
        force = body(position, velocity, (tick + 1) * period_s)
        late = [*late[1:], (position, force)]
        rows.append((position, force))
    return np.array(rows).T


def pressed(wish, foam, locking, approach=0.0, seconds=2.5):
    """Return the largest force of k x + k x^2/(L - x), whose surface comes nearer."""

    def body(x, _, t):
        depth = max(0.0, x - max(-0.015, -approach * t))
        squeezed = min(depth, 0.98 * locking)
        return foam * (depth + squeezed**2 / (locking - squeezed))

    return led(wish, body, seconds)[1].max()


@pytest.mark.parametrize("damping", [200.0, 425.0, 800.0])
def test_a_tool_in_a_damped_body_goes_in_without_chatter(damping):
    """On its way out it feels nothing; without the slope there it came back at its fastest.

    It chattered for ever between 0 and 92 N, at half of the depth (425 and 800 N s/m).
    """
    places, forces = led(
        lambda t: min(0.015, 0.002 + 0.1 * t),
        lambda x, v, _: max(0.0, 500.0 * x + damping * v) if x > 0.0 else 0.0,
        seconds=0.8,
    )
    assert forces.max() < 0.9 * 90
    assert np.ptp(forces[-100:]) < 1.0
    assert places[-1] == pytest.approx(0.015, abs=1e-5)


@pytest.mark.parametrize(
    ("speed", "approach"), [(0.02, 0.0), (0.1, 0.0), (0.0, 0.025), (0.1, 0.025)]
)
def test_a_foam_that_locks_under_the_tool_or_comes_nearer_stays_below_the_cap(speed, approach):
    largest = pressed(lambda t: min(0.03, 0.012 + speed * t), 300.0, 0.0216, approach)
    assert 0.5 * 90 < largest < 90


@pytest.mark.parametrize(
    ("speed", "locking", "each"),
    [(0.05, 0.004, 0.008), (0.05, 0.006, 0.004), (0.12, 0.010, 0.004), (0.2, 0.008, 0.008)],
)
def test_a_foam_that_locks_within_a_millimetre_is_pressed_to_the_cap_behind_a_link_that_stutters(
    speed, locking, each
):
    """Targets arrive every few cycles and jump then: the tool is faster for a moment."""

    def wish(t):
        return -0.001 + speed * each * math.floor(t / each)

    assert 0.85 * 90 < pressed(wish, 463.0, locking, seconds=0.5) < 0.91 * 90


def test_a_silent_master_lets_the_tool_retreat_to_the_surface_and_no_further():
    guarding = guard()
    assert guarding.retreat(command=0.02, surface=0.0137) == 0.02 - 1e-4
    assert guarding.retreat(command=0.01375, surface=0.0137) == 0.0137
    assert guarding.retreat(command=0.01, surface=0.0137) == 0.01
    assert guarding.retreat(command=0.02, surface=math.nan) == 0.02


def test_an_unknown_material_is_pressed_no_deeper_from_a_share_of_the_cap_on():
    known = {"contact_id": 1, "acknowledged": 1, "surface": 0.0137, "command": 0.015}
    probing = known | {"probing": True}
    assert update(guard(), 0.02, force=0.2 * 90, **probing) == 0.02
    assert update(guard(), 0.02, force=0.26 * 90, **probing) == 0.015
    assert update(guard(), 0.01, force=0.26 * 90, **probing) == 0.01
    assert update(guard(), 0.0152, force=0.26 * 90, **known) == 0.0152


def test_a_slave_that_begins_to_follow_catches_up_no_faster_than_hand_and_retreat_together():
    catching, command, speeds = CatchUp(0.1, 1e-3), 0.0, []
    catching.start()
    for tick in range(400):
        target = 0.02 + 0.05e-3 * tick
        before, command = command, catching.update(target, 0.05, command)
        speeds.append((command - before) / 1e-3)
    assert max(speeds) == pytest.approx(0.15)
    assert command == target, "and then follows"
    assert catching.update(0.5, 0.05, command) == 0.5, "a hand that goes on is followed"


def test_a_hand_that_went_on_while_its_contact_was_waited_for_is_caught_up_with_slowly():
    """The tool was met by a body that moves; the hand is 9 mm ahead when it acknowledges that."""
    record = TickRecord()
    guarding = ContactGuard(90.0, 0.1, 0.3, 1e-3, record, acceleration=60.0)
    CatchUp(0.1, 1e-3, record)
    tick = record.tick
    tick.mode, tick.following, tick.model = coupling.MODEL, 1, NO_MODEL
    tick.contact_id, tick.in_contact, tick.surface = 3, 1, 0.012
    tick.acknowledged, tick.command, tick.position, tick.force = 2, 0.013, 0.013, 2.0
    for lead in np.linspace(0.013, 0.022, 50):
        tick.lead, tick.lead_velocity = lead, 0.03
        tick.command = followed(tick)
        assert tick.command == pytest.approx(0.013), "not acknowledged"
    assert guarding.waiting_for == 3
    tick.acknowledged = 3
    speeds = []
    for _ in range(100):
        before, tick.command = tick.command, followed(tick)
        speeds.append((tick.command - before) / 1e-3)
    assert max(speeds) == pytest.approx(0.13), "a retreat's speed, and the hand's"
    assert tick.command == pytest.approx(0.022)
