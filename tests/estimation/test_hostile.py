"""Whatever comes in, every row stays finite and bounded, and nothing is raised."""

import dataclasses
import functools
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from teleop_rt.estimation.bank import Bank, SolverSettings
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.report import report
from teleop_rt.estimation.rows import REGRESSIONS, SOLVERS, rows_for
from teleop_rt_dev.estimation.plant import Press, kelvin_voigt, record

from . import cube_rig
from .streamed_wall import streamed

MODELS = (
    "mass", "kelvin-voigt", "kelvin-voigt-unilateral", "mass-spring-damper", "hunt-crossley",
)  # fmt: skip
ALL = rows_for(MODELS, REGRESSIONS, SOLVERS)
SETTINGS = dataclasses.replace(cube_rig.SETTINGS, forgetting_factor=0.995)


@functools.cache
def pipeline_of(kind):
    """Return the one pipeline of a differentiator: to make it is slow, and a test resets it."""
    return Pipeline(ALL, dataclasses.replace(SETTINGS, differentiator=kind))


wild = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-0.05, 0.05),
    st.sampled_from([0.0, -0.0, 1e300, -1e300, 1e9, 5e-324, 0.01]),
)


def assert_sound(pipeline):
    assert np.all(np.isfinite(pipeline.bank.state))
    assert np.all(np.isfinite(pipeline.predicted))
    assert np.max(np.abs(pipeline.theta)) <= 1e9
    contact = pipeline.contact
    assert contact.surface_known != math.isnan(contact.surface)
    assert math.isfinite(contact.penetration)
    assert math.isfinite(contact.velocity)
    for row in report(pipeline):
        for parameter in row["parameters"].values():
            assert parameter["value"] is None or math.isfinite(parameter["value"])
            assert parameter["std"] is None or math.isfinite(parameter["std"])
        assert row["condition"] is None or math.isfinite(row["condition"])
    if (wall := streamed(pipeline)) is not None:
        assert all(math.isfinite(value) for value in (wall.k, wall.b, wall.n, wall.offset, wall.m))


@pytest.mark.parametrize("kind", ["svf", "kalman", "foaw"])
@given(
    pieces=st.lists(st.tuples(wild, wild, st.booleans(), st.integers(1, 60)), max_size=12),
)
@settings(max_examples=40, deadline=None)
def test_pieces_of_anything_leave_every_row_sound(kind, pieces):
    pipeline = pipeline_of(kind)
    pipeline.reset()
    for position, force, valid, times in pieces:
        for i in range(times):
            pipeline.update(position, force * (1 + 0.01 * i), valid)
    assert_sound(pipeline)


@given(
    damage=hnp.arrays(np.float64, 40, elements=wild),
    where=hnp.arrays(np.int64, 40, elements=st.integers(0, 2999)),
    channel=st.integers(0, 1),
)
@settings(max_examples=25, deadline=None)
def test_a_good_stream_with_damage_leaves_every_row_sound(damage, where, channel):
    samples = record(Press(duration=3.0), kelvin_voigt)
    samples[channel][where] = damage
    pipeline = pipeline_of("svf")
    pipeline.reset()
    pipeline.run(*samples)
    assert_sound(pipeline)


@pytest.mark.parametrize(
    "stream",
    [
        lambda t: (np.full_like(t, 0.01), np.full_like(t, 5.0)),
        lambda t: (np.zeros_like(t), np.zeros_like(t)),
        lambda t: (0.01 * np.sign(np.sin(40 * t)), 30 * np.sign(np.sin(40 * t))),
        lambda t: (0.01 + 0.005 * np.sin(20 * t), np.clip(50 * np.sin(20 * t), -1, 10)),
        lambda t: (1e-12 * np.sin(20 * t), 1e-12 * np.sin(20 * t) + 1),
        lambda t: (1e6 * t, -1e6 * t),
    ],
    ids=["constant", "zero", "steps", "saturated", "tiny", "huge"],
)
def test_dull_and_violent_streams_leave_every_row_sound(stream):
    t = np.arange(20_000) * 1e-3
    pipeline = pipeline_of("svf")
    pipeline.reset()
    position, force = stream(t)
    pipeline.run(position, force, np.ones(len(t), dtype=bool))
    assert_sound(pipeline)


@given(
    phi=hnp.arrays(np.float64, (200, 5, 3), elements=wild),
    y=hnp.arrays(np.float64, (200, 5), elements=wild),
)
@settings(max_examples=40, deadline=None)
def test_the_bank_alone_survives_any_regressors(phi, y):
    bank = Bank(SOLVERS, [3] * 5, SolverSettings(forgetting=0.99))
    bank.run(phi, y)
    assert np.all(np.isfinite(bank.state))
    assert np.max(np.abs(bank.theta)) <= 1e9


def test_an_hour_without_excitation_and_then_work_again():
    """Every solver at lambda = 0.995: constant regressor for an hour, then a good stream."""
    bank = Bank(SOLVERS, [2] * 5, SolverSettings(forgetting=0.995))
    phi = np.tile(np.array([1.0, 0.5]), (40_000, 5, 1))
    y = np.full((40_000, 5), 3.0) + 0.05 * np.random.default_rng(0).normal(size=(40_000, 1))
    for _ in range(90):
        bank.run(phi, y)
    assert np.all(np.isfinite(bank.state))
    assert np.max(np.abs(bank.theta)) < 1e6
    t = np.arange(20_000) * 1e-3
    rich = np.stack([2.4 + np.sin(20 * t), np.cos(20 * t)], axis=1)
    bank.run(np.repeat(rich[:, None, :], 5, axis=1), np.repeat((rich @ [18.0, 2.0])[:, None], 5, 1))
    assert bank.theta[:, :2] == pytest.approx(np.tile([18.0, 2.0], (5, 1)), rel=0.02)


def test_missing_samples_cost_accuracy_little():
    position, force, valid = record(Press(), kelvin_voigt)
    rng = np.random.default_rng(5)
    lost = rng.random(len(valid)) < 0.02
    position[lost], force[lost] = math.nan, 1e30
    pipeline = pipeline_of("svf")
    pipeline.reset()
    pipeline.run(position, force, valid & ~lost)
    found = dict(zip(*pipeline.estimate(5 + 5)[:2], strict=True))
    assert found["k"] == pytest.approx(3600, rel=0.003)
    assert found["b"] == pytest.approx(20, rel=0.03)


def test_a_tick_allocates_nothing_that_grows():
    samples = record(Press(duration=2.0), kelvin_voigt)
    pipeline = pipeline_of("svf")
    pipeline.reset()
    for p, f, ok in zip(*(channel[:500] for channel in samples), strict=True):
        pipeline.update(p, f, ok)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for p, f, ok in zip(*(channel[500:] for channel in samples), strict=True):
        pipeline.update(p, f, ok)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 2000
