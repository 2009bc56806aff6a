"""The same hand at a wall that stays as it was: which swings are its own, by either judge."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from teleop_rt.master.walls import Wall
from teleop_rt_dev.campaign import hands as campaign_hands
from teleop_rt_dev.hands import same_hand
from teleop_rt_dev.hands.ideal import ideal_motion
from teleop_rt_dev.hands.oscillation import rows_of

T = 1e-3


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
    """A linear wall beyond the bound gets the damping that it lacks, so none is felt."""
    kept = same_hand.Rendered()._calm(wall)
    assert (kept.b, kept.calming) == (felt, 0.0)
    assert kept.k == wall.k


@functools.cache
def seen(tremor_N, swing_m):
    """Return the trial of a hand, the path of its wall, and its motion and force there."""
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
    wall = same_hand.StaysAsItWas(trial, path, never, never, with_body=False)
    return trial, path, *ideal_motion(trial, wall)


@pytest.mark.parametrize("judge", [rows_of, same_hand.second_judges_rows])
@pytest.mark.parametrize(
    ("tremor_N", "swing_m", "own"), [(1.5, 0.0, True), (0.0, 1e-3, False), (0.3, 1e-3, False)]
)
def test_swings_are_the_hands_own_where_the_same_hand_makes_them_on_a_wall_that_stays(
    tremor_N, swing_m, own, judge
):
    """A trembling hand at a wall, or a wall that is moved under a hand by 1 mm at 6 Hz."""
    trial, path, position, motor = seen(tremor_N, swing_m)
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


@functools.cache
def pushed_out():
    """Return the trial of a hand, the path of a wall that pushes it out, its motion and force."""
    hand = [
        "operator.hand.mass_N_s2_per_m=1.5", "operator.hand.stiffness_N_per_m=300",
        "operator.hand.damping_N_s_per_m=2", "operator.hand.tremor_N=0",
        "operator.hand.intention.frequency_hz=0.5", "operator.hand.intention.mean_m=0.008",
        "operator.hand.intention.amplitude_m=0.001", "duration_s=2.5",
    ]  # fmt: skip
    trial = campaign_hands.load_trial_file(campaign_hands.TRIAL, hand)
    wall = MovesAsItLikes(1e-3)
    motion = ideal_motion(trial, wall)
    return trial, rendered_path(wall.path), *motion


@pytest.mark.parametrize("judge", [rows_of, same_hand.second_judges_rows])
def test_a_wall_that_pushes_a_hand_out_and_goes_back_unfelt_is_found(judge):
    """It works on the hand at each touch: its moves while nobody feels it are no excuse."""
    trial, path, position, motor = pushed_out()
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
    trial = campaign_hands.load_trial_file(
        campaign_hands.TRIAL, campaign_hands.draw(2, 5.0).changes
    )
    assert same_hand.is_own(row, rows_of, trial, path, *seen) is own
