"""Tare and homing on simulated rigs whose encoder, drive and force sensor have no true zero."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from framed_bench import RIGS

from teleop_rt.cli.wiring import open_bench
from teleop_rt.config.loader import load_trial
from teleop_rt.realtime.ring_folder import new_ring_folder
from teleop_rt.slave.faults import State
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_drivers import opening, registry

TRIAL = Path(RIGS).parent / "trials" / "silicone_cube.yaml"
NO_ZEROS = (
    "plant.sensors.encoder_zero_m=-0.0213",
    "plant.drive.zero_m=0.0087",
    "plant.sensors.force_offset_N=3.2",
)
TOUCH = (
    "plant.environment.stiffness_N_per_m=1e6",
    "plant.environment.damping_N_s_per_m=400",
    "rig.reference.tare.duration_ms=300",
    "rig.reference.tare.offset_max_N=8",
    "rig.reference.tare.noise_max_N=0.2",
    "rig.reference.tare.drift_max_N_per_s=0.5",
    "rig.reference.homing.to=touch",
    "rig.reference.homing.touch_force_N=10",
    "rig.reference.homing.direction=1",
    "rig.reference.homing.position_m=0.0137",
    "rig.reference.homing.search_m=0.1",
    "rig.reference.homing.speed_m_per_s=0.01",
    "rig.reference.homing.slow_speed_m_per_s=0.002",
    "rig.reference.homing.back_off_m=0.001",
)
PLACE = {"serial": "rig.axis", "raw_can": "rig.axis", "mixed": "rig.axis.parts.bus"}


def trial_of(kind, *changes):
    overrides = [f"rig=../rigs/simulated_{kind}.yaml", *NO_ZEROS, *changes]
    return load_trial(TRIAL, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, overrides)


class Run:
    """A lock-step trial, stepped until it follows or stops, with the plant's truth at hand."""

    def __init__(self, trial, ring_folder):
        rigs = []
        opened = opening.open_lock_step

        def open_both(*arguments):
            axis, rig = opened(*arguments)
            rigs.append(rig)
            return axis, rig

        opening.open_lock_step = open_both
        try:
            self.trial = LockstepTrial(trial, TRIAL.parent, open_bench, ring_folder)
        finally:
            opening.open_lock_step = opened
        self.rig, self.plant = rigs[0], rigs[0].plant
        self.slave = self.trial.slave
        self.slave.configure()
        self.references = []

    def until(self, *states, most=6000):
        for _ in range(most):
            if self.slave.safety.state in states:
                return True
            self.trial.step()
            self.references.append(self.plant.reference)
        return False


@pytest.mark.parametrize("kind", ["unreferenced", "serial", "mixed"])
def test_zeros_are_found_before_the_axis_follows_and_nothing_jumps(kind):
    changes = () if kind == "unreferenced" else (*TOUCH, f"{PLACE[kind]}.drive.zero=unknown")
    with new_ring_folder() as ring_folder:
        run = Run(trial_of(kind, *changes), ring_folder)
        assert run.until(State.RUN)
        found = run.slave.reference.outcome()
        assert found["tare"]["offset"] == pytest.approx(3.2, abs=0.02)
        assert found["tare"]["noise"] == pytest.approx(0.05, rel=0.2)
        assert abs(found["tare"]["drift"]) < 0.1
        # Found within a step of the slow approach, a count, and the wall's own compliance.
        assert found["shift"] == pytest.approx(-0.0213, abs=30e-6)
        run.trial.step()
        assert run.slave.sample.position == pytest.approx(run.plant.position, abs=60e-6)
        assert run.slave.sample.force == pytest.approx(run.plant.force, abs=0.3)
        steps = np.abs(np.diff(run.references))
        assert steps.max() < 1.1 * 0.05 * 1e-3  # the homing speed, and never a jump
        for _ in range(40):
            run.trial.step()
            run.references.append(run.plant.reference)
        assert np.abs(np.diff(run.references)).max() < 1.1 * 0.05 * 1e-3


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ("plant.start_m=0.0157", "tare_contact"),
        ("plant.sensors.force_noise_N=0.5", "tare_noise"),
        ("plant.sensors.force_drift_N_per_s=2.0", "tare_drift"),
        ("plant.sensors.home_switch_m=null", "homing_not_found"),
    ],
)
def test_what_cannot_be_trusted_is_refused_before_anything_follows(change, fault):
    damped = ("plant.drive.idle_damping_N_s_per_m=100000", change)
    with new_ring_folder() as ring_folder:
        run = Run(trial_of("unreferenced", *damped), ring_folder)
        assert run.until(State.FAULT)
        assert run.slave.safety.fault.name == fault
        assert run.slave.safety.fault.next_step
        for _ in range(100):
            run.trial.step()
        assert not run.rig.drive.powered
        if fault.startswith("tare"):
            assert np.ptp(run.references) < 1e-4
