"""Each value of a sample has its own stamp, and the sample the older one: none is swapped or new.

Position and force are given different ages, either way round; where both are equally old, an axis
that swaps their stamps or takes that of reading passes every other test.
"""

from __future__ import annotations

import numpy as np
import pytest
from framed_bench import RIGS, FramedBench, load
from rig_bench import MS, Bench
from test_trial_on_every_rig import open_bench

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.config.loader import load_trial
from teleop_rt.realtime.reading import read_topics
from teleop_rt.trial.estimators import pipeline_settings
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt_drivers import registry
from teleop_rt_drivers.mixed import MixedAxis

SILICONE = RIGS.parent / "trials" / "silicone_cube.yaml"


class Part:
    """A part of an axis that reads given samples."""

    def __init__(self, **given):
        self.given = given

    def read_into(self, sample):
        sample.valid = True
        for name, value in self.given.items():
            setattr(sample, name, value)


class Givers:
    """The config of a mixed axis, as far as one is read."""

    def giving(self, wanted):
        return wanted


@pytest.mark.parametrize(("position_ns", "force_ns"), [(1000, 4000), (4000, 1000)])
def test_a_mixed_axis_takes_each_stamp_from_the_part_that_gives_the_value(position_ns, force_ns):
    none = {"position_stamp_ns": 7, "force_stamp_ns": 8, "stamp_ns": 9, "device_stamp_ns": 10}
    axis = MixedAxis(Givers(), {
        "position": Part(**none | {"position_stamp_ns": position_ns, "device_stamp_ns": 55}),
        "force": Part(**none | {"force_stamp_ns": force_ns, "device_stamp_ns": 66}),
        "drive": Part(**none),
    })  # fmt: skip
    sample = Sample()
    axis.read_into(sample)
    assert (sample.position_stamp_ns, sample.force_stamp_ns) == (position_ns, force_ns)
    assert sample.stamp_ns == 1000
    assert sample.device_stamp_ns == 55, "that of the encoder"


def test_a_mixed_axis_adds_up_what_its_parts_say_beside_their_values():
    parts = {
        "position": Part(rejected=3, switch=True),
        "force": Part(rejected=4, fault=AxisFault.DEVICE_LOST, enabled=True),
        "drive": Part(rejected=5, fault=AxisFault.DRIVE_FAULT, drive_position=0.25),
    }
    axis, sample = MixedAxis(Givers(), parts), Sample()
    for _ in range(2):  # a cycle adds nothing to the one before
        axis.read_into(sample)
        assert (sample.rejected, sample.switch) == (12, True)
        assert sample.fault is AxisFault.DEVICE_LOST, "the first one; the next is a consequence"
        assert (sample.enabled, sample.drive_position) == (False, 0.25), "the drive's own"
    parts["position"].given["switch"] = False
    axis.read_into(sample)
    assert not sample.switch


@pytest.mark.parametrize("silent", ["encoder", "force sensor"])
def test_a_line_s_values_keep_their_stamps_while_one_of_them_is_silent(silent):
    bench = FramedBench(load("serial")).armed()
    before = bench.cycle()
    old_ns = {"encoder": before.position_stamp_ns, "force sensor": before.force_stamp_ns}[silent]
    bench.simulated.inject("mute", silent)
    for _ in range(2):
        sample = bench.cycle()
    stamps = {"encoder": sample.position_stamp_ns, "force sensor": sample.force_stamp_ns}
    assert stamps.pop(silent) - old_ns in {0, MS}, "what was on its way may come"
    ((_, newer_ns),) = stamps.items()
    assert newer_ns >= bench.now - MS
    assert sample.stamp_ns == min(sample.position_stamp_ns, sample.force_stamp_ns) < newer_ns


@pytest.mark.parametrize("silent", ["encoder", "force sensor"])
def test_canopen_values_keep_the_sync_that_latched_them_while_one_of_them_is_silent(silent):
    bench = Bench().armed()
    bench.simulated.inject("mute_pdo", silent)
    for _ in range(4):
        sample = bench.cycle()
    read_ns = bench.now - MS
    stamps = {"encoder": sample.position_stamp_ns, "force sensor": sample.force_stamp_ns}
    old_ns = stamps.pop(silent)
    ((_, newer_ns),) = stamps.items()
    assert newer_ns == read_ns - MS, "latched by the SYNC of the cycle before"
    assert old_ns <= newer_ns - 2 * MS
    assert sample.stamp_ns == old_ns


@pytest.mark.parametrize(
    ("kind", "before", "after"), [("load_cell", 27.34, 0.0), ("canopen", 0.0, 1.0)]
)
def test_the_calibrated_lag_is_taken_out_once_before_pairing_or_after(kind, before, after):
    rig = f"rig={RIGS / f'simulated_{kind}.yaml'}"
    trial = load_trial(SILICONE, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, [rig])
    settings = pipeline_settings(trial)
    assert settings.force_lag_s == pytest.approx(1e-3 * after)
    assert (settings.paired_lag_s or 0.0) == pytest.approx(1e-3 * before)


def test_a_run_records_the_age_of_each_value(tmp_path):
    """On the mixed rig a position is latched a cycle before the force is measured."""
    rig = f"rig={RIGS / 'simulated_mixed.yaml'}"
    changes = [rig, "duration_s=0.3", "operator.start_m=0"]
    trial = load_trial(SILICONE, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, changes)
    write_trial(tmp_path, trial)
    run_lockstep(trial, SILICONE, open_bench, tmp_path, lambda _: None)
    slave = read_topics(tmp_path / "recording.mcap", ["/slave"])["/slave"]
    valid = slave["valid"] > 0
    assert np.count_nonzero(valid) > 200
    older_ms = slave["position_age_ms"][valid] - slave["force_age_ms"][valid]
    assert older_ms == pytest.approx(1.0, abs=1e-6)
    sample_age_ms = 1e-6 * (slave["stamp_ns"] - slave["sample_stamp_ns"])[valid]
    assert sample_age_ms == pytest.approx(slave["position_age_ms"][valid], abs=1e-6)
