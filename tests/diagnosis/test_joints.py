"""Friction behind a joint or under load, and joints that seat: laws of fixtures and guides."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.diagnosis.diagnose import Diagnosis, diagnose
from teleop_rt.diagnosis.models.in_series import BodyLoad, Joint, SpringDamper, press_in_series
from teleop_rt.recordings.recording import from_arrays

DT_S = 0.01
SUBSTEPS = 40
T_S = DT_S / SUBSTEPS * np.arange(3000 * SUBSTEPS)
SMOOTH_M = 1e-3 * np.sin(0.9 * T_S) + 5e-4 * np.sin(2.3 * T_S + 1.0) + 2e-4 * np.sin(7.1 * T_S)


def diagnosed(
    x: np.ndarray, force: np.ndarray, noise_n: float, encoder_m: float = 5e-7
) -> Diagnosis:
    """Diagnose every `SUBSTEPS`-th sample, with noise and encoder steps added."""
    x, force = x[::SUBSTEPS], force[::SUBSTEPS]
    force = force + noise_n * np.random.default_rng(12).standard_normal(force.size)
    return diagnose(
        from_arrays("joint", T_S[::SUBSTEPS], encoder_m * np.round(x / encoder_m), force)
    )


def behind_a_spring(x: np.ndarray, k: float, b: float, c: float, friction: float) -> np.ndarray:
    """Return the force of a specimen that slides in a dry fixture, behind a load frame.

    The specimen is at y, the frame gives by c [m/N] times the force: f = (x - y)/c. It slides where
    its spring and damper do not balance that force within the friction.
    """
    h = T_S[1] - T_S[0]
    y, force = 0.0, np.empty(x.size)
    for i, here in enumerate(x.tolist()):
        free = (here - y) / c - k * y
        if abs(free) > friction:
            over = free - np.sign(free) * friction
            y += over / (b / h + k + 1.0 / c)  # implicit in y
        force[i] = (here - y) / c
    return force


def test_friction_of_a_fixture_behind_a_load_frame_is_friction() -> None:
    found = diagnosed(SMOOTH_M, behind_a_spring(SMOOTH_M, 22e3, 200.0, 6e-6, 6.0), 0.12)
    assert found.answer["class"][0] == ["coulomb_friction"]
    assert found.answer["error"]["after_over_floor"] < 1.1
    [effect] = found.answer["effects"]
    # In series with the frame the specimen's spring takes a part of it: 6 / (1 + k c).
    assert effect["parameters"]["friction_force"]["value"] == pytest.approx(5.3, rel=0.05)


def under_load(depth: np.ndarray, level_n: float, growth: float) -> np.ndarray:
    """Return the force of a seal that turns over within 60 um, pressed by the load of the drive."""
    z, force = 0.0, np.empty(depth.size)
    for i, moved in enumerate(np.diff(depth, prepend=depth[0]).tolist()):
        z += moved / 6e-5 * (1.0 - z * np.sign(moved))
        load = 2000.0 * max(depth[i], 0.0)
        force[i] = (level_n + growth * load) * z
    return force


def test_friction_of_a_seal_that_the_load_presses_is_one_effect() -> None:
    """Coulomb friction and a hysteresis that grows with the depth were named instead."""
    depth = 8.0 * SMOOTH_M + 3e-3
    speed = np.gradient(depth, T_S)
    body = np.where(depth > 0.0, np.maximum(2000.0 * depth + 40.0 * speed, 0.0), 0.0)
    found = diagnosed(depth, body + under_load(depth, 2.2, 0.03), 0.3, encoder_m=5e-6)
    assert found.answer["class"] == [["coulomb_friction"]]
    [effect] = found.answer["effects"]
    assert effect["law"].endswith("under load")
    assert effect["parameters"]["friction_force"]["value"] == pytest.approx(2.2, rel=0.1)
    doubled_m = 2.2 / (0.03 * 2000.0)
    assert effect["parameters"]["doubling_depth"]["value"] == pytest.approx(doubled_m, rel=0.15)


def seated(x: np.ndarray, k: float, give: np.ndarray, pressed: np.ndarray) -> np.ndarray:
    """Return the force of a spring behind a joint that gives by `give` [m] at forces `pressed`."""
    return np.interp(x, pressed / k + give, pressed)


@pytest.mark.parametrize("friction", [0.0, 4.0])
def test_a_joint_that_seats_behind_a_held_specimen_is_a_compliance(friction: float) -> None:
    """The joint gives as an exponential, which no law of the library is."""
    pressed = np.linspace(-400.0, 400.0, 20_001)
    give = np.sign(pressed) * 4e-6 * 25.0 * (1.0 - np.exp(-np.abs(pressed) / 25.0))
    speed = np.gradient(SMOOTH_M, T_S)
    force = seated(SMOOTH_M, 1e5, give, pressed) + 60.0 * speed + friction * np.tanh(speed / 2e-5)
    answer = diagnosed(SMOOTH_M, force, 0.8).answer
    truth = ["coulomb_friction", "series_compliance"] if friction else ["series_compliance"]
    assert sorted(answer["class"][0]) == truth
    assert answer["verdict"] in {"named", "class"}
    assert answer["error"]["after_over_floor"] < 1.25


def stiffening_behind_a_spring(depth: np.ndarray, joint_n_m: float) -> np.ndarray:
    """Return the force 1500 p + 60 p' + 4e7 p³ [N] of a body pressed by a sprung tool at p."""
    h = T_S[1] - T_S[0]
    p, force = 0.0, np.zeros(depth.size)
    for i, here in enumerate(depth.tolist()):
        if here <= 0.0:
            p = 0.0
            continue
        # The tool moves by p' = (joint - spring)/60, in steps of 0.25 ms of its 7 ms and more.
        p = max(0.0, p + h * (joint_n_m * (here - p) - 1500.0 * p - 4e7 * p**3) / 60.0)
        force[i] = max(0.0, joint_n_m * (here - p))
    return force


def test_a_body_stiffens_by_the_depth_that_a_joint_leaves() -> None:
    """By the depth of the drive it was a stiffening alone, at 1.25 times the noise."""
    depth = 4.0 * SMOOTH_M + 1.5e-3
    found = diagnosed(depth, stiffening_behind_a_spring(depth, 6000.0), 0.05, encoder_m=1e-6)
    assert set(found.answer["class"][0]) == {"series_compliance", "nonlinear_stiffening"}
    assert found.answer["error"]["after_over_floor"] < 1.1
    values = {e["name"]: e["parameters"] for e in found.answer["effects"]}
    assert values["series_compliance"]["compliance"]["value"] == pytest.approx(1 / 6000.0, rel=0.1)


def test_a_joint_deflects_no_farther_than_the_drive_is_deep() -> None:
    """A load that a law has at no depth would press the tool out of the body."""
    x = np.linspace(1e-6, 1e-3, 200)
    load = BodyLoad(np.full(x.size, 0.25), 0.0)
    body, joint = SpringDamper(4e5, 1.85, 5e3, 1.85), Joint(4.4e-4, 1.9)
    found = press_in_series(
        x, np.full(x.size, 7e-3), body, joint, DT_S, load, clamped=True, slopes=True
    )
    assert np.all(np.isfinite(found))
    assert np.all(4.4e-4 * found[0] / (1.0 + found[0] / 1.9) < x)
