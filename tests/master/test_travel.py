"""The ends of the device's travel: the hand is held in front of them, and leads nobody there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.master.travel import TravelEnds
from teleop_rt.realtime.reading import read_topics
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt_dev.faults.handle import CANOPEN

T = 1e-3


def ends() -> TravelEnds:
    """A travel of 400 mm, so margins of 20 mm, and a brake of 40 N."""
    return TravelEnds((-0.2, 0.2), 40.0, (5000.0, 0.0), T)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_moves_on_near_an_end_is_withheld_and_what_turns_back_is_not(way):
    travel, led = ends(), 0.0
    path = [0.0, 0.1, 0.17, 0.185, 0.19, 0.186, 0.188, 0.17, 0.1]
    for before, hand in zip([0.0, *path], path, strict=False):
        led += way * (hand - before) - travel.withhold(way * hand, touches=False)
    assert led == pytest.approx(way * (0.1 - (0.005 + 0.005 + 0.002)))
    assert travel.withheld == pytest.approx(0.012)


def test_in_contact_nothing_is_withheld_and_no_brake_is_added():
    travel = ends()
    travel.withhold(0.17, touches=True)
    assert travel.withhold(0.19, touches=True) == 0.0
    assert travel.brake(0.195, 0.0, touches=True) == 0.0


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_brake_grows_over_the_last_of_the_travel_and_never_pushes_back(way):
    travel = ends()
    forces = [way * travel.brake(way * x, 0.0, touches=False) for x in np.arange(0.0, 0.2, 1e-4)]
    assert max(forces[:1795]) == 0.0
    assert forces[1900] == pytest.approx(20.0, rel=0.05)
    assert forces[-1] == pytest.approx(40.0, rel=0.05)
    assert way * travel.brake(way * 0.15, 0.0, touches=False) == 0.0


def test_an_ideal_device_has_no_ends():
    travel = TravelEnds((-math.inf, math.inf), 40.0, (5000.0, 0.0), T)
    assert travel.withhold(5.0, touches=False) == 0.0
    assert travel.withhold(50.0, touches=False) == 0.0


def test_a_hand_that_walks_to_the_end_stops_before_it_and_the_slave_gets_nothing_beyond(tmp_path):
    """The wall lies beyond the handle's travel; the hand would walk into the end stop."""
    trial = load_trial_file(
        CANOPEN,
        [
            "operator.rig.limits.position_min_m=-0.04",
            "operator.rig.limits.position_max_m=0.04",
            "operator.hand.intention.approach_speed_m_per_s=0.02",
            "operator.hand.stiffness_N_per_m=300",
            "plant.environment.surface_m=0.055",
            "link.round_trip_ms=0",
            "link.jitter_ms=0",
            "duration_s=4",
        ],
    )
    outcome = run_lockstep(trial, CANOPEN, open_bench, tmp_path, lambda _: None)
    rendering = outcome["rendering"]
    assert rendering["handle"]["fault"]["name"] == "none"
    assert rendering["handle"]["withheld_at_ends"] > 0.0
    master = read_topics(tmp_path / "recording.mcap", ["/master"])["/master"]
    assert master["position"].max() > 0.036
    assert master["target"].max() == pytest.approx(0.036, abs=1e-5)
    assert master["rendered_force"].max() > 5.0
