"""The samples that the estimators get: each once, at its own time, with the gaps before it."""

from __future__ import annotations

from collections.abc import Callable

from teleop_rt.axis import Sample
from teleop_rt.estimation.grid import SampleGrid, gap_at
from teleop_rt.estimation.pairing import Pairing
from teleop_rt.estimation.pipeline import Pipeline

Feed = Callable[[Sample, bool], object]
"""Takes a tick's sample, and whether it is valid."""


def feed_of(pipeline: Pipeline, period_ns: int) -> Feed:
    """Return how a tick's sample reaches the estimators of a loop of this period."""
    pairing = pipeline.settings.pairing(period_ns)
    if pairing is None:
        take = pipeline.on_grid(period_ns)
        if take is not None:
            return _feed_at_once(take)
        return _feed_ticks(pipeline, SampleGrid(period_ns))
    return _feed_pairs(pipeline, pairing)


def _feed_at_once(take: Callable[[float, float, bool, int], object]) -> Feed:
    """Return the way of sensors that give a sample each tick, where one kernel takes it."""
    return lambda sample, valid: take(sample.position, sample.force, valid, sample.stamp_ns)


def _feed_ticks(pipeline: Pipeline, grid: SampleGrid) -> Feed:
    """Return the way of sensors that give a sample each tick."""

    def feed(sample: Sample, valid: bool) -> None:
        if (gap := gap_at(grid.words, valid, sample.stamp_ns)) > 0:
            pipeline.skip(gap)
        pipeline.update(sample.position, sample.force, valid)

    return feed


def _feed_pairs(pipeline: Pipeline, pairing: Pairing) -> Feed:
    """Return the way of a slow sensor: each new force comes once, with its own position."""

    def feed(sample: Sample, valid: bool) -> None:
        if valid and pairing.take(
            sample.position, sample.position_stamp_ns, sample.force, sample.force_stamp_ns
        ):
            position, force, gap = pairing.newest()
            if gap > 0:
                pipeline.skip(gap)
            pipeline.update(position, force, valid=True)

    return feed
