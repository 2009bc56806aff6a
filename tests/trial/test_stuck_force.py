"""A force sensor that is dead or saturated, found in the recording of the slave."""

import numpy as np
import pytest

from teleop_rt.trial.stuck_force import stuck_force
from teleop_rt_dev.trial.files import silicone

TICKS = np.arange(8000)
DEPTH = 5e-3 * np.sin(TICKS / 400.0)
FORCE = 3600.0 * np.maximum(DEPTH, 0.0)
NOISE = np.random.default_rng(0).normal(0.0, 0.02, TICKS.size)


def recorded(force, contact=None):
    contact = DEPTH > 0.0 if contact is None else contact
    return {
        "valid": np.ones(TICKS.size),
        "force": force,
        "position": 0.0137 + DEPTH,
        "in_contact": contact.astype(float),
        "surface": np.where(np.logical_or.accumulate(contact), 0.0137, np.nan),
    }


def test_a_living_force_is_not_noted_with_noise_or_without():
    for force in (FORCE, FORCE + NOISE, np.round(FORCE, 1)):
        assert stuck_force(silicone(), recorded(force)) == []


def test_a_tool_at_rest_in_contact_may_see_one_force():
    slave = recorded(FORCE)
    slave["position"][600:3000] = slave["position"][600]
    slave["force"] = np.where(TICKS // 600 == 1, FORCE[600], FORCE)
    assert stuck_force(silicone(), slave) == []


@pytest.mark.parametrize("rate_hz", [10, 80])
def test_a_slow_amplifier_repeats_its_value_and_is_alive(rate_hz):
    every = 1000 // rate_hz
    assert stuck_force(silicone(), recorded((FORCE + NOISE)[TICKS // every * every])) == []


def test_a_force_that_froze_in_contact_is_noted_with_number_time_and_way():
    force = np.where(TICKS < 300, FORCE + NOISE, 12.5)
    (note,) = stuck_force(silicone(), recorded(force, DEPTH > 0.0))
    assert note.startswith("the force was one number, 12.5 N, in 1257 samples (1.26 s) while the ")
    assert "moved by 5 mm in contact: its sensor is dead or saturated; check it" in note


def test_a_sensor_that_dies_with_zero_beyond_a_found_surface_is_noted():
    """The estimators take it for free air; the tool is deeper than the surface."""
    force = np.where(TICKS < 3000, FORCE + NOISE, 0.0)
    (note,) = stuck_force(silicone(), recorded(force, (DEPTH > 0.0) & (TICKS < 3000)))
    assert "one number, 0 N" in note


def test_a_saturated_sensor_is_noted_though_no_press_was_long():
    depth = 5e-3 * np.sin(TICKS / 40.0)
    force = np.minimum(3600.0 * np.maximum(depth, 0.0) + NOISE, 10.0)
    slave = recorded(force, depth > 0.0) | {"position": 0.0137 + depth}
    (note,) = stuck_force(silicone(), slave)
    assert "one number, 10 N" in note


def test_without_a_contact_only_a_force_of_one_number_throughout_is_noted():
    nowhere = np.zeros(TICKS.size, dtype=bool)
    (note,) = stuck_force(silicone(), recorded(np.zeros(TICKS.size), nowhere))
    assert "unless nothing was touched" in note
    assert stuck_force(silicone(), recorded(NOISE, nowhere)) == []
    assert stuck_force(silicone(), {}) == []
