"""A load cell that is slower than the loop: held, named when it is late, checked beforehand."""

from __future__ import annotations

import numpy as np
import pytest
from framed_bench import MS, RIGS, FramedBench

from teleop_rt.config.loader import load_rig
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt_drivers import registry
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.simulated.slow_converter import settling_weights

CELL = RIGS / "simulated_load_cell.yaml"


def edited(folder, *changes):
    text = CELL.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "rig.yaml"
    path.write_text(text)
    return load_rig(path, registry.AXIS_SCHEMAS)


def armed():
    bench = FramedBench(load_rig(CELL, registry.AXIS_SCHEMAS))
    bench.axis.configure()
    bench.axis.arm()
    for _ in range(40):
        cycle(bench)
    assert bench.sample.enabled
    return bench


def cycle(bench):
    bench.now += 2 * MS
    bench.axis.read_into(bench.sample)
    bench.axis.write(0.0)
    return bench.sample


def test_a_value_is_used_between_two_lines_and_stamped_by_its_own():
    bench = armed()
    stamps = set()
    for _ in range(250):
        sample = cycle(bench)
        assert sample.valid
        assert sample.stale == ""
        assert bench.now - sample.force_stamp_ns <= 16 * MS
        stamps.add(sample.force_stamp_ns)
    assert len(stamps) in {39, 40}, "half a second at 79.4 Hz"


def test_a_silent_cell_is_named_when_its_value_is_too_old_and_when_it_is_lost():
    bench = armed()
    bench.simulated.inject("mute", "force sensor")
    last_ns = bench.sample.force_stamp_ns
    while bench.now - last_ns <= 29 * MS:
        assert cycle(bench).valid
    for _ in range(3):
        sample = cycle(bench)
    assert not sample.valid
    assert sample.stale == "force from cell: older than 31.25 ms"
    while sample.fault.name == "NONE":
        sample = cycle(bench)
    assert bench.now - last_ns == pytest.approx(101 * MS, abs=2 * MS)
    assert sample.complaint == "force from cell: silent for more than 100 ms"


def findings_of(rig, force_cap=None):
    return [f for f in check_rig(rig, force_cap) if f.severity == "error"]


def test_check_accepts_the_rig_and_says_what_a_force_can_do_unseen():
    rig = load_rig(CELL, registry.AXIS_SCHEMAS)
    assert findings_of(rig) == []
    assert findings_of(rig, force_cap=90.0) == []
    # 0.2 m/s x 4000 N/m x (31.25 + 27.34) ms
    assert any("46.9 N unseen" in found.what for found in check_rig(rig, 90.0))


def test_check_refuses_a_force_that_can_pass_its_limit_unseen(tmp_path):
    rig = edited(tmp_path, ("velocity_max_m_per_s: 0.2", "velocity_max_m_per_s: 0.25"))
    (found,) = findings_of(rig, force_cap=90.0)
    assert "lower limits.velocity_max or slave.force_cap" in found.next_step
    assert findings_of(rig, force_cap=80.0) == []


def test_check_asks_for_the_largest_stiffness_where_the_force_is_held(tmp_path):
    line = next(line for line in CELL.read_text().splitlines() if "stiffness_max" in line)
    (found,) = findings_of(edited(tmp_path, (line, "")))
    assert found.where == "limits.stiffness_max_N_per_m"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("        rate_hz: 80 ", "        #"), "the loop needs 500 values/s"),
        (("baud: 115200", "baud: 9600"), "9600 baud carry 76 lines/s of 12 characters, not 80"),
    ],
)
def test_check_compares_lines_baud_and_rate(tmp_path, change, words):
    changes = [change]
    if "rate_hz" in change[0]:
        changes.append(("baud: 115200", "baud: 57600"))
    assert any(words in found.what for found in findings_of(edited(tmp_path, *changes)))


@pytest.mark.parametrize(
    ("timeout", "words"),
    [
        ("timeout_ms: 30", "timeout_ms 30 is below the 31.25 ms"),
        ("timeout_ms: 100\n        hold_ms: 12", "hold_ms 12 is below the 12.5 ms"),
    ],
)
def test_hold_times_that_cannot_be_are_refused(tmp_path, timeout, words):
    with pytest.raises(ConfigError, match=words):
        edited(tmp_path, ("timeout_ms: 100", timeout))


def test_the_simulated_converter_settles_over_four_conversions():
    weights = settling_weights()
    assert weights.sum() == pytest.approx(1.0)
    assert np.all(weights > 0.0)
    middle = weights @ np.arange(len(weights)) / (len(weights) - 1)
    assert middle == pytest.approx(0.5), "its delay is half of its settling time"
