from __future__ import annotations

import can
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_bench import MS, Bench, path, plant_config

from teleop_rt.axis import Sample
from teleop_rt.signals import TRUTH, columns

COLUMN = columns(TRUTH)
KNOWN = [0x000, 0x080, 0x090, 0x0A0, 0x0B0, 0x190, 0x290, 0x1A0, 0x1B0, 0x230, 0x590, 0x5A0, 0x5B0]
KNOWN += [0x610, 0x620, 0x630, 0x710, 0x720, 0x730, 0x77F]


@st.composite
def frames(draw):
    error = draw(st.integers(0, 9)) == 0
    return can.Message(
        arbitration_id=draw(st.sampled_from(KNOWN) | st.integers(0, 0x7FF)),
        is_extended_id=draw(st.integers(0, 9)) == 0,
        is_error_frame=error,
        is_remote_frame=not error and draw(st.integers(0, 9)) == 0,
        data=draw(st.binary(max_size=8)),
    )


@settings(max_examples=40, deadline=None)
@given(st.lists(frames(), min_size=20, max_size=60), st.data())
def test_foreign_frames_raise_nothing_and_change_no_valid_value(garbage, data):
    bench = Bench(plant=plant_config(sensors={"force_noise": 0.0, "force_lag_jitter_us": 0.0}))
    bench.armed()
    truths = {}
    checked = 0
    rest = list(garbage)
    for k in range(80):
        for _ in range(data.draw(st.integers(0, 3))):
            if rest:
                bench.daemon_end.deliver(rest.pop())
        sample = bench.cycle(path(k))
        row = bench.simulated.truth_row
        truths[int(row[COLUMN["stamp_ns"]])] = row.copy()
        if sample.valid and k >= 2:
            position = truths[sample.stamp_ns][COLUMN["position"]]
            force = truths[sample.stamp_ns - MS][COLUMN["force"]]
            assert sample.stamp_ns == bench.now - 2 * MS
            assert abs(sample.position - position) <= 2.5e-6 + 1e-12
            assert abs(sample.force - force) <= 0.5e-3 + 1e-9
            checked += 1
    assert checked > 5


@settings(max_examples=40, deadline=None)
@given(st.lists(frames(), min_size=20, max_size=60))
def test_foreign_frames_raise_nothing_in_the_devices(garbage):
    bench = Bench()
    bench.axis.configure()
    for message in garbage:
        bench.device_end.deliver(message)
        bench.cycle()
    assert isinstance(bench.sample, Sample)
    bench.axis.stop()
    bench.silence(200)
    assert not bench.simulated.drive.powered


@settings(max_examples=40, deadline=None)
@given(st.lists(frames(), min_size=20, max_size=60))
def test_counted_frames_are_all_that_were_not_used(garbage):
    bench = Bench()
    bench.axis.configure()
    bench.cycles(3)
    unlisted = [m for m in garbage if m.arbitration_id not in KNOWN and not m.is_error_frame]
    for message in unlisted:
        bench.daemon_end.deliver(message)
    assert bench.cycle().rejected == len(unlisted)
    assert bench.sample.valid
