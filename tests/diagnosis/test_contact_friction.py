"""Dry friction between tool and body: it acts in contact and is zero in free air."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.diagnose import Diagnosis, diagnose
from teleop_rt.diagnosis.inference.one_more import same_physics
from teleop_rt.recordings.recording import from_arrays

_DT = 1e-3
_N_PER_M, _N_S_PER_M = 2000.0, 15.0


def _pressed(friction: Callable[[Vector, Vector], Vector]) -> Diagnosis:
    """Diagnose 8 s of a body with friction(depth, velocity), pressed at three frequencies."""
    t = _DT * np.arange(8000)
    x, v = 2e-3 * np.ones_like(t), np.zeros_like(t)
    for size, rate, phase in ((3e-3, 0.37, 0.0), (1.5e-3, 1.9, 1.0), (5e-4, 6.1, 0.0)):
        angle = 2.0 * np.pi * rate * t + phase
        x += size * np.sin(angle)
        v += size * 2.0 * np.pi * rate * np.cos(angle)
    force = np.where(x > 0.0, _N_PER_M * x + _N_S_PER_M * v + friction(x, v), 0.0)
    noise = 0.02 * np.random.default_rng(0).standard_normal(t.size)
    return diagnose(from_arrays("body", t, 1e-6 * np.round(x / 1e-6), force + noise), surface=0.0)


def test_friction_in_contact_alone_is_named_with_its_size() -> None:
    answer = _pressed(lambda _, v: 1.5 * np.tanh(v / 1e-3)).answer
    assert answer["verdict"] == "named"
    (effect,) = answer["effects"]
    assert (effect["name"], effect["law"]) == ("coulomb_friction", "smoothed sign, in contact")
    assert effect["parameters"]["friction_force"]["value"] == pytest.approx(1.5, rel=0.01)
    assert answer["error"]["after"] < 1.1 * answer["error"]["noise_floor"]


def test_friction_that_grows_with_the_depth_is_one_of_two_names_with_one_size() -> None:
    """A guide that the contact loads, or the body's own structural damping."""
    answer = _pressed(lambda x, v: 160.0 * x * np.tanh(v / 1e-3)).answer
    assert sorted(answer["class"]) == [["coulomb_friction"], ["hysteresis"]]
    (effect,) = answer["effects"]
    assert effect["law"].endswith("growing with depth")
    found = effect["parameters"]
    size = found.get("friction_per_depth") or found["loss_stiffness"]
    assert size["value"] == pytest.approx(160.0, rel=0.01)
    assert answer["error"]["after"] < 1.1 * answer["error"]["noise_floor"]


def test_friction_and_hysteresis_are_one_effect_where_both_act_in_contact_alone() -> None:
    in_contact = find("coulomb_friction", "smoothed sign, in contact")
    assert same_physics(in_contact, find("hysteresis", "plain"))
    assert not same_physics(find("coulomb_friction", "smoothed sign"), find("hysteresis", "plain"))
