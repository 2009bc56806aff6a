"""A maker's drive as the operator's device: felt, limited, and let go where it fails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from framed_bench import load
from rig_bench import MS

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.master.build import cutoff_of, make_port
from teleop_rt.master.passivity import PassivityBound
from teleop_rt.realtime.reading import read_topics
from teleop_rt.signals import HANDLE_TRUTH_TOPIC
from teleop_rt.trial.felt_force import converged
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_dev.faults.handle import SERIAL, HandleBench
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.device_check import device_transport, timing_of
from teleop_rt_drivers.simulated.reference import environment_force

HANDLES = ("damiao", "odrive", "robstride", "moteus")
K, B, SURFACE = 3600.0, 20.0, 0.0137
MODEL_SHARE = 0.001
"""Allowed error of an estimate, of its range: 0.1 % of the stiffness and of the surface's depth."""
# Steps of a torque, of 12 bits over -10 to 10 Nm and 16 bits over -17 to 17 Nm, at 100 N per Nm.
TORQUE_STEP_N = {"damiao": 2000.0 / 4095.0, "robstride": 3400.0 / 65535.0}


def handle_of(kind: str) -> str:
    return f"operator.rig=../rigs/simulated_{kind}_handle.yaml"


@pytest.mark.parametrize("kind", HANDLES)
def test_check_accepts_the_handle(kind):
    rig = load(f"{kind}_handle")
    assert not [found for found in check_rig(rig) if found.severity == "error"]


@dataclass(frozen=True)
class Declared:
    """Errors of a felt force by a device's declared figures, as shares of its range."""

    motion: float
    velocity: float
    damping: float
    torque: float

    @property
    def felt(self):
        """Of the force that is asked for, at the positions that the device reported."""
        return self.velocity + self.damping + MODEL_SHARE

    @property
    def of_motor(self):
        """Of the force that the motor made, at the place where the handle truly was."""
        return self.felt + self.motion + self.torque


def declared(trial, folder, damping):
    """Work them out along the true motion of the handle; `damping` is the passive one [N s/m]."""
    topics = read_topics(folder / "recording.mcap", ["/master", HANDLE_TRUTH_TOPIC])
    master, handle = topics["/master"], topics[HANDLE_TRUTH_TOPIC]
    rig, period_s = trial.operator.rig, 1.0 / trial.master.rate_hz
    latency_s = timing_of(device_transport(rig), rig).latency_s + 0.5 * period_s  # the hold's half

    def late(name, seconds):
        return np.interp(master["stamp_ns"] - 1e9 * seconds, handle["stamp_ns"], handle[name])

    def wall(seconds):
        depth = late("position", seconds) - master["offset"] - SURFACE
        force = np.maximum(K * depth + B * late("velocity", seconds), 0.0)
        return np.where(depth > 0.0, force, 0.0)

    pressed = converged(trial, master) & (wall(0.0) > 0.0)
    span = np.ptp(wall(0.0)[pressed])

    def share(error):
        return float(np.sqrt(np.mean(error[pressed] ** 2)) / span)

    # A first-order low-pass lags by 1 / (2 pi f) at the tones of a hand, a difference by T / 2.
    filter_s = 1.0 / (2.0 * np.pi * cutoff_of(trial.master, real=True)) + 0.5 * period_s
    return Declared(
        motion=share(wall(0.0) - wall(latency_s)),
        velocity=damping * share(late("velocity", 0.0) - late("velocity", filter_s)),
        damping=(B - damping) * share(late("velocity", 0.0)),
        torque=TORQUE_STEP_N.get(rig.axis.drive.driver, 0.0) / np.sqrt(12.0) / span,
    )


@pytest.mark.parametrize("kind", HANDLES)
def test_the_cube_is_felt_through_a_motor_as_well_as_its_declared_figures_let_it(kind, tmp_path):
    """An ODrive's positions are older, so of 20 N s/m at this stiffness it renders 14.5."""
    trial = load_trial_file(SERIAL, ["duration_s=6", handle_of(kind)])
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, SERIAL, open_bench, tmp_path, lambda _: None)
    summary = summarise(tmp_path, trial, outcome, environment_force)
    assert summary["safety"]["fault"]["name"] == "none"
    rig = trial.operator.rig
    timing = timing_of(device_transport(rig), rig)
    port = make_port(trial.master, 1.0 / trial.master.rate_hz, trial.operator, timing)
    _, passive = PassivityBound(port).reduce(K, B)
    rendering = summary["master"]["rendering"]["passivity"]
    assert rendering["stiffness"]["rendered"] == pytest.approx(K, rel=1e-3)
    assert rendering["damping"]["rendered"] == pytest.approx(passive, rel=0.01)
    assert rendering["reduced"] is (passive < B)
    bars = declared(trial, tmp_path, passive)
    assert summary["master"]["nrmse"] < bars.felt
    assert summary["master"]["true_port"]["motor_nrmse"] < bars.of_motor


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
