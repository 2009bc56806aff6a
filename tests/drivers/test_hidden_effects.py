"""Effects that a trial hides in the plant, each by its own physics and unknown to the slave."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pydantic import ValidationError
from rig_bench import MS, plant_config
from scipy.integrate import solve_ivp

from teleop_rt_drivers.simulated.plant import Plant
from teleop_rt_drivers.simulated.reference import environment_force

ARMS = {
    "effect": "stress_relaxation",
    "arms": (
        {"stiffness": 800.0, "time_constant_s": 0.05},
        {"stiffness": 500.0, "time_constant_s": 0.3},
    ),
}
HYSTERESIS = {"effect": "hysteresis", "yield_force": 3.0, "yield_travel": 0.001}
ADHESION = {"effect": "adhesion", "pull_off_force": 2.0, "range": 0.0005}
FRICTION = {"effect": "coulomb_friction", "friction_force": 2.0}


def hiding(*effects, surface=0.0, **sensors):
    quiet = {"force_noise": 0.0, "force_lag_ms": 0.0, "force_lag_jitter_us": 0.0, **sensors}
    config = plant_config(sensors=quiet, environment={"surface": surface}, undeclared=effects)
    plant = Plant(config, 0, 1)
    plant.hold()
    return plant


def follow(plant, path):
    """Lead the plant along positions 1 ms apart; return position, velocity, force, reading."""
    rows = []
    for k, target in enumerate(path):
        plant.follow(float(target), 1e-3)
        plant.advance((k + 1) * MS)
        rows.append((plant.position, plant.velocity, plant.force, plant.measured_force()))
    return np.array(rows).T


def ramp(speed, seconds, start=0.0):
    return start + speed * np.arange(round(1000 * seconds)) * 1e-3


def press(amplitude, hz, seconds, mean):
    t = np.arange(round(1000 * seconds)) * 1e-3
    return mean * (1 - np.exp(-t / 0.1)) - amplitude * np.sin(2 * np.pi * hz * t)


def test_relaxation_agrees_with_an_independent_integrator():
    x, v, force, _ = follow(hiding(ARMS), press(0.004, 2.0, 1.0, 0.006))
    t = 1e-3 * np.arange(1, x.size + 1)

    def rates(now, z):
        speed = np.interp(now, t, v) if np.interp(now, t, x) > 0 else 0.0
        return [speed - z[0] / 0.05, speed - z[1] / 0.3]

    arms = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, max_step=5e-4, rtol=1e-8).y
    expected = 3600 * x + 20 * v + 800 * arms[0] + 500 * arms[1]
    inside = (x > 1e-4) & (t > 0.1)
    assert np.abs(expected - force)[inside].max() < 0.02


def test_bristles_hold_at_rest_and_slide_with_the_kinetic_force():
    plant = hiding(FRICTION, surface=1.0)
    path = np.concatenate((ramp(0.05, 0.3), 0.015 - ramp(0.05, 0.3)))
    _, _, force, reading = follow(plant, path)
    assert np.all(force == 0.0)
    assert reading[250:299] == pytest.approx(2.0, rel=0.01)
    assert reading[550:599] == pytest.approx(-2.0, rel=0.01)


def test_a_breakaway_force_above_the_kinetic_one_is_felt_at_low_speed():
    hidden = {
        "effect": "stribeck_friction", "friction_force": 2.0, "breakaway_force": 3.0,
        "stribeck_velocity": 0.02,
    }  # fmt: skip
    slow = follow(hiding(hidden, surface=1.0), ramp(0.002, 0.5))[3][-50:].mean()
    fast = follow(hiding(hidden, surface=1.0), ramp(0.1, 0.3))[3][-50:].mean()
    assert slow == pytest.approx(3.0, rel=0.03)
    assert fast == pytest.approx(2.0, rel=0.01)


def test_the_tip_lags_by_half_the_play_in_either_direction():
    plant = hiding({"effect": "backlash", "gap": 0.001}, surface=0.005)
    path = np.concatenate((ramp(0.05, 0.4), 0.02 - ramp(0.05, 0.2)))
    x, v, force, _ = follow(plant, path)
    depth_in = (force[390] - 20 * v[390]) / 3600
    depth_out = (force[590] - 20 * v[590]) / 3600
    assert x[390] - 0.005 - depth_in == pytest.approx(0.0005, abs=5e-5)
    assert x[590] - 0.005 - depth_out == pytest.approx(-0.0005, abs=5e-5)


def test_a_pitch_error_makes_a_ripple_of_the_force_in_contact():
    plant = hiding({"effect": "position_ripple", "pitch_error": 0.0001, "pitch": 0.002})
    x, v, force, _ = follow(plant, ramp(0.01, 1.2))
    angle = 2 * np.pi * x / 0.002
    rate = v * (1 + 0.1 * np.pi * np.cos(angle))
    tip = (force - 20 * rate) / 3600
    expected = 0.0001 * np.sin(angle)
    assert np.abs(tip - x - expected)[300:].max() < 1e-5


def test_a_lever_bends_by_compliance_times_force():
    plant = hiding({"effect": "series_compliance", "compliance": 1e-4})
    x, _, force, _ = follow(plant, np.minimum(ramp(0.1, 0.4), 0.01))
    assert force[-1] == pytest.approx(3600 * (x[-1] - 1e-4 * force[-1]), rel=1e-3)


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [
        ({"effect": "force_bias", "bias": 1.5}, 1.5),
        ({"effect": "force_drift", "drift": 3.0, "time_constant_s": 0.05}, 3.0),
        ({"effect": "viscous_friction", "damping": 15.0}, 0.0),
    ],
    ids=lambda value: value["effect"] if isinstance(value, dict) else "",
)
def test_a_sensor_at_rest_in_free_air_reads_what_is_hidden(hidden, expected):
    reading = follow(hiding(hidden, surface=1.0), np.full(800, 0.001))[3]
    assert reading[-1] == pytest.approx(expected, abs=0.02)


def test_a_mass_before_the_sensor_reads_as_its_acceleration():
    plant = hiding({"effect": "tool_inertia", "mass": 0.5}, surface=1.0)
    step_ns, rows = 20_000, []
    for k, target in enumerate(0.002 * (1 - np.cos(2 * np.pi * 5 * ramp(1.0, 0.2)))):
        plant.follow(float(target), 1e-3)
        for part in range(1, MS // step_ns + 1):
            plant.advance(k * MS + part * step_ns)
            rows.append((plant.velocity, plant.measured_force()))
    velocity, reading = np.array(rows).T
    between = np.diff(velocity) / (step_ns * 1e-9)
    middle = 0.5 * (reading[1:] + reading[:-1])
    assert np.polyfit(between, middle, 1)[0] == pytest.approx(0.5, rel=0.03)
    assert np.ptp(reading) > 0.5


def test_a_slow_sensor_follows_its_low_pass_of_second_order():
    hidden = {"effect": "force_lag", "cutoff_hz": 20.0, "damping_ratio": 1.0}
    _, _, force, reading = follow(hiding(hidden), press(0.004, 5.0, 2.0, 0.006))
    late = np.argmax(np.correlate(reading[1000:] - reading[1000:].mean(),
                                  force[1000:] - force[1000:].mean(), "full")) - 999  # fmt: skip
    assert late == pytest.approx(1000 * np.angle((1 + 0.25j) ** 2) / (2 * np.pi * 5), abs=2)


def test_a_hidden_delay_adds_to_the_calibrated_lag():
    plain = hiding(force_lag_ms=1.0)
    late = hiding({"effect": "channel_delay", "delay_ms": 6.0}, force_lag_ms=1.0)
    path = press(0.004, 2.0, 0.5, 0.006)
    assert follow(late, path)[3][106:] == pytest.approx(follow(plain, path)[3][100:-6], abs=1e-6)


def test_outliers_come_in_their_share_and_saturation_has_its_level():
    sparks = hiding({"effect": "outliers", "share": 0.02, "size": 5.0}, surface=1.0)
    readings = np.array([sparks.measured_force() for _ in range(5000)])
    assert np.mean(np.abs(readings) > 3.0) == pytest.approx(0.02, abs=0.008)
    clipped = follow(hiding({"effect": "force_saturation", "level": 20.0}), np.full(300, 0.02))
    assert clipped[2][-1] > 60.0
    assert clipped[3][-1] == pytest.approx(20.0, rel=0.01)


ENVIRONMENT = [
    ARMS,
    HYSTERESIS,
    ADHESION,
    {"effect": "nonlinear_stiffening", "stiffness": 1500.0, "locking_depth": 0.05},
    {"effect": "second_layer", "stiffness": 3000.0, "depth": 0.006},
    {"effect": "quadratic_damping", "damping": 200.0},
    {"effect": "softening", "share": 0.4, "time_constant_s": 1.0},
    {"effect": "mullins_softening", "share": 0.3, "width": 0.004},
    {"effect": "permanent_set", "share": 0.2},
    {"effect": "moving_surface", "velocity": 0.001, "swing": 0.0005},
]


@pytest.mark.parametrize("hidden", ENVIRONMENT, ids=lambda hidden: hidden["effect"])
def test_the_reference_of_the_hand_is_the_body_alone_with_what_it_hides(hidden):
    plant = hiding(hidden, FRICTION, {"effect": "force_bias", "bias": 2.0}, surface=0.002)
    x, v, force, reading = follow(plant, press(0.005, 2.0, 1.5, 0.006))
    truth = json.loads(json.dumps(plant.truth()))
    expected = environment_force(truth, x, v, 1e-3)
    assert np.sqrt(np.mean((expected - force) ** 2)) < 0.003 * np.ptp(force)
    assert np.sqrt(np.mean((reading - force) ** 2)) > 0.02 * np.ptp(force)
    truth["undeclared"] = []
    plain = environment_force(truth, x, v, 1e-3)
    assert np.sqrt(np.mean((plain - force) ** 2)) > 0.003 * np.ptp(force)


def test_what_is_hidden_is_written_to_the_truth_alone():
    truth = hiding(FRICTION).truth()
    assert truth["undeclared"] == [FRICTION | {"presliding_travel": 1e-4}]


def test_how_often_the_plant_is_asked_does_not_change_what_is_hidden():
    seldom, often = hiding(ARMS, FRICTION), hiding(ARMS, FRICTION)
    for plant in (seldom, often):
        plant.follow(0.02, 0.2)
    seldom.advance(100 * MS)
    for k in range(1, 101):
        often.advance(k * MS)
    assert often.position == pytest.approx(seldom.position, abs=1e-9)
    assert often.force == pytest.approx(seldom.force, rel=1e-6)


@pytest.mark.parametrize(
    ("hidden", "words"),
    [
        (({"effect": "stick-slip"},), "stick-slip"),
        (({"effect": "force_bias", "bias": 1.0}, {"effect": "force_bias", "bias": 2.0}),
         "force_bias is listed more than once"),
        ((FRICTION, {"effect": "stribeck_friction", "friction_force": 1.0,
                     "breakaway_force": 2.0, "stribeck_velocity": 0.1}), "not both"),
        (({"effect": "backlash", "gap": -1.0},), "greater than 0"),
        (({"effect": "moving_surface"},), "velocity and swing are 0, so that nothing moves"),
    ],
)  # fmt: skip
def test_hidden_effects_that_cannot_be_are_refused(hidden, words):
    with pytest.raises(ValidationError, match=words):
        plant_config(undeclared=hidden)
