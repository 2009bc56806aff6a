"""A slice of the campaign of hands, and its own measure of an oscillation."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from teleop_rt_dev.campaign import hands as campaign_hands
from teleop_rt_dev.hands.ideal import IdealWall
from teleop_rt_dev.hands.oscillation import longest_oscillation

T = 1e-3


@pytest.mark.parametrize("number", [2, 7])
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


def truth_of(given_J: list[float], motor_N: list[float]):
    """Rows of HANDLE_TRUTH of a device at rest."""
    rows = np.zeros((len(given_J), 6))
    rows[:, 4], rows[:, 5] = motor_N, given_J
    return rows


OUTCOME = {
    "handle": {"softenings": 0, "fault": {"name": "none"}},
    "passivity": {"stiffness": None, "stiffness_max": None},
}


def trial_of(number):
    drawn = campaign_hands.draw(number, 5.0)
    file = campaign_hands.TRIALS / drawn.handle
    return campaign_hands.load_trial_file(file, drawn.changes)


def test_every_kind_of_wall_and_holding_is_drawn_and_loads():
    drawn = [campaign_hands.draw(number, 5.0) for number in range(60)]
    assert {one.kind for one in drawn} == set(campaign_hands.KINDS)
    assert {one.handle for one in drawn} == {"handle.yaml", "serial_handle.yaml"}
    let_go = [change for one in drawn for change in one.changes if "let_go_s" in change]
    assert any(change.endswith("=0.0") for change in let_go)
    assert 0 < len(let_go) < 30
    for number in range(0, 12, 3):
        trial_of(number)


def test_energy_that_a_contact_gave_back_beyond_the_tank_is_found():
    trial = trial_of(2)
    kept = truth_of([0, 1.0, 2.0, 1.95, 1.95], [0, 5.0, 9.0, 4.0, 0])
    assert campaign_hands.judge(trial, kept, OUTCOME)["holds"]
    stored = truth_of([0, 1.0, 2.0, 0.5, 2.5], [0, 5.0, 9.0, 4.0, 0])
    assert campaign_hands.judge(trial, stored, OUTCOME)["holds"], "what springs hold is no gift"
    given = truth_of([3.0, 4.0, 5.0, 3.5, 2.5], [0, 5.0, 9.0, 4.0, 0])
    judged = campaign_hands.judge(trial, given, OUTCOME)
    assert judged["given_mJ"] == pytest.approx(500.0)
    assert not judged["holds"]


def test_a_force_above_the_cap_is_found():
    trial, still = trial_of(2), np.zeros((1000, 6))
    assert campaign_hands.judge(trial, still, OUTCOME)["holds"]
    still[200:230, 4] = 110.0
    assert not campaign_hands.judge(trial, still, OUTCOME)["holds"]


@pytest.mark.parametrize(("change", "depth_m", "force_N"), [
    ({}, 0.01, 36.0 + 2.0),
    ({"hunt_crossley": {"exponent": 2.0, "depth": 0.005}}, 0.01, 72.0 + 8.0),
])  # fmt: skip
def test_the_ideal_wall_is_the_plants_own_law(change, depth_m, force_N):
    from teleop_rt_drivers.simulated.config import EnvironmentConfig  # noqa: PLC0415
    from teleop_rt_drivers.simulated.reference import environment_force  # noqa: PLC0415

    body = {"stiffness": 3600.0, "damping": 20.0, "surface": 0.0} | change
    plant = SimpleNamespace(environment=EnvironmentConfig(**body), undeclared=())
    assert IdealWall(plant).force(depth_m, 0.1, 0.0) == pytest.approx(force_N)
    position = np.linspace(depth_m - 0.1, depth_m, 1001)
    truth = {"environment": plant.environment.model_dump(), "undeclared": ()}
    force = environment_force(truth, position, np.full(1001, 0.1), 1e-3)
    assert force[-1] == pytest.approx(force_N, rel=1e-6)
