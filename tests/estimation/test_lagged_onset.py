"""The surface by a force channel that is known to be slow: its force leaves the noise late."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from teleop_rt.contact.lagged_onset import recursion_of
from teleop_rt.estimation.extension import extension_from
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for

from . import cube_rig

SURFACE_M, FINE = 0.0137, 10
"""Where the body begins, and steps of the plant in a period of 1 ms."""
SETTINGS = dataclasses.replace(
    cube_rig.SETTINGS, onset_force=0.4, release_force=0.2, force_noise=0.05, force_lag_s=0.0
)
FIRST = ("first order", {"bandwidth": 20.0})
SECOND = ("second order", {"bandwidth": 25.0, "damping_ratio": 0.7})


def channel(parameters):
    """Return the coefficients of a channel in the plant's steps, by a bilinear transformation."""
    w = 2.0 * np.pi * parameters["bandwidth"]
    ratio = parameters.get("damping_ratio")
    system = ([w], [1.0, w]) if ratio is None else ([w * w], [1.0, 2.0 * ratio * w, w * w])
    b, a, _ = cont2discrete(system, 1e-3 / FINE, "bilinear")
    return b.ravel(), a


def approach(speed, stiffness, damping, parameters, seed):
    """Return samples of an even way in through a slow channel with noise of 0.05 N."""
    t = np.arange(0.0, 0.1 + 0.02 / speed, 1e-3 / FINE)
    path = np.maximum(0.0, speed * (t - 0.1))
    depth = path - SURFACE_M
    force = np.where(depth > 0.0, stiffness * depth + damping * speed, 0.0)
    shown = lfilter(*channel(parameters), force)[::FINE]
    noise = 0.05 * np.random.default_rng(seed).standard_normal(shown.size)
    return path[::FINE], shown + noise


def surface_met(position, force, law, parameters):
    """Return where the pipeline first places the surface."""
    effect = {"name": "force_lag", "law": law, "parameters": parameters}
    described = {"base": {"model": "kelvin-voigt", "parameters": {}}, "effects": [effect]}
    extension = extension_from("model.yaml", described)
    rows = extension.rows(rows_for(["kelvin-voigt"], ["direct"], ["rls"]))
    pipeline = Pipeline(rows, extension.settings(SETTINGS))
    for x, f in zip(position, force, strict=True):
        pipeline.update(x, f, True)  # noqa: FBT003 - measured
        if np.isfinite(pipeline.contact.surface):
            return pipeline.contact.surface
    raise AssertionError("no surface was met")


@pytest.mark.parametrize(("law", "parameters"), [FIRST, SECOND], ids=["first", "second"])
@pytest.mark.parametrize("speed", [0.01, 0.04])
def test_a_slow_channel_places_the_surface_without_its_lag(law, parameters, speed):
    """Without the lag the surface was up to 6 ms of the way too deep."""
    errors = np.array([
        surface_met(*approach(speed, 2500.0, 15.0, parameters, seed), law, parameters) - SURFACE_M
        for seed in range(8)
    ])  # fmt: skip
    assert np.abs(errors.mean()) < 1.5e-3 * speed
    assert np.all(np.abs(errors) < 3.5e-3 * speed)


def channel_of(orders):
    """Return a cascade of first-order low-passes, one sample at a time."""
    states = [0.0] * orders

    def respond(value):
        for i, state in enumerate(states):
            states[i] = value = state + 0.1 * (value - state)
        return value

    return respond


@pytest.mark.parametrize("orders", [1, 2])
def test_a_recursion_repeats_a_channel_of_first_or_second_order(orders):
    r, respond = recursion_of(channel_of(orders)), channel_of(orders)
    drive = np.concatenate([np.zeros(2), np.random.default_rng(1).standard_normal(100)])
    assert lfilter(r[2:], [1.0, -r[0], -r[1]], drive) == pytest.approx(
        [respond(u) for u in drive], abs=1e-9
    )


def test_a_channel_of_third_order_has_no_such_recursion():
    assert not np.any(recursion_of(channel_of(3)))
