"""The samples that the estimators get: each once, at its own time, with the gaps before it."""

from __future__ import annotations

from collections.abc import Callable

from teleop_rt.axis import Sample, sample_place
from teleop_rt.estimation import pair_kernels
from teleop_rt.estimation.grid import SampleGrid, gap_at
from teleop_rt.estimation.pair_kernels import NOTHING, TO_AVERAGE
from teleop_rt.estimation.pairing import Pairing
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.kernels.jit import bound

Feed = Callable[[bool], object]
"""Takes a tick's sample, valid only where that is true, too."""
_POSITION, _FORCE = sample_place("position"), sample_place("force")
_STAMP, _VALID = sample_place("stamp_ns"), sample_place("valid")


def feed_of(pipeline: Pipeline, period_ns: int, sample: Sample) -> Feed:
    """Return the way of a sample to the estimators of a loop of this period."""
    pairing = pipeline.settings.pairing(period_ns)
    if pairing is None:
        take = pipeline.at_once(period_ns)
        if take is not None:
            return _feed_at_once(take, sample)
        return _feed_ticks(pipeline, SampleGrid(period_ns), sample)
    return _feed_pairs(pipeline, pairing, sample)


def _feed_at_once(take: Callable[[float, float, int, bool], object], sample: Sample) -> Feed:
    """Return the way of sensors that give a sample each tick, where one kernel takes it."""
    floats, counts = sample.floats, sample.counts  # without a call for each number

    def feed(ready: bool) -> None:
        valid = ready and counts[_VALID] > 0
        take(floats[_POSITION], floats[_FORCE], counts[_STAMP], valid)

    return feed


def _feed_ticks(pipeline: Pipeline, grid: SampleGrid, sample: Sample) -> Feed:
    """Return the way of sensors that give a sample each tick."""

    def feed(ready: bool) -> None:
        valid = ready and sample.valid
        if (gap := gap_at(grid.words, valid, sample.stamp_ns)) > 0:
            pipeline.skip(gap)
        pipeline.update(sample.position, sample.force, valid)

    return feed


def _feed_pairs(pipeline: Pipeline, pairing: Pairing, sample: Sample) -> Feed:
    """Return the way of a slow sensor: each new force comes once, with its own position."""
    paired = pairing.of(sample.stored)
    at_once = None if pairing.averages else pipeline.pairs_at_once(paired)
    if at_once is not None:
        return at_once
    take_sample = bound(pair_kernels.take_sample, (paired,), True)  # noqa: FBT003
    take, update = pipeline.at_once(), pipeline.update

    def feed(ready: bool) -> None:
        found = take_sample(ready)
        if found == NOTHING or (found == TO_AVERAGE and not pairing.average()):
            return
        if (gap := pairing.gap) > 0:
            pipeline.skip(gap)
        if take is not None:
            take(pairing.position, pairing.force, 0, True)  # noqa: FBT003 - a kernel's, without names
        else:
            update(pairing.position, pairing.force, valid=True)

    return feed
