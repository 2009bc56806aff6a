"""The leash: a brake that holds, follows a hand that goes back, and is taken away slowly."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

import pytest

from teleop_rt.master.leash import RELEASE_S, Leash
from teleop_rt.master.passivity import Port
from teleop_rt.master.wall_limiter import WallLimiter
from teleop_rt_dev.bench.lockstep import count

T = 1e-3


def pulled(lead: float) -> tuple[Leash, float]:
    """A leash of 50 mm and 40 N whose hand has gone on by 10 mm at this lead."""
    leash, hand = Leash(0.05, 40.0, (5000.0, 0.0), T), 0.0
    for tick in range(100):
        hand = 1e-4 * tick
        leash.update(hand, lead, 0.0)
    return leash, hand


@pytest.mark.parametrize(
    ("lead", "force"), [(0.02, 0.0), (0.0375, 20.0), (0.05, 40.0), (0.1, 40.0)]
)
def test_the_brake_grows_from_half_of_the_leash_and_slips_at_its_end(lead, force):
    leash, hand = pulled(lead)
    assert leash.update(hand, lead, 0.0) == pytest.approx(force)
    assert leash.slipped is (lead >= 0.05)


def test_a_leash_that_holds_nothing_notes_the_lead_in_one_call():
    leash, _ = pulled(0.02)
    _, calls = count(lambda: leash.update(0.0, 0.024, 0.0))
    assert calls == 2  # with the function above
    leash.update(0.0, 0.01, 0.0)
    assert leash.longest == 0.024
    assert leash.largest == 0.0


def test_a_hand_that_goes_back_is_not_pushed():
    leash, hand = pulled(0.05)
    assert leash.update(hand - 0.02, 0.05, 0.0) == 0.0
    assert leash.update(hand - 0.021, 0.05, 0.0) == 0.0


def test_a_hand_that_leans_against_it_is_not_flung_when_the_slave_follows():
    """A spring of 400 N/m held by the whole brake, whose lead is gone in a tick."""
    leash, hand = pulled(0.05)
    forces = [leash.update(hand, 0.05, 0.0)]
    for _ in range(round(1.1 * RELEASE_S / T)):
        moved = (forces[0] - forces[-1]) / 400.0
        forces.append(leash.update(hand + moved, 0.0, 0.0))
    steps = [before - after for before, after in pairwise(forces)]
    assert max(steps) <= 40.0 * T / RELEASE_S * (1 + 1e-6)
    assert min(steps) >= 0.0
    assert forces[-1] == 0.0


def test_a_hand_that_leans_lightly_does_not_ring_when_the_brake_lets_go():
    """6 N of a brake of 40 N: taken away in 0.15 s, a hand of 4.5 Hz swings by two millimetres."""
    leash, stiffness, mass = Leash(0.05, 40.0, (5000.0, 0.0), T), 1960.0, 2.4
    x, v, rest, lead = 0.0012, 0.0, 0.0012 + 6.0 / 1960.0, 0.05
    leash.update(0.0, lead, 0.0)
    places = []
    for _ in range(round(1.5 * RELEASE_S / T)):
        force = leash.update(x, lead, v)
        v += (stiffness * (rest - x) - force - 8.0 * v) / mass * T
        x, lead = x + v * T, 0.0
        places.append(x)
    at = places.index(max(places))
    assert max(places) - min(places[at:]) < 0.0005
    assert places[-1] == pytest.approx(rest, abs=0.0002)


def test_a_hand_that_swings_while_the_brake_lets_go_is_not_held_again():
    """To and fro it is a spring no more: each time that the hand goes back, less is left."""
    leash, hand = pulled(0.05)
    held = leash.update(hand, 0.05, 0.0)
    ways = [-0.001, 0.0, -0.001, 0.001]
    forces = [leash.update(hand + way, 0.0, 0.0) for way in ways]
    assert all(after <= before for before, after in pairwise([held, *forces]))
    assert forces[-1] < held - 9.0  # twice a millimetre of 5000 N/m


def test_a_hand_that_taps_on_the_brake_comes_to_rest():
    """A hand of 1.6 kg that leans with 20 N, on a device of 8 N s/m that answers 0.48 ms late."""
    port = Port(T, 8.0, "difference", 30.0, 0.48e-3)
    grip = WallLimiter(port, 100.0, 1.0).grip
    leash = Leash(0.05, 40.0, grip, T)
    late = deque([20.0, 20.0], maxlen=2)
    x = 20.0 / grip[0]
    v, velocity, before, tops = 0.05, 0.0, x, []
    leash.update(0.0, 0.05, 0.0)
    pole = math.exp(-2 * math.pi * 30.0 * T)
    for _ in range(round(0.5 / T)):
        velocity += (1 - pole) * ((x - before) / T - velocity)
        before = x
        late.append(leash.update(x, 0.05, velocity))
        for step in range(20):
            acts = late[0] if step * T / 20 < 0.48e-3 else late[1]
            was = v
            v += (20.0 - acts - 8.0 * v) / 1.6 * T / 20
            x += v * T / 20
            if was > 0.0 >= v:
                tops.append(x - 20.0 / grip[0])
    angular = math.sqrt(grip[0] / 1.6)
    damping = -1.6 * angular / (2 * math.pi) * math.log(tops[2] / tops[0])
    assert damping > 1.5 * 8.0  # 0.5 N s/m on a grip at the bound without damping


def test_a_lead_that_jumps_is_held_without_a_step_and_gives_no_energy():
    """A hand of 0.16 m/s whose slave is seen 3 mm further back than a tick ago."""
    leash, hand, forces, energy = Leash(0.05, 40.0, (5000.0, 20.0), T, 0.5), 0.0, [0.0], 0.0
    for tick in range(300):
        way = 0.16 * T if tick < 200 else -0.16 * T
        lead = 0.02 if tick < 10 else 0.05
        hand += way
        forces.append(leash.update(hand, lead, way / T))
        energy += forces[-1] * way
        assert energy >= 0.0
    assert max(after - before for before, after in pairwise(forces)) == pytest.approx(0.5)
    assert max(forces) == leash.largest == 40.0
    assert leash.slipped


def test_a_hand_that_the_leash_had_no_time_to_hold_has_not_pushed_through_it():
    leash = Leash(0.05, 40.0, (5000.0, 0.0), T, 0.5)
    forces = [leash.update(0.001 * tick, 0.06, 1.0) for tick in range(20)]
    assert forces[-1] == pytest.approx(9.5)
    assert not leash.slipped
