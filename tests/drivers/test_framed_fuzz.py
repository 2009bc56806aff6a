from __future__ import annotations

import can
import numpy as np
import pytest
from framed_bench import QUIET, FramedBench, load
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_bench import path, plant_config

from teleop_rt.signals import TRUTH, columns
from teleop_rt_drivers.simulated.frame_devices import crc8

COLUMN = columns(TRUTH)
IDS = [0x100, 0x101, 0x102, 0x555]


def attack_lines(bench: FramedBench, data: bytes, line: str) -> None:
    """Send bytes from the devices' end of a serial line."""
    bench.ends.line_pair(f".{line}")[1].write(data)


def attack_bus(bench: FramedBench, frame_id: int, data: bytes) -> None:
    bench.ends.bus_pair("")[0].deliver(
        can.Message(arbitration_id=frame_id, is_extended_id=False, data=data[:8])
    )


def follow(bench: FramedBench, attack, cycles: int) -> int:
    """Follow the path under attack; return how many valid samples were compared with the truth."""
    truths, checked = {}, 0
    for k in range(cycles):
        attack(bench, k)
        sample = bench.cycle(path(k))
        row = bench.simulated.truth_row
        truths[int(row[COLUMN["stamp_ns"]])] = row.copy()
        if sample.valid and k >= 2:
            truth = truths[sample.stamp_ns]
            assert abs(sample.position - truth[COLUMN["position"]]) <= 2.5e-6 + 1e-12
            assert abs(sample.force - truth[COLUMN["force"]]) <= 0.5e-3 + 1e-5
            checked += 1
    return checked


def quiet(kind: str) -> FramedBench:
    return FramedBench(load(kind), plant=plant_config(sensors=QUIET)).armed()


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(["counter", "wrench", "drive"]), st.binary(max_size=60))))
def test_random_bytes_raise_nothing_and_change_no_valid_value(garbage):
    rest = list(garbage)

    def attack(bench, _):
        if rest:
            line, data = rest.pop()
            attack_lines(bench, data, line)

    assert follow(quiet("serial"), attack, 60) > 30


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(IDS), st.binary(max_size=8)), max_size=60))
def test_random_can_frames_raise_nothing_and_change_no_valid_value(garbage):
    rest = [frame for frame in garbage if not is_good(*frame)]

    def attack(bench, _):
        if rest:
            attack_bus(bench, *rest.pop())

    assert follow(quiet("raw_can"), attack, 60) > 30


def is_good(_: int, data: bytes) -> bool:
    return len(data) == 8 and crc8(data[:7]) == data[7]


@pytest.mark.parametrize("line", ["counter", "wrench", "drive"])
def test_a_seeded_campaign_of_bytes_is_counted_and_harmless(line):
    random = np.random.default_rng(5)

    def attack(bench, _):
        attack_lines(bench, random.bytes(100), line)

    bench = quiet("serial")
    assert follow(bench, attack, 500) > 400
    counters = bench.axis.counters
    # Bytes that are no frame are skipped, one by one, but for those of an unfinished frame.
    assert counters["skipped_bytes"] == pytest.approx(50_000, abs=40)


def test_mutated_frames_are_counted_and_harmless():
    bench = quiet("serial")
    bench.simulated.inject("corrupt", "encoder")
    bench.simulated.inject("corrupt", "force sensor")
    follow(bench, lambda _bench, _k: None, 500)
    assert bench.axis.counters["bad_checksum"] >= 900
    assert bench.sample.rejected >= 900
