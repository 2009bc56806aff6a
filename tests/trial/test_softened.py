"""A wall that is rendered softer than it is: the tool presses harder than the hand feels."""

import numpy as np
import pytest

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.config.section import Units
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.softened import calmed, softened, unfollowed
from teleop_rt.trial.summary import summarise
from teleop_rt.trial.unfelt import most_unfelt
from teleop_rt_dev.paths import TRIALS
from teleop_rt_dev.trial.files import silicone
from teleop_rt_drivers.simulated.reference import environment_force

UNITS = Units(position="m", force="N")
UNFELT = {"pressed": 71.4, "felt": 10.0, "share": 0.14, "at_s": 7.6}


WHOLE = {"true": 20.0, "rendered": 20.0}
CALMED = {"true": 200.53, "rendered": 21.98}


def master(rendered, unfelt=UNFELT, damping=WHOLE):
    passivity = {"stiffness": {"true": 50_087.0, "rendered": rendered}, "damping": damping}
    return {"rendering": {"passivity": passivity}, "unfelt": unfelt}


def test_a_softened_wall_is_said_with_the_force_that_was_not_felt():
    assert softened(master(6517.0), UNITS) == (
        "at 7.6 s the tool pressed with 71.4 N and the hand felt 10 N, 14% of it; this device can "
        "render at most 6520 N/m of the wall's 50100 N/m, its damping included: a stiffer wall "
        "would not be passive on it"
    )
    assert softened(master(6517.0, None), UNITS).startswith("this device can render at most 6520 ")


@pytest.mark.parametrize("rendered", [0.0, 50_087.0])
def test_of_a_wall_rendered_whole_or_not_at_all_nothing_is_said(rendered):
    assert softened(master(rendered), UNITS) is None
    assert softened({"rendering": None}, UNITS) is None


def test_a_force_that_comes_back_a_round_trip_late_is_compared_with_the_one_felt_before():
    """150 ms late, the slave's peaks meet the hand's troughs."""
    trial, ticks = silicone(), np.arange(9000)
    wave = 20.0 + 15.0 * np.sin(ticks / 50.0)
    columns = {
        "stamp_ns": 1e6 * ticks,
        "contact_id": (ticks > 500).astype(float),
        "velocity": 0.0 * ticks,
        "surface": np.full(ticks.size, 0.014),
        "rendered_force": wave,
        "reflected_force": np.roll(wave, 150),
    }
    assert (found := most_unfelt(trial, {}, columns)) is not None
    assert found["pressed"] - found["felt"] <= 0.0
    columns["rendered_force"] = wave.copy()
    columns["rendered_force"][6000:6500] = 5.0
    assert (found := most_unfelt(trial, {}, columns)) is not None
    assert found["felt"] == 5.0
    assert found["pressed"] == pytest.approx(35.0, abs=0.1)
    assert found["share"] == pytest.approx(5.0 / 35.0, rel=0.01)
    assert 6.2 <= found["at_s"] < 6.65
    assert most_unfelt(trial, {}, {key: values[:400] for key, values in columns.items()}) is None
    assert most_unfelt(trial, {}, columns | {"reflected_force": 0.0 * wave}) is None


def moment(*, true, tool, rendered=10_000.0, size=1.0, damping=(0.0, 0.0)):
    """Return the worst of a contact in which the tool presses with 30 N and the hand feels 10.

    Both times `size`.
    """
    trial, ticks = silicone(), np.arange(9000.0)
    pressing = ticks == 6000
    row = np.ones(ticks.size)
    master = {
        "stamp_ns": 1e6 * ticks,
        "contact_id": row,
        "velocity": 0.0 * row,
        "rendered_force": np.where(ticks == 5900, 10.0 * size, 0.0),
        "reflected_force": 30.0 * size * pressing,
        "surface": 0.014 * row,
        "true_stiffness": true * row,
        "rendered_stiffness": min(true, rendered) * row,
        "true_damping": damping[0] * row,
        "rendered_damping": damping[1] * row,
    }
    slave = {
        "stamp_ns": 1e6 * ticks,
        "valid": row,
        "sample_stamp_ns": 1e6 * ticks,
        "position": np.clip(tool + 1e-4 * (ticks - 5925), 0.0, tool),  # 0.1 m/s, then at rest
        "force": np.where(ticks == 5925, 30.0 * size, 0.0),
    }
    found = most_unfelt(trial, slave, master)
    assert found is not None
    return {
        "unfelt": found,
        "rendering": {"passivity": {"stiffness": {"true": 2e4, "rendered": 1e4}}},
    }


@pytest.mark.parametrize(
    ("true", "tool", "cause"),
    [
        (30_000.0, 0.0150, "bound"),  # unbounded, 30 N at 1 mm
        (30_000.0, 0.0146, "model"),  # unbounded, 18 N
        (30_000.0, 0.0138, "model"),  # before the surface
        (8_000.0, 0.0180, "other"),  # 32 N of a wall that is within the bound
    ],
)
def test_a_force_is_missing_for_the_bound_only_where_the_unbounded_wall_had_given_it(
    true, tool, cause
):
    said = moment(true=true, tool=tool)
    assert said["unfelt"]["cause"] == cause
    assert ("33% of it" in softened(said, UNITS)) is (cause == "bound")
    assert ("hand felt 10 N, 33% of it" in (unfollowed(said, UNITS) or "")) is (cause == "model")


def test_damping_that_is_not_passive_is_said_as_stiffness_is():
    """Of 200 N s/m 22 were rendered, and no line said so."""
    said = (
        "this device can render at most 22 N s/m of the wall's damping of 201 N s/m: with more, "
        "beside its stiffness, the wall would not be passive on it"
    )
    share = "at 7.6 s the tool pressed with 71.4 N and the hand felt 10 N, 14% of it; "
    assert calmed(master(50_087.0, damping=CALMED), UNITS) == share + said
    assert calmed(master(6517.0, damping=CALMED), UNITS) == said
    assert calmed(master(6517.0), UNITS) is None
    assert calmed(master(0.0, damping=CALMED), UNITS) is None


def test_a_force_that_the_rendered_damping_lacked_is_for_the_bound():
    """At 0.1 m/s 200 N s/m give 20 N: beside 8 N of the spring a model that followed the body."""
    found = moment(true=8000.0, tool=0.015, damping=(200.0, 22.0))["unfelt"]
    assert (found["cause"], found["modelled"]) == ("bound", pytest.approx(28.0))
    assert moment(true=8000.0, tool=0.015, damping=(22.0, 22.0))["unfelt"]["cause"] == "model"


def test_noise_before_a_rendered_surface_is_no_body_that_was_not_followed():
    """0.2 N of noise in free air, where nothing was felt, named a surface that had not moved."""
    assert unfollowed(moment(true=8000.0, tool=0.0138), UNITS) is not None
    assert unfollowed(moment(true=8000.0, tool=0.0138, size=0.01), UNITS) is None


def test_a_surface_that_moves_faster_than_it_is_tracked_is_named_and_not_the_bound(tmp_path):
    """The surface moves by 3 mm once a second: a tool pressed 0.7 mm before it as rendered."""
    motion = "{effect: moving_surface, swing_m: 0.003, swing_hz: 1.0, velocity_m_per_s: 0.0001}"
    changes = [
        "duration_s=10.2", "contact.surface_tracking_hz=1",
        "operator.mean_m=0.004", "operator.amplitude_m=0.003",
        "plant.environment.stiffness_N_per_m=12000", f"plant.undeclared=[{motion}]",
    ]  # fmt: skip
    file = TRIALS / "breathing_tissue.yaml"
    trial = load_trial_file(file, changes)
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, file, open_bench, tmp_path, lambda _: None)
    master = summarise(tmp_path, trial, outcome, environment_force)["master"]
    assert master["rendering"]["passivity"]["reduced"]
    assert "hand felt" not in softened(master, UNITS)
    said = unfollowed(master, UNITS)
    assert "before the rendered surface" in said
    assert said.endswith("contact.surface_tracking_hz 1 did not follow it")
