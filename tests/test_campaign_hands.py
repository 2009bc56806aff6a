"""A slice of the campaign of hands, and its own measure of an oscillation."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))

import campaign_hands
from hand_oscillation import longest_oscillation

T = 1e-3


@pytest.mark.parametrize("number", [2, 3])
def test_a_drawn_hand_on_a_drawn_wall_holds(number):
    found = campaign_hands.run(number, 3.0)
    assert found["holds"], found


@pytest.mark.parametrize(
    ("hz", "size", "decay", "force", "shakes"),
    [
        (8.0, 1e-3, 0.0, 3.0, True),
        (8.0, 1e-3, 1.0, 3.0, False),
        (8.0, 0.15e-3, 0.0, 3.0, False),
        (8.0, 1e-3, 0.0, 0.3, False),
        (2.0, 5e-3, 0.0, 3.0, False),
        (50.0, 1e-3, 0.0, 3.0, False),
    ],
)
def test_an_oscillation_is_five_swings_that_do_not_decay(hz, size, decay, force, shakes):
    t = np.arange(3000) * T
    wave = np.exp(-decay * t) * np.sin(2 * np.pi * hz * t)
    swings, _ = longest_oscillation(0.5 * size * wave, 0.5 * force * wave, T)
    assert (swings >= campaign_hands.SUSTAINED) is shakes


def test_energy_that_the_tank_cannot_hold_and_force_above_the_cap_are_found():
    name, changes = campaign_hands.draw(0)
    trial = campaign_hands.load_trial_file(campaign_hands.TRIALS / name, changes)
    outcome = {
        "handle": {"softenings": 0, "fault": {"name": "none"}},
        "passivity": {"stiffness": None, "stiffness_max": None},
    }
    still = np.zeros((1000, 6))
    judged = campaign_hands.judge(trial, still, {"energy_min_J": 0.0}, outcome, "none")
    assert judged["holds"]
    given = campaign_hands.judge(trial, still, {"energy_min_J": -1.0}, outcome, "none")
    assert not given["holds"]
    still[200:230, 4] = 110.0
    assert not campaign_hands.judge(trial, still, {"energy_min_J": 0.0}, outcome, "none")["holds"]
