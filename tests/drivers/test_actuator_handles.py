"""A maker's drive as the operator's device: felt, limited, and let go where it fails."""

from __future__ import annotations

import pytest
from framed_bench import load
from rig_bench import MS

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_dev.faults.handle import SERIAL, HandleBench
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.simulated.reference import environment_force

HANDLES = ("damiao", "odrive", "robstride", "moteus")


def handle_of(kind: str) -> str:
    return f"operator.rig=../rigs/simulated_{kind}_handle.yaml"


@pytest.mark.parametrize("kind", HANDLES)
def test_check_accepts_the_handle(kind):
    rig = load(f"{kind}_handle")
    assert not [found for found in check_rig(rig) if found.severity == "error"]


# An ODrive sends of its own accord: its position is up to a period of 1 ms older. In a swing of
# 3 Hz the force is off by w T of its amplitude for that, of its range by w T / (2 sqrt 2): 0.0067,
# and what it reports of its motor is a period older again.
@pytest.mark.parametrize("kind", HANDLES)
def test_the_cube_is_felt_through_a_motor_that_is_the_operator_s_device(kind, tmp_path):
    trial = load_trial_file(SERIAL, ["duration_s=4", handle_of(kind)])
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, SERIAL, open_bench, tmp_path, lambda _: None)
    summary = summarise(tmp_path, trial, outcome, environment_force)
    assert summary["safety"]["fault"]["name"] == "none"
    master = summary["master"]
    older = 0.0067 if kind == "odrive" else 0.0
    assert master["nrmse"] < 0.005 + older
    assert master["true_port"]["motor_nrmse"] < 0.02 + 2.0 * older
    # Older positions need more damping at this stiffness: it is rendered softer.
    assert master["rendering"]["passivity"]["reduced"] is (kind == "odrive")


@pytest.mark.parametrize("kind", HANDLES)
def test_a_handle_pushes_no_more_than_its_limit_and_nothing_for_no_number(kind):
    handle = HandleBench(SERIAL, [handle_of(kind)])
    handle.update(20.0, 2)
    # Of 12 bits for a torque of either sign none is exactly 0: a step is 0.5 N here.
    assert handle.plant.servo_force == pytest.approx(0.0, abs=0.3), "before there is power"
    handle.update(20.0, 40)
    assert handle.plant.servo_force == pytest.approx(-20.0, abs=0.3)
    handle.update(500.0, 20)
    assert handle.plant.servo_force == pytest.approx(-100.0, abs=0.5)
    handle.update(float("nan"), 5)
    assert handle.plant.servo_force == pytest.approx(0.0, abs=0.3)


@pytest.mark.parametrize("fault", ["mute", "over_temperature", "bus_off"])
@pytest.mark.parametrize("kind", HANDLES)
def test_a_handle_with_a_fault_has_no_force_within_70_ms_and_stands(kind, fault):
    handle = HandleBench(SERIAL, [handle_of(kind)])
    handle.update(20.0, 50)
    handle.network.inject(fault, "drive")
    handle.update(20.0, 70)
    assert handle.plant.servo_force == pytest.approx(0.0, abs=0.3)
    first = handle.update(20.0)
    assert handle.update(20.0) == (first[0], 0.0)
    for _ in range(60):
        handle.now += MS
        handle.network.process()
    assert not handle.network.drive.powered
