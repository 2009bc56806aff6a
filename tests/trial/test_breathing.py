"""Tissue that breathes is felt moving, in lock-step, beside the plant's own law."""

from __future__ import annotations

import numpy as np

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.realtime.ring_folder import new_ring_folder
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_dev.paths import TRIALS

FILE = TRIALS / "breathing_tissue.yaml"
SECONDS, CONVERGED_S = 5.5, 3.5
K, B, SURFACE = 3600.0, 20.0, 0.0137


def felt_error(seconds: float, since_s: float, *overrides: str) -> float:
    """Return the error of the felt force beside the plant's own law, as a share of its range."""
    trial = load_trial_file(FILE, [f"duration_s={seconds}", *overrides])
    rows = []
    with new_ring_folder() as ring_folder:
        run = LockstepTrial(trial, FILE.parent, open_bench, ring_folder)
        run.slave.configure()
        master = run.master.master
        for tick in range(round(seconds * 1000)):
            run.step()
            rows.append((1e-3 * tick, master.x, master.velocity, master.force))
        run.bench.axis.stop()
        run.master.let_go()
        assert run.slave.safety.fault.name == "none"
    t_s, x, v, felt = np.array(rows).T
    depth = x - SURFACE - 1e-4 * t_s - 2.5e-3 * np.sin(2 * np.pi * 0.3 * t_s)
    true = np.where(depth > 0, np.maximum(0.0, K * depth + B * v), 0.0)
    counts = (t_s > since_s) & ((true > 0) | (felt > 0))
    assert counts.sum() > 1500
    return float(np.sqrt(np.mean((felt - true)[counts] ** 2)) / np.ptp(true[counts]))


def test_breath_is_felt_as_it_is_within_three_hundredths():
    """A model that stands still where it was found leaves 8 %."""
    assert felt_error(SECONDS, CONVERGED_S) < 0.03


def test_breath_is_predicted_by_its_phase_over_a_second():
    """A surface that goes on in a straight line over the delay of its news leaves 7.0 %."""
    assert felt_error(23.0, 19.0, "link.round_trip_ms=1000") < 0.02
