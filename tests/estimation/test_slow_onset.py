"""The surface by a force that a slow converter averages: its first samples lie half in the air."""

from __future__ import annotations

import math

import numpy as np
import pytest

from teleop_rt.contact import detection
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.rows import rows_for

RATE_HZ, SETTLING_S = 80.0, 0.05
FINE_S = 2.5e-4
NOISE_N = 0.05
SURFACE_M = 0.0137


def settings(settling_s=SETTLING_S):
    return PipelineSettings(
        period_s=1.0 / RATE_HZ, position_resolution=5e-6, force_noise=NOISE_N, onset_force=0.4,
        release_force=0.2, paired_lag_s=0.0, paired_settling_s=settling_s, cutoff_hz=10.0,
        onset_samples=2, release_samples=2,
    )  # fmt: skip


def averaged(values, order):
    """Average over a conversion `order` times, each value about its own time."""
    box = np.full(round(1.0 / RATE_HZ / FINE_S), RATE_HZ * FINE_S)
    for _ in range(order):
        values = np.convolve(np.pad(values, len(box), mode="edge"), box, "same")[
            len(box) : -len(box)
        ]
    return values


def samples(path, stiffness, damping, phase, order=4, seed=1):
    """Return the readings of a converter and an encoder on a path (n,), in steps of FINE_S."""
    depth = path - SURFACE_M
    force = np.where(depth > 0.0, stiffness * depth + damping * np.gradient(path, FINE_S), 0.0)
    every = round(1.0 / RATE_HZ / FINE_S)
    x, f = (averaged(one, order)[phase::every] for one in (path, np.maximum(force, 0.0)))
    return x, f + NOISE_N * np.random.default_rng(seed).standard_normal(f.size)


def approach(speed, deepest=2.0e-3, rest_s=0.5):
    """Return a path that goes in evenly, and stays."""
    t = np.arange(0.0, (SURFACE_M + deepest) / speed + 0.6 + rest_s, FINE_S)
    return np.clip(speed * (t - 0.6), 0.0, SURFACE_M + deepest)


def pressing(seconds):
    """Return a path that goes in and out at 3 Hz, and leaves the body each time."""
    t = np.arange(0.0, seconds, FINE_S)
    into = approach(0.04, deepest=1.6e-3, rest_s=0.2)
    swing = into[-1] + 0.0065 * (1.0 - np.cos(6.0 * np.pi * t)) - 0.003 * np.minimum(5.0 * t, 1.0)
    return np.concatenate([into, swing])


def feed(pipeline, x, f):
    for position, force in zip(x, f, strict=True):
        pipeline.update(position, force, True)  # noqa: FBT003 - the axis's flag


def run(x, f, given=None):
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), given or settings())
    feed(pipeline, x, f)
    return pipeline


@pytest.mark.parametrize("speed", [0.01, 0.04, 0.08])
@pytest.mark.parametrize(("stiffness", "damping"), [(3600.0, 20.0), (900.0, 10.0), (300.0, 3.0)])
def test_an_averaged_force_places_the_surface_as_well_as_it_says(stiffness, damping, speed):
    """The tool goes on for two settling times behind the surface, at ten phases of the samples."""
    path = approach(speed, max(2e-3, 2.0 * speed * SETTLING_S))
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), settings())
    errors, stated = np.zeros(20), np.zeros(20)
    for n in range(20):
        pipeline.reset()
        feed(pipeline, *samples(path, stiffness, damping, 5 * (n // 2), seed=n))
        assert pipeline.contact.in_contact
        errors[n] = pipeline.contact.surface - SURFACE_M
        detector = pipeline.stored[0]["detector"]
        stated[n] = math.sqrt(detection.surface_variance(detector, curved=False))
    assert abs(errors.mean()) < 1e-4
    assert np.abs(errors).max() < 5e-4, "the bound of a trial"
    assert np.sqrt(np.mean((errors / stated) ** 2)) < 2.0


@pytest.mark.parametrize("phase", [0, 20, 40])
def test_stiffness_is_right_from_the_first_contacts_on(phase):
    pipeline = run(*samples(pressing(3.0), 3600.0, 20.0, phase))
    assert pipeline.status[0] in {"estimated", "held"}
    _, (k, b), _ = pipeline.estimate(0)
    assert k == pytest.approx(3600.0, rel=0.01)
    assert b == pytest.approx(20.0, rel=0.1)


def test_a_contact_shorter_than_the_wait_places_its_surface_as_it_ends():
    path = np.concatenate([approach(0.04, rest_s=0.02), approach(0.04, rest_s=0.02)[::-1]])
    pipeline = run(*samples(path, 3600.0, 20.0, 7))
    assert not pipeline.contact.in_contact
    assert pipeline.contact.surface == pytest.approx(SURFACE_M, abs=1e-4)


@pytest.mark.parametrize("order", [1, 3])
def test_other_converters_settle_in_fewer_conversions(order):
    x, f = samples(approach(0.04), 3600.0, 20.0, 5, order)
    pipeline = run(x, f, settings(order / RATE_HZ))
    assert pipeline.contact.surface == pytest.approx(SURFACE_M, abs=1e-4)


def test_a_converter_that_settles_for_longer_than_can_be_followed_is_refused():
    with pytest.raises(ValueError, match="settles in 9 samples, 8 at most"):
        run([], [], settings(9.0 / RATE_HZ))
