"""Ordinary hands on the shipped handle: cases that shook, pushed or misled once, in lock-step."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.realtime.ring_folder import new_ring_folder
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import LockstepTrial, run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_dev.hands.oscillation import longest_oscillation
from teleop_rt_dev.paths import TRIALS
from teleop_rt_drivers.simulated.reference import environment_force

NO_DELAY = ("link.round_trip_ms=0", "link.jitter_ms=0", "link.loss=0")
TWO_SECONDS = ("link.round_trip_ms=2000", "link.jitter_ms=0", "link.loss=0.1")


def hand(mass, stiffness, damping):
    """Overrides for a hand that intends 4 mm +- 2 mm at 1.3 Hz."""
    inner = "operator.hand"
    return (
        f"{inner}.mass_N_s2_per_m={mass}",
        f"{inner}.stiffness_N_per_m={stiffness}",
        f"{inner}.damping_N_s_per_m={damping}",
        f"{inner}.intention.frequency_hz=1.3",
        f"{inner}.intention.mean_m=0.004",
        f"{inner}.intention.amplitude_m=0.002",
    )


def wall(stiffness):
    """Override for an environment."""
    return (f"plant.environment.stiffness_N_per_m={stiffness}",)


class Run:
    """A trial in lock-step: position and force of every tick, and the state at the end."""

    def __init__(self, changes, seconds, trial="handle.yaml"):
        file = TRIALS / trial
        self.trial = load_trial_file(file, [f"duration_s={seconds}", *changes])
        rows = []
        with new_ring_folder() as ring_folder:
            run = LockstepTrial(self.trial, file.parent, open_bench, ring_folder)
            run.slave.configure()
            self.master, self.slave = run.master.master, run.slave
            for _ in range(round(seconds * 1000)):
                run.step()
                master, pipeline = self.master, run.slave._pipeline
                estimated = pipeline.estimate(0)[1][0] if pipeline.selected == 0 else np.nan
                streamed = np.nan if master.intake.model is None else master.intake.model.k
                rows.append((master.position, master.force, estimated, streamed))
            self.truth = run.bench.truth()
            run.bench.axis.stop()
            run.master.let_go()
        self.position, self.force, self.estimated, self.streamed = np.array(rows).T

    @property
    def swings(self):
        return longest_oscillation(self.position, self.force, 1e-3)[0]


@pytest.mark.parametrize(
    ("holding", "environment", "link", "seconds"),
    [
        (hand(0.3, 200, 3), wall(3600), NO_DELAY, 3.5),
        (hand(0.3, 300, 5), wall(15_000), NO_DELAY, 3.5),
        *cases(
            (hand(1.0, 400, 15), wall(40_000), TWO_SECONDS, 12),
            (hand(1.0, 400, 15), wall(15_000), TWO_SECONDS, 12),
        ),
    ],
)
def test_a_loose_hand_on_any_wall_is_not_shaken(holding, environment, link, seconds):
    run = Run((*holding, *environment, *link), seconds)
    assert run.master.adoption.newest.k > 0.0, "the wall is known"
    assert run.swings < 5
    assert run.force.max() < 40
    assert run.slave.safety.fault.name == "none"
    assert run.master.fault.name == "none"
    assert run.master.shaking.softenings == 0
    assert run.truth["handle"]["energy_min_J"] > -0.05


@pytest.mark.parametrize(("round_trip_ms", "seconds"), [(0, 5), (2000, 16)])
def test_the_cube_is_felt_within_a_millisecond_and_half_a_percent_by_a_firm_hand(
    round_trip_ms, seconds, tmp_path
):
    """It was late by 4.6 ms and wrong by 1 %: of 20 N s/m only 3.2 were rendered."""
    changes = [
        f"duration_s={seconds}",
        f"link.round_trip_ms={round_trip_ms}",
        "link.jitter_ms=0",
        "link.loss=0",
    ]
    trial = load_trial_file(TRIALS / "handle.yaml", changes)
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, TRIALS / "handle.yaml", open_bench, tmp_path, lambda _: None)
    felt = summarise(tmp_path, trial, outcome, environment_force)["master"]
    passivity = felt["rendering"]["passivity"]
    assert passivity["reduced"] is False
    assert passivity["damping"]["rendered"] == pytest.approx(20.0, rel=0.01)
    assert abs(felt["lag_ms"]) <= 1.0
    assert felt["nrmse"] <= 0.005


@pytest.mark.parametrize(("damping", "latency_ms"), [(0.3, 0.05), (8.0, 1.5), (8.0, 2.0)])
def test_a_device_that_is_not_what_it_says_is_brought_to_rest(damping, latency_ms):
    """A twentieth of the damping that its rig says, or up to 2 ms more of latency.

    Five swings are an oscillation, which ends within two more.
    """
    body = f"mass_N_s2_per_m: 0.2, damping_N_s_per_m: {damping}, force_latency_ms: {latency_ms}"
    lie = f"operator.plant={{{body}, end_stop_min_m: -0.21, end_stop_max_m: 0.21}}"
    run = Run((*hand(0.3, 200, 0.5), *wall(15_000), *NO_DELAY, lie), 1.7)
    assert run.master.shaking.boundings == 1
    assert run.swings <= 5 + 2
    assert np.ptp(run.position[900:]) < 0.5e-3
    assert run.master.shaking.softenings == 0, "bounding is enough"


def test_the_first_touch_is_awaited_on_a_leash():
    """Two seconds away the hand led by 330 mm."""
    run = Run((*hand(1.0, 400, 15), *TWO_SECONDS), 4)
    assert run.position.max() < 0.11  # half before the slave follows, half until the touch is known
    assert run.master.leash.longest < 0.05


@pytest.mark.parametrize(("round_trip_ms", "seconds"), [(400, 4.5), (2000, 12.0)])
def test_a_model_is_replaced_within_a_round_trip_of_what_the_slave_estimates(
    round_trip_ms, seconds
):
    """70 kN/m were kept once, with estimates of 14 999 +- 4 N/m at the other end."""
    link = (f"link.round_trip_ms={round_trip_ms}", "link.jitter_ms=0", "link.loss=0.1")
    run = Run((*wall(15_000), *link), seconds)
    known = np.flatnonzero(np.isfinite(run.streamed) & np.isfinite(run.estimated))
    known = known[known > known[0] + round_trip_ms]
    assert known.size > 1000
    for tick in known[::10]:
        lately = run.estimated[tick - round_trip_ms : tick + 1]
        assert 0.97 * np.nanmin(lately) <= run.streamed[tick] <= 1.03 * np.nanmax(lately), tick
    assert run.streamed[-1] == pytest.approx(15_000, rel=0.01)
