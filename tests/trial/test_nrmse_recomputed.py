"""The NRMSE of a summary, recomputed from an exported table as docs/glossary.md describes it."""

import numpy as np
import pytest

from teleop_rt.cli.wiring import open_bench
from teleop_rt.realtime.export import export
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_dev.trial.files import SILICONE, silicone
from teleop_rt_drivers.simulated.reference import environment_force

SETTLED_S = 14.0 / (2.0 * np.pi * 60.0)
"""Of a filter of 60 Hz."""


def excursions_ended(depth, step):
    """Return the excursions that have ended (n,), of a penetration within one contact."""
    ended, count, pressing, extreme = np.zeros(depth.size, int), 0, True, depth[0]
    for i, one in enumerate(depth):
        extreme = max(extreme, one) if pressing else min(extreme, one)
        if abs(one - extreme) > max(0.1 * np.ptp(depth[: i + 1]), 10.0 * step):
            count += not pressing
            pressing, extreme = not pressing, one
        ended[i] = count
    return ended


def test_the_error_of_an_estimator_is_that_of_the_glossary(tmp_path):
    trial = silicone("duration_s=4.0")
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, SILICONE, open_bench, tmp_path, lambda _: None)
    summary = summarise(tmp_path, trial, outcome, environment_force)
    export(tmp_path / "recording.mcap", tmp_path / "slave.npz", "/slave")
    table = np.load(tmp_path / "slave.npz")
    assert set(table["selected"][np.isfinite(table["selected"])]) == {0.0}
    pressing = (table["in_contact"] > 0) & (table["force_N"] >= trial.contact.release_force)
    since = np.arange(pressing.size) - np.maximum.accumulate(
        np.where(pressing, 0, np.arange(pressing.size))
    )
    settled = since > SETTLED_S * trial.rig.rate_hz + 1.0
    assert summary["contact"]["onsets"] == 1, "the excursions below are those of one contact"
    judged = np.flatnonzero(settled)
    depth = (table["position_m"] - table["surface_m"])[judged]
    judged = judged[excursions_ended(depth, trial.rig.sensors.position_resolution) >= 2]
    force, predicted = table["filtered_force_N"], table["predicted_force_N"]
    error = np.sqrt(np.mean((force - predicted)[judged] ** 2)) / np.ptp(force[settled])
    assert error == pytest.approx(summary["estimators"][0]["nrmse"], rel=0.005)
