"""A tool that chatters on a body is a note of the summary; a hand that shakes is none."""

import numpy as np
import pytest

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.realtime.reading import read_topics
from teleop_rt.trial.chatter import chatter, chatter_note
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_dev.paths import TRIALS
from teleop_rt_dev.trial.files import silicone
from teleop_rt_drivers.simulated.reference import environment_force

HANDLE = TRIALS / "handle.yaml"
RECEDING = (
    "plant.environment.stiffness_N_per_m=20000",
    "plant.undeclared=[{effect: moving_surface, velocity_m_per_s: 0.002}]",
    "operator.hand.intention.frequency_hz=0.5",
    "operator.hand.intention.mean_m=0.006",
    "operator.hand.intention.amplitude_m=0.004",
    "operator.hand.intention.lift_off_every_s=100",
)


@pytest.mark.parametrize("tracking_hz", [0, 3])
def test_a_stiff_wall_that_recedes_untracked_is_left_42_times_a_second(tmp_path, tracking_hz):
    changes = ["duration_s=4.4", f"contact.surface_tracking_hz={tracking_hz}", *RECEDING]
    trial = load_trial_file(HANDLE, changes)
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, HANDLE, open_bench, tmp_path, lambda _: None)
    slave = read_topics(tmp_path / "recording.mcap", ["/slave"])["/slave"]
    found = chatter(trial, slave)
    if tracking_hz:
        assert found is None
        return
    assert found is not None
    assert 40.0 < found.frequency_hz < 46.0
    assert found.left_hz == pytest.approx(found.frequency_hz, rel=0.05)
    assert 35.0 < found.swing < 45.0
    notes = summarise(tmp_path, trial, outcome, environment_force)["notes"]
    (note,) = (one for one in notes if one.startswith("the tool chattered on the body at 42 Hz"))
    assert note.endswith("if the surface moves, set contact.surface_tracking_hz")


def shaken(hz, *, swing=0.5e-3, stiffness=8000.0, cycles=20):
    """Return a slave's columns: a tool that shakes half inside of a wall, and rests before."""
    rate_hz = silicone().rig.rate_hz
    ticks = np.arange(round(2 * rate_hz + cycles * rate_hz / hz))
    x = 0.5 * swing * np.sin(2 * np.pi * hz * np.maximum(0.0, ticks / rate_hz - 2.0))
    return {
        "stamp_ns": 1e9 / rate_hz * ticks,
        "valid": np.ones(ticks.size),
        "position": x,
        "force": stiffness * np.maximum(0.0, x),
        "in_contact": (x > 0.1e-3).astype(float),
    }


def test_its_figures_are_those_of_the_motion():
    found = chatter(silicone(), shaken(50.0))
    assert found is not None
    assert found.began_s == pytest.approx(2.005, abs=2e-3)
    assert found.lasted_s == pytest.approx(19 / 50, abs=2e-3)
    assert found.frequency_hz == pytest.approx(50.0, rel=0.01)
    assert found.left_hz == pytest.approx(50.0, rel=0.06)
    assert found.swing == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize(
    "columns",
    [
        shaken(12.0),  # a hand's tremor
        shaken(50.0, swing=0.15e-3),  # a swing that counts for no handle
        shaken(50.0, stiffness=500.0),  # a force below the onset of a contact
        shaken(50.0, cycles=4),  # a bounce that dies out
        shaken(200.0),  # noise of the encoder
        shaken(50.0) | {"in_contact": 0.0 * shaken(50.0)["position"]},  # a drive in free air
        {},
    ],
    ids=["tremor", "small", "weak", "bounce", "noise", "free", "nothing"],
)
def test_nothing_else_that_shakes_is_a_chatter(columns):
    assert chatter_note(silicone(), columns) == []


def test_where_the_surface_is_tracked_already_the_next_step_is_another():
    trial = load_trial_file(TRIALS / "breathing_tissue.yaml", [])
    (note,) = chatter_note(trial, shaken(50.0))
    assert note.endswith("a shorter round trip, or raise slave.force_cap if the body bears it")
