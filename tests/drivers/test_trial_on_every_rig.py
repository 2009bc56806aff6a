"""The default trial gives the same answer on every bus, by naming another rig file."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from framed_bench import RIGS
from lean_install import without_report
from machine_witness import undisturbed

from teleop_rt.config.loader import load_trial
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.ring_folder import publish
from teleop_rt.signals import TRUTH
from teleop_rt.trial.bench import Bench
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_drivers import opening, registry
from teleop_rt_drivers.rig_text import rig_text
from teleop_rt_drivers.simulated.reference import environment_force

TRIAL = Path(RIGS).parent / "trials" / "silicone_cube.yaml"


def open_bench(trial, now_ns):
    axis, rig = opening.open_lock_step(trial.rig, trial.plant, now_ns, trial.seed)

    def publish_truth(ring_folder):
        ring = publish(ring_folder, "/truth/plant", TRUTH)
        rig.on_truth = ring.push

    return Bench(axis, rig.truth, publish_truth)


def kelvin_voigt(summary):
    (row,) = (row for row in summary["estimators"] if row["model"] == "kelvin-voigt")
    return row["parameters"]["k"]["value"], row["parameters"]["b"]["value"]


NO_ZEROS = [
    "plant.sensors.encoder_zero_m=-0.0213",
    "plant.drive.zero_m=0.0087",
    "plant.sensors.force_offset_N=3.2",
]


TORQUE = [
    "rig.axis.drive.torque.rated_force_N=200.0",
    "rig.axis.drive.torque.stiffness_N_per_m=31600.0",
    "rig.axis.drive.torque.damping_N_s_per_m=503.0",
]
CHANGES = {"unreferenced": NO_ZEROS, "torque": TORQUE}


RIGS_RUN = ("canopen", "canopen_input", "serial", "raw_can", "mixed", "unreferenced")


def summary_in_lockstep(trial, folder):
    """Return the summary of a trial run on simulated time, recorded in a folder."""
    write_trial(folder, trial)
    outcome = run_lockstep(trial, TRIAL, open_bench, folder, lambda _: None)
    return summarise(folder, trial, outcome, environment_force)


def test_the_default_trial_finds_the_cube_by_a_load_cell_of_80_samples_a_second(tmp_path):
    rig = "rig=../rigs/simulated_load_cell.yaml"
    trial = load_trial(
        TRIAL, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, [rig, "duration_s=9", "seed=3"]
    )
    summary = summary_in_lockstep(trial, tmp_path)
    k, b = kelvin_voigt(summary)
    assert k == pytest.approx(3600, rel=0.03)
    # A lag that is off by 1 ms is 3.6 N s/m.
    assert b == pytest.approx(20, abs=3)
    # Half a millimetre is promised; stamps of position and force exchanged make 0.3 mm.
    assert summary["contact"]["surface_found"] == pytest.approx(0.0137, abs=0.1e-3)
    assert summary["safety"]["fault"]["name"] == "none"
    assert summary["safety"]["holds"] == 0


@pytest.mark.parametrize("drive", ["odrive", "robstride"])
def test_the_default_trial_finds_the_cube_by_a_maker_s_motor_alone(drive, tmp_path):
    """The torque of a drive that has let go is not the force of contact, which lasts on."""
    rig = tmp_path / "rig.yaml"
    rig.write_text(rig_text(drive, "unix", "drive", None))
    noise = ("contact.onset_force_N=2", "contact.release_force_N=1", "operator.felt_force_N=2")
    options = [f"rig={rig}", "duration_s=6", "seed=1", *noise]
    trial = load_trial(TRIAL, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, options)
    summary = summary_in_lockstep(trial, tmp_path)
    k, b = kelvin_voigt(summary)
    assert k == pytest.approx(3600, rel=0.03)
    assert b == pytest.approx(20, abs=1.0)
    assert summary["contact"]["surface_found"] == pytest.approx(0.0137, abs=0.2e-3)
    assert summary["contact"]["onsets"] == touches_felt(tmp_path, 2.0 / 3600.0)
    assert summary["safety"]["fault"]["name"] == "none"


def touches_felt(folder, depth):
    """Return how often the plant's tool went deeper into the cube than `depth` [m]."""
    truth = read_topics(folder / "recording.mcap", ["/truth/plant"])["/truth/plant"]
    inside = truth["position"] > 0.0137
    starts = np.flatnonzero(np.diff(inside.astype(int)) > 0) + 1
    ends = np.append(starts[1:], inside.size)
    deepest = [truth["position"][a:b].max() for a, b in zip(starts, ends, strict=True)]
    return sum(one > 0.0137 + depth for one in deepest)


@pytest.mark.parametrize("kind", [*RIGS_RUN, "torque"])
def test_the_default_trial_finds_the_cube_on_simulated_time(kind, tmp_path):
    rig = "canopen" if kind == "torque" else kind
    duration_s = 6.5 if kind == "unreferenced" else 3.5
    trial = load_trial(
        TRIAL,
        registry.AXIS_SCHEMAS,
        registry.PLANT_SCHEMAS,
        [f"rig=../rigs/simulated_{rig}.yaml", f"duration_s={duration_s}", *CHANGES.get(kind, [])],
    )
    summary = summary_in_lockstep(trial, tmp_path)
    k, b = kelvin_voigt(summary)
    assert k == pytest.approx(3600, rel=0.01)
    assert b == pytest.approx(20, rel=0.05)
    assert summary["contact"]["surface_found"] == pytest.approx(0.0137, abs=0.2e-3)
    assert summary["safety"]["fault"]["name"] == "none"
    assert summary["safety"]["samples_rejected"] == 0


@pytest.mark.realtime
@pytest.mark.parametrize("kind", ["serial", "raw_can", "mixed"])
def test_the_default_trial_finds_the_cube_as_processes(kind, tmp_path):
    def attempt(folder):
        done = subprocess.run(
            [sys.executable, "-m", "teleop_rt", "run", str(TRIAL), "--json", "--duration", "4",
             "--set", f"rig=../rigs/simulated_{kind}.yaml", "--set", "rig.rate_hz=500",
             "--out", str(folder)],
            env=without_report(tmp_path), capture_output=True, text=True, check=False,
        )  # fmt: skip
        summary = json.loads(done.stdout)
        if done.returncode != 0:
            fault = summary["safety"]["fault"]["name"]
            assert fault in {"late_ticks", "samples_lost", "device_lost"}
            return None
        return summary

    k, b = kelvin_voigt(undisturbed(tmp_path, 500, attempt))
    assert k == pytest.approx(3600, rel=0.02)
    # Streaming sensors are not in step with each other: up to 1 ms, k * 1 ms in damping.
    assert b == pytest.approx(20, abs=4.5)


def test_every_example_in_config_is_loaded_and_run_by_a_test():
    config = RIGS.parent
    elsewhere = {
        "simulated_load_cell.yaml",
        "simulated_canopen_drive.yaml",
        "simulated_odrive.yaml",
        "simulated_odrive_handle.yaml",
        "simulated_damiao_handle.yaml",
        "simulated_robstride_handle.yaml",
        "simulated_moteus_handle.yaml",
        "simulated_damiao.yaml",
        "simulated_robstride.yaml",
        "simulated_moteus.yaml",
        "simulated_dynamixel.yaml",
        "simulated_feetech.yaml",
        "simulated_vesc.yaml",
        "measured_spring.yaml",
        "simulated_handle.yaml",
        "simulated_serial_handle.yaml",
    }
    rigs = {f"simulated_{kind}.yaml" for kind in RIGS_RUN} | elsewhere
    assert {path.name for path in (config / "rigs").glob("*.yaml")} == rigs
    tests = Path(__file__).parents[1]
    trials = {
        "silicone_cube.yaml": "drivers/test_trial_on_every_rig.py",
        "measured_spring.yaml": "../teleop_rt_dev/trial/files.py",
        "breathing_tissue.yaml": "trial/test_breathing.py",
        "handle.yaml": "../teleop_rt_dev/faults/handle.py",
        "serial_handle.yaml": "../teleop_rt_dev/faults/handle.py",
        "stiffening_foam.yaml": "../teleop_rt_dev/trial/closed_loop.py",
        "hidden_layer.yaml": "trial/test_close_loop.py",
    }
    assert {path.name for path in (config / "trials").glob("*.yaml")} == set(trials)
    for trial, test in trials.items():
        assert trial in (tests / test).read_text(encoding="utf-8")
