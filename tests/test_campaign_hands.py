"""The trials that the campaign of hands draws, and its two judges of an oscillation."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from teleop_rt.master.walls import Wall
from teleop_rt_dev.campaign import hands as campaign_hands
from teleop_rt_dev.hands import same_hand, stranger
from teleop_rt_dev.hands.ideal import IdealWall, ideal_motion
from teleop_rt_dev.hands.oscillation import longest_oscillation, rows_of

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


def strangers_trial(tremor_N=0.0, tremor_hz=8.0):
    """A trial.yaml as the stranger's judge reads it: a loose hand on a wall of 3 kN/m."""
    trial = trial_of(2)
    plain = campaign_hands.dump(trial, trial.rig.units)
    plain["operator"]["hand"] |= {"tremor_N": tremor_N, "tremor_hz": tremor_hz}
    plain["operator"]["hand"] |= {"let_go_s": None, "grip_change": 0.0, "stiffness_N_per_m": 200.0}
    plain["operator"]["hand"] |= {"mass_N_s2_per_m": 0.3, "damping_N_s_per_m": 3.0}
    plain["plant"]["environment"] |= {"stiffness_N_per_m": 3000.0, "damping_N_s_per_m": 0.0}
    plain["plant"] |= {"undeclared": []}
    return plain


def test_the_stranger_finds_what_the_hand_does_not_do_by_itself():
    t = np.arange(3000) * T
    wave = np.sin(2 * np.pi * 8 * t)
    assert stranger.judge(strangers_trial(), 1e-3 * wave, 3.0 * wave)
    assert not stranger.judge(strangers_trial(), 1e-3 * wave, 0.2 * wave)
    assert not stranger.judge(strangers_trial(), 0.05e-3 * wave, 3.0 * wave)
    decays = np.exp(-3 * t) * wave
    assert not stranger.judge(strangers_trial(), 1e-3 * decays, 3.0 * decays)


def test_the_stranger_leaves_a_trembling_hand_its_own_swings():
    trial = strangers_trial(tremor_N=1.5)
    body = stranger.Body.of_plant(trial["plant"])
    own = stranger.against(body, trial, 3000, T, chance=100)
    assert own
    t = np.arange(3000) * T
    worst = max(own, key=lambda row: row.swings)
    wave = np.sin(2 * np.pi * worst.hz * t)
    motion, force = 0.5 * worst.size_m * wave, 0.5 * worst.size_m * worst.stiffness * wave
    assert not stranger.judge(trial, motion, force)
    larger = 5 * max(row.size_m for row in own) / worst.size_m
    assert stranger.judge(trial, larger * motion, larger * force)


def test_the_stranger_reads_hidden_effects_with_and_without_units():
    plant = strangers_trial()["plant"]
    short = {"effect": "second_layer", "stiffness": 5000.0, "depth": 0.004}
    long = {"effect": "second_layer", "stiffness_N_per_m": 5000.0, "depth_m": 0.004}
    for layer in (short, long):
        body = stranger.Body.of_plant(plant | {"undeclared": [layer]})
        wall = body.numbers
        force = stranger.wall_force(wall, wall[0] + 0.006, 0.0, 0.0)
        assert force == pytest.approx(3000 * 0.006 + 5000 * 0.002)


def test_the_stranger_shares_no_code_with_the_project():
    text = Path(stranger.__file__).read_text(encoding="utf-8")
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


def rendered_path(surfaces):
    """A path of a wall of 3 kN/m at these places, a tick each; the leash holds nobody."""
    path = same_hand.Rendered()
    for surface in surfaces:
        wall = Wall(float(surface), 3000.0, 5.0)
        path.ticks.append(same_hand.TickWalls(wall, wall, 1.0, 0.0, np.inf))
    return path


@pytest.mark.parametrize(
    ("wall", "felt"),
    [
        (Wall(0.0, 3000.0, 10.0), 10.0),  # within the bound: its own damping
        (Wall(0.0, 3000.0, 10.0, calming=0.4), 0.0),
        (Wall(0.0, 3000.0, 0.0, calming=10.0), 0.0),
        (Wall(0.0, 3000.0, 10.0, damping_power=1.0, calming=0.4), 10.0),  # beside the calming
    ],
)
def test_the_same_hand_feels_no_damping_that_makes_up_for_a_latency(wall, felt):
    """A linear wall beyond the bound is given what it lacks of that, so none of its own is felt."""
    kept = same_hand.Rendered()._calm(wall)
    assert (kept.b, kept.calming) == (felt, 0.0)
    assert kept.k == wall.k


@pytest.mark.parametrize("judge", [rows_of, same_hand.strangers_rows])
@pytest.mark.parametrize(
    ("tremor_N", "swing_m", "own"), [(1.5, 0.0, True), (0.0, 1e-3, False), (0.3, 1e-3, False)]
)
def test_swings_are_the_hands_own_where_the_same_hand_makes_them_on_a_wall_that_stays(
    tremor_N, swing_m, own, judge
):
    """A trembling hand at a wall, or a wall that is moved under a hand by 1 mm at 6 Hz."""
    hand = [
        "operator.hand.mass_N_s2_per_m=0.5", "operator.hand.stiffness_N_per_m=800",
        "operator.hand.damping_N_s_per_m=5", f"operator.hand.tremor_N={tremor_N}",
        "operator.hand.tremor_hz=6", "operator.hand.intention.frequency_hz=0.5", "duration_s=2.5",
        "seed=2",
    ]  # fmt: skip
    trial = campaign_hands.load_trial_file(campaign_hands.TRIAL, hand)
    t = np.arange(2500) * T
    path = rendered_path(0.005 + swing_m * np.sin(2 * np.pi * 6.0 * t) * (t > 1.0))
    never = 1e9
    position, motor = ideal_motion(
        trial, same_hand.StaysAsItWas(trial, path, never, never, with_body=False)
    )
    rows = same_hand.whole(judge(position, motor, T))
    rows = [row for row in rows if row.swings >= campaign_hands.SUSTAINED]
    assert rows
    left = [row for row in rows if not same_hand.is_own(row, judge, trial, path, position, motor)]
    assert bool(left) is not own


class MovesAsItLikes:
    """A wall of 3 kN/m that comes nearer by `pushes_m` as a hand in it turns round.

    It goes back when the hand is out of it; `path` has its place at each tick.
    """

    def __init__(self, pushes_m):
        self.pushes_m, self.surface, self.path = pushes_m, 0.005, []

    def force(self, x, v, t_s):
        if x < 0.005 - self.pushes_m:
            self.surface = 0.005
        elif x > 0.005 and v < 0.0:
            self.surface = 0.005 - self.pushes_m
        if len(self.path) <= t_s / T:
            self.path.append(self.surface)
        return Wall(self.surface, 3000.0).force(x, v)


@pytest.mark.parametrize("judge", [rows_of, same_hand.strangers_rows])
def test_a_wall_that_pushes_a_hand_out_and_goes_back_unfelt_is_found(judge):
    """It works on the hand at each touch: what it does while nobody feels it is no excuse."""
    hand = [
        "operator.hand.mass_N_s2_per_m=1.5", "operator.hand.stiffness_N_per_m=300",
        "operator.hand.damping_N_s_per_m=2", "operator.hand.tremor_N=0",
        "operator.hand.intention.frequency_hz=0.5", "operator.hand.intention.mean_m=0.008",
        "operator.hand.intention.amplitude_m=0.001", "duration_s=2.5",
    ]  # fmt: skip
    trial = campaign_hands.load_trial_file(campaign_hands.TRIAL, hand)
    wall = MovesAsItLikes(1e-3)
    position, motor = ideal_motion(trial, wall)
    path = rendered_path(wall.path)
    rows = same_hand.whole(judge(position, motor, T))
    rows = [row for row in rows if row.swings >= campaign_hands.SUSTAINED]
    worst = max(rows, key=lambda row: row.swings)
    assert not same_hand.is_own(worst, judge, trial, path, position, motor)


@pytest.mark.parametrize(
    ("share", "hz", "begins_s", "lasts_s", "own"),
    [
        (0.9, 6.0, 1.0, 1.0, True),
        (0.5, 6.0, 1.0, 1.0, False),
        (0.9, 12.0, 1.0, 1.0, False),
        (0.9, 6.0, 2.5, 1.0, False),
        (0.9, 6.0, 1.0, 0.5, False),
        (0.9, 6.0, 1.0, 0.8, True),
    ],
    ids=["alike", "smaller", "faster", "later", "shorter", "shorter by less than a row"],
)
def test_a_row_of_the_hands_in_another_phase_counts_where_it_is_alike(
    monkeypatch, share, hz, begins_s, lasts_s, own
):
    def swings(size, hz, begins_s, lasts_s, phase=0.0):
        t = np.arange(4000) * T
        there = (t >= begins_s) & (t < begins_s + lasts_s)
        return 0.5 * size * np.sin(2 * np.pi * hz * (t - begins_s) + phase) * there

    def ideal(*_):
        made = swings(share * 1e-3, hz, begins_s, lasts_s, 1.5)
        return made, 3000.0 * made

    monkeypatch.setattr(same_hand, "ideal_motion", ideal)
    position = swings(1e-3, 6.0, 1.0, 1.0)
    seen = position, 3000.0 * position
    row = max(rows_of(*seen, T), key=lambda row: row.swings)
    assert row.swings >= campaign_hands.SUSTAINED
    path = rendered_path(np.full(4000, 0.005))
    assert same_hand.is_own(row, rows_of, trial_of(2), path, *seen) is own
