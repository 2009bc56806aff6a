"""Stalls of the loop leave places without a sample: they are missing, not out of the world."""

import math

import numpy as np
import pytest

from teleop_rt.estimation.grid import SampleGrid, gap_at, with_gaps
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for
from teleop_rt_dev.estimation.plant import Press, kelvin_voigt, record

from .cube_rig import SETTINGS

PERIOD_NS = 1_000_000
START_NS = 10**15


def gaps_of(places, latency_ns=lambda index: 0):
    grid = SampleGrid(PERIOD_NS)
    return [
        gap_at(grid.words, valid=True, stamp_ns=START_NS + place * PERIOD_NS + latency_ns(index))
        for index, place in enumerate(places)
    ]


def test_a_gap_is_as_long_as_the_places_that_were_skipped():
    assert gaps_of([0, 1, 2, 6, 7, 30]) == [0, 0, 0, 3, 0, 22]


def test_late_stamps_are_no_gaps_and_a_gap_is_counted_once_whatever_the_first_ones_latency():
    rng = np.random.default_rng(1)
    jitter = rng.uniform(0.0, 0.7 * PERIOD_NS, 4000).astype(int)
    jitter[0] = 0.6 * PERIOD_NS
    places = [*range(1000), *range(1005, 3000), *range(3001, 4000)]
    gaps = gaps_of(places, lambda index: int(jitter[index]))
    assert {i: gap for i, gap in enumerate(gaps) if gap} == {1000: 5, 2995: 1}


def test_a_cycle_without_a_sample_fills_its_place():
    grid = SampleGrid(PERIOD_NS)
    assert gap_at(grid.words, valid=True, stamp_ns=START_NS) == 0
    assert gap_at(grid.words, valid=False, stamp_ns=0) == 0
    assert gap_at(grid.words, valid=False, stamp_ns=0) == 0
    assert gap_at(grid.words, valid=True, stamp_ns=START_NS + 3 * PERIOD_NS) == 0
    assert gap_at(grid.words, valid=True, stamp_ns=START_NS + 5 * PERIOD_NS) == 1


def stalled(samples, every=40, longest=9, seed=3):
    """A recording as a loop that stalls now and then would have it: samples of the stalls lack."""
    position, force, valid = samples
    rng, kept, at = np.random.default_rng(seed), [], 0
    while at < len(position):
        ran = int(rng.integers(every // 2, 2 * every))
        kept += range(at, min(at + ran, len(position)))
        at += ran + int(rng.integers(1, longest))
    place = np.array(kept)
    stamps = START_NS + PERIOD_NS * place.astype(float)
    return position[place], force[place], valid[place], stamps


def filled(position, force, valid, stamps):
    return list(with_gaps((position, force, valid), valid, stamps, PERIOD_NS))


def damping_error(samples):
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), SETTINGS)
    pipeline.run(*samples)
    _, (k, b), _ = pipeline.estimate(0)
    assert k == pytest.approx(3600, rel=0.003)
    return abs(b - 20) / 20


def test_damping_is_found_from_a_loop_that_stalls_every_forty_ticks():
    kept = stalled(record(Press(), kelvin_voigt))
    assert damping_error(filled(*kept)) < 0.01
    assert damping_error(kept[:3]) > 0.05  # as if each sample came a period after the last


def test_on_line_and_replayed_a_recording_with_gaps_gives_the_same_numbers():
    position, force, valid, stamps = stalled(record(Press(duration=3.0), kelvin_voigt))
    valid[500:503] = False
    online, replayed = (Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), SETTINGS)
                        for _ in range(2))  # fmt: skip
    take = online.at_once(PERIOD_NS)
    for x, f, ok, stamp in zip(position, force, valid, stamps, strict=True):
        take(x, f, int(stamp), bool(ok))
    replayed.run(*filled(position, force, valid, stamps))
    assert np.array_equal(online.theta, replayed.theta)
    assert online.contact == replayed.contact


def test_a_row_is_asked_for_when_the_one_before_is_done_and_is_missing_in_the_gap():
    valid, stamps = np.array([True, True, False]), np.array([0.0, 3.0, 0.0]) * PERIOD_NS
    asked = []

    def rows():
        for row in (np.array([1.0, 2.0, 3.0]), valid):
            asked.append(row)
            yield row

    spread = with_gaps(rows(), valid, stamps, PERIOD_NS)
    assert np.array_equal(next(spread), [1.0, math.nan, math.nan, 2.0, 3.0], equal_nan=True)
    assert len(asked) == 1
    assert list(next(spread)) == [True, False, False, True, False]


def test_a_recording_without_a_gap_is_left_as_it_is():
    position, force, valid = record(Press(duration=0.5), kelvin_voigt)
    stamps = START_NS + PERIOD_NS * np.arange(len(position), dtype=float)
    same = filled(position, force, valid, stamps)
    assert same[0] is position
    nothing = np.empty(0)
    assert filled(nothing, nothing, nothing > 0, nothing)[0].size == 0
