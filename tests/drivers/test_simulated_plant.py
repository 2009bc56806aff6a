from __future__ import annotations

import numpy as np
import pytest
from rig_bench import MS, plant_config
from scipy.integrate import solve_ivp

from teleop_rt_drivers.simulated.plant import Plant


def quiet(**changes):
    sensors = {"force_noise": 0.0, "force_lag_jitter_us": 0.0, **changes.pop("sensors", {})}
    return plant_config(sensors=sensors, **changes)


def test_the_free_motion_agrees_with_an_independent_integrator():
    plant = Plant(quiet(environment={"surface": 1.0}), 0, 0)
    plant.hold()
    plant.follow(1e-4, 0.001)
    natural = 2 * np.pi * 100.0

    def motion(t, y):
        reference, rate = (0.1 * t, 0.1) if t < 0.001 else (1e-4, 0.0)
        return [y[1], natural**2 * (reference - y[0]) + 2 * natural * (rate - y[1])]

    first = solve_ivp(motion, (0, 0.001), [0, 0], rtol=1e-12, atol=1e-16, max_step=1e-5)
    second = solve_ivp(motion, (0.001, 0.01), first.y[:, -1], rtol=1e-12, atol=1e-16)
    plant.advance(10 * MS)
    assert plant.position == pytest.approx(second.y[0, -1], abs=1e-11)
    assert plant.velocity == pytest.approx(second.y[1, -1], abs=1e-8)


def test_pressed_at_rest_the_force_is_stiffness_times_penetration():
    plant = Plant(quiet(environment={"surface": 0.01}), 0, 0)
    plant.hold()
    plant.follow(0.02, 0.2)
    plant.advance(1000 * MS)
    assert plant.velocity == pytest.approx(0.0, abs=1e-9)
    assert plant.force == pytest.approx(3600.0 * (plant.position - 0.01), rel=1e-6)
    assert plant.force == pytest.approx(plant.servo_force, rel=1e-6)
    assert plant.force > 30.0


@pytest.mark.parametrize("hides", [False, True])
def test_the_drive_s_reported_force_is_what_momentum_and_body_took(hides):
    """Summed by rectangles it lacked 3 % of the force on a mass of 1 kg, and stiffness 0.5 %."""
    undeclared = ({"effect": "force_bias", "bias": 1.0},) if hides else ()
    plant = Plant(quiet(environment={"surface": 1.0}, undeclared=undeclared), 0, 0)
    assert plant._hides is hides  # which of its two integrations runs shows nowhere else
    plant.hold()
    gains, rates = [], []
    for k in range(1, 1000):
        before = plant.velocity
        plant.follow(4e-3 * (1.0 - np.cos(6.0 * np.pi * 1e-3 * k)), 1e-3)
        plant.advance(k * MS)
        gains.append((plant.velocity - before) / 1e-3)
        rates.append(plant.servo_force)
    assert np.max(np.abs(gains)) > 1.0
    assert np.max(np.abs(np.array(rates) - np.array(gains))[10:]) < 1e-6


def test_damping_adds_to_the_force_while_moving_in():
    plant = Plant(quiet(environment={"surface": 0.0}), 0, 0)
    plant.hold()
    plant.follow(0.02, 0.2)
    plant.advance(100 * MS)
    expected = 3600.0 * plant.position + 20.0 * plant.velocity
    assert plant.velocity == pytest.approx(0.1, rel=0.01)
    assert plant.force == pytest.approx(expected, rel=1e-9)


def test_no_contact_pulls_and_none_acts_outside():
    plant = Plant(quiet(environment={"surface": 0.0}, start=0.005), 0, 0)
    plant.hold()
    plant.follow(-0.02, 0.02)
    forces, outside = [], []
    for k in range(1, 300):
        plant.advance(k * MS // 10)
        forces.append(plant.force)
        if plant.position < 0:
            outside.append(plant.force)
    assert min(forces) == 0.0
    assert len(outside) > 50
    assert max(outside) == 0.0


def test_the_drive_follows_3_hz_8_mm_within_its_stiffness():
    plant = Plant(quiet(environment={"surface": 0.0}), 0, 0)
    plant.hold()
    worst = 0.0
    for k in range(1, 1000):
        target = 0.012 - 0.008 * np.cos(2 * np.pi * 3 * k * 1e-3) - 0.004
        plant.follow(target, 1e-3)
        plant.advance(k * MS)
        worst = max(worst, abs(plant.position - plant.reference))
    assert worst < 4e-4


def test_the_measured_force_is_the_true_one_exactly_one_lag_ago():
    plant = Plant(quiet(environment={"surface": 0.0}, sensors={"force_lag_ms": 1.7}), 0, 0)
    truth = Plant(quiet(environment={"surface": 0.0}), 0, 0)
    for p in (plant, truth):
        p.hold()
        p.follow(0.02, 0.2)
    plant.advance(50 * MS)
    truth.advance(50 * MS - 1_700_000)
    assert plant.measured_force() == pytest.approx(truth.force, rel=1e-6)


def test_force_noise_has_the_stated_deviation_and_lag_jitter_the_stated_width():
    plant = Plant(
        plant_config(sensors={"force_lag_jitter_us": 0.0}, environment={"surface": 1.0}), 0, 3
    )
    readings = np.array([plant.measured_force() for _ in range(4000)])
    assert readings.std() == pytest.approx(0.05, rel=0.05)
    assert readings.mean() == pytest.approx(0.0, abs=0.004)
    config = plant_config(
        sensors={"force_noise": 0.0, "force_lag_jitter_us": 50.0}, environment={"surface": 0.0}
    )
    moving = Plant(config, 0, 3)
    moving.hold()
    moving.follow(0.02, 0.1)
    moving.advance(50 * MS)
    rate = 3600.0 * moving.velocity
    spread = np.ptp([moving.measured_force() for _ in range(4000)])
    assert spread == pytest.approx(rate * 100e-6, rel=0.02)


def test_without_power_the_body_pushes_the_tool_out_and_it_rests():
    plant = Plant(quiet(environment={"surface": 0.0}, start=0.01), 0, 0)
    plant.advance(2000 * MS)
    assert plant.position < 0.002
    assert plant.velocity == pytest.approx(0.0, abs=0.01)


def test_how_often_the_plant_is_asked_does_not_change_its_motion():
    seldom, often = (Plant(quiet(environment={"surface": 0.0}), 0, 0) for _ in range(2))
    for plant in (seldom, often):
        plant.hold()
        plant.follow(0.02, 0.2)
    seldom.advance(100 * MS)
    for k in range(1, 1001):
        often.advance(k * MS // 10)
    assert often.position == pytest.approx(seldom.position, abs=1e-10)


def test_going_back_in_time_does_nothing():
    plant = Plant(quiet(), 10 * MS, 0)
    plant.advance(5 * MS)
    assert plant.now_ns == 10 * MS


def test_truth_reports_all_that_the_plant_knows():
    truth = Plant(plant_config(), 0, 0).truth()
    linear = {"stiffness": 3600.0, "damping": 20.0, "surface": 0.01, "hunt_crossley": None}
    assert truth["environment"] == linear
    assert truth["sensors"]["force_lag_ms"] == 1.0
    assert truth["undeclared"] == []
