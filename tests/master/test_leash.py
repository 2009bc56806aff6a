"""The leash: a brake that holds, follows a hand that goes back, and is taken away slowly."""

from __future__ import annotations

from itertools import pairwise

import pytest

from teleop_rt.master.leash import RELEASE_S, Leash

T = 1e-3


def pulled(lead: float) -> tuple[Leash, float]:
    """A leash of 50 mm and 40 N whose hand has gone on by 10 mm at this lead."""
    leash, hand = Leash(0.05, 40.0, 5000.0, T), 0.0
    for tick in range(100):
        hand = 1e-4 * tick
        leash.update(hand, lead)
    return leash, hand


@pytest.mark.parametrize(
    ("lead", "force"), [(0.02, 0.0), (0.0375, 20.0), (0.05, 40.0), (0.1, 40.0)]
)
def test_the_brake_grows_from_half_of_the_leash_and_slips_at_its_end(lead, force):
    leash, hand = pulled(lead)
    assert leash.update(hand, lead) == pytest.approx(force)
    assert leash.slipped is (lead >= 0.05)


def test_a_hand_that_goes_back_is_not_pushed():
    leash, hand = pulled(0.05)
    assert leash.update(hand - 0.02, 0.05) == 0.0
    assert leash.update(hand - 0.021, 0.05) == 0.0


def test_a_hand_that_leans_against_it_is_not_flung_when_the_slave_follows():
    """A spring of 400 N/m held by the whole brake, whose lead is gone in a tick."""
    leash, hand = pulled(0.05)
    forces = [leash.update(hand, 0.05)]
    for _ in range(round(1.1 * RELEASE_S / T)):
        moved = (forces[0] - forces[-1]) / 400.0
        forces.append(leash.update(hand + moved, 0.0))
    steps = [before - after for before, after in pairwise(forces)]
    assert max(steps) <= 40.0 * T / RELEASE_S * (1 + 1e-6)
    assert min(steps) >= 0.0
    assert forces[-1] == 0.0


def test_a_hand_that_swings_while_the_brake_lets_go_is_not_held_again():
    """To and fro it is a spring no more: each time that the hand goes back, less is left."""
    leash, hand = pulled(0.05)
    held = leash.update(hand, 0.05)
    ways = [-0.001, 0.0, -0.001, 0.001]
    forces = [leash.update(hand + way, 0.0) for way in ways]
    assert all(after <= before for before, after in pairwise([held, *forces]))
    assert forces[-1] < held - 9.0  # twice a millimetre of 5000 N/m
