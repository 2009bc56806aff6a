"""The trials that the campaign of hands draws, and its two judges of an oscillation."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from teleop_rt_dev.campaign import hands as campaign_hands
from teleop_rt_dev.hands import second_judge
from teleop_rt_dev.hands.ideal import IdealWall
from teleop_rt_dev.hands.oscillation import longest_oscillation

T = 1e-3


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
    return campaign_hands.load_trial_file(campaign_hands.TRIAL, drawn.changes)


@pytest.mark.parametrize(
    ("share", "lasts", "kept"), [(1.05, 10, True), (1.05, 11, False), (1.2, 1, False)]
)
def test_a_tool_may_pass_its_cap_by_a_tenth_and_for_two_reversals(share, lasts, kept):
    over = np.zeros(1000, dtype=bool)
    over[100 : 100 + lasts] = over[500:503] = True
    lasted_ms = campaign_hands.longest_ms(over, 1000)
    assert lasted_ms == max(lasts, 3)
    found = {"tool_over_cap": share, "tool_over_cap_ms": lasted_ms}
    assert campaign_hands.tool_is_kept(found) is kept


def test_every_kind_of_wall_and_holding_is_drawn_and_loads():
    drawn = [campaign_hands.draw(number, 5.0) for number in range(60)]
    assert {one.kind for one in drawn} == set(campaign_hands.KINDS)
    rigs = {path.stem for path in (campaign_hands.TRIAL.parents[1] / "rigs").glob("*handle.yaml")}
    assert {f"simulated_{one.handle}" for one in drawn} == rigs
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
    assert campaign_hands.judge(trial, stored, OUTCOME)["holds"], "the energy of springs is no gift"
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


def trial_of_loose_hand(tremor_N=0.0, tremor_hz=8.0):
    """A trial.yaml as the second judge reads it: a loose hand on a wall of 3 kN/m."""
    trial = trial_of(2)
    plain = campaign_hands.dump(trial, trial.rig.units)
    plain["operator"]["hand"] |= {"tremor_N": tremor_N, "tremor_hz": tremor_hz}
    plain["operator"]["hand"] |= {"let_go_s": None, "grip_change": 0.0, "stiffness_N_per_m": 200.0}
    plain["operator"]["hand"] |= {"mass_N_s2_per_m": 0.3, "damping_N_s_per_m": 3.0}
    plain["plant"]["environment"] |= {"stiffness_N_per_m": 3000.0, "damping_N_s_per_m": 0.0}
    plain["plant"] |= {"undeclared": []}
    return plain


def test_the_second_judge_finds_what_the_hand_does_not_do_by_itself():
    t = np.arange(3000) * T
    wave = np.sin(2 * np.pi * 8 * t)
    assert second_judge.judge(trial_of_loose_hand(), 1e-3 * wave, 3.0 * wave)
    assert not second_judge.judge(trial_of_loose_hand(), 1e-3 * wave, 0.2 * wave)
    assert not second_judge.judge(trial_of_loose_hand(), 0.05e-3 * wave, 3.0 * wave)
    decays = np.exp(-3 * t) * wave
    assert not second_judge.judge(trial_of_loose_hand(), 1e-3 * decays, 3.0 * decays)


def test_the_second_judge_leaves_a_trembling_hand_its_own_swings():
    trial = trial_of_loose_hand(tremor_N=1.5)
    body = second_judge.Body.of_plant(trial["plant"])
    own = second_judge.against(body, trial, 3000, T, chance=100)
    assert own
    t = np.arange(3000) * T
    worst = max(own, key=lambda row: row.swings)
    wave = np.sin(2 * np.pi * worst.hz * t)
    motion, force = 0.5 * worst.size_m * wave, 0.5 * worst.size_m * worst.stiffness * wave
    assert not second_judge.judge(trial, motion, force)
    larger = 5 * max(row.size_m for row in own) / worst.size_m
    assert second_judge.judge(trial, larger * motion, larger * force)


def test_the_second_judge_reads_hidden_effects_with_and_without_units():
    plant = trial_of_loose_hand()["plant"]
    short = {"effect": "second_layer", "stiffness": 5000.0, "depth": 0.004}
    long = {"effect": "second_layer", "stiffness_N_per_m": 5000.0, "depth_m": 0.004}
    for layer in (short, long):
        body = second_judge.Body.of_plant(plant | {"undeclared": [layer]})
        wall = body.numbers
        force = second_judge.wall_force(wall, wall[0] + 0.006, 0.0, 0.0)
        assert force == pytest.approx(3000 * 0.006 + 5000 * 0.002)


def test_the_second_judge_shares_no_code_with_the_project():
    text = Path(second_judge.__file__).read_text(encoding="utf-8")
    imports = [line for line in text.splitlines() if line.startswith(("import ", "from "))]
    assert imports
    assert not [line for line in imports if "teleop_rt" in line or line.startswith("from .")]


def test_only_swings_as_large_as_those_seen_are_the_hands_own(monkeypatch):
    trial, t = trial_of(2), np.arange(3000) * T
    truth = np.zeros((t.size, 6))
    truth[:, 1], truth[:, 4], truth[:, 5] = 1e-3 * np.sin(50 * t), 3.0 * np.sin(50 * t), -0.01 * t
    asked = []

    def ideal(share):
        def motion(_trial, wall):
            asked.append(wall.stiffness)
            return share * truth[:, 1] * (wall.stiffness is not None), 3.0 * np.sin(50 * t)

        return motion

    softened = {"passivity": {"stiffness": {"true": 2e4, "rendered": 6e3}, "stiffness_max": 6e3}}
    for share, holds in ((0.5, False), (0.9, True)):
        monkeypatch.setattr(campaign_hands, "ideal_motion", ideal(share))
        found = campaign_hands.judge(trial, truth, OUTCOME | softened)
        assert (found["swings"] < campaign_hands.SUSTAINED, found["hands_own"]) == (holds, holds)
    assert asked == [None, 6e3, None, 6e3]
    as_stiff = {"passivity": {"stiffness": {"true": 6e3, "rendered": 6e3}, "stiffness_max": 7e3}}
    assert not campaign_hands.judge(trial, truth, OUTCOME | as_stiff)["hands_own"]
