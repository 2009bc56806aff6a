"""A body under a rounded tip: the lost, damped or rubbing part is a share of its elastic force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import cases

from teleop_rt.contact.effect import OF_THE_SPRING, Vector
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.applicable import applicable
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, NOISE_N, DEPTH_M = 4e-3, 0.02, 1e-3


def _pressed(power: float, lost: str) -> Recording:
    """Return 12 s of presses of 5 N into a body f = d^p (1 + v / 40 mm/s), a share of it `lost`."""
    t = DT_S * np.arange(3000)
    x = 1.2e-3 * (0.6 * np.sin(2.0 * np.pi * 0.31 * t) + 0.4 * np.sin(2.0 * np.pi * 0.83 * t + 1.0))
    depth, speed = np.maximum(x, 0.0), np.gradient(x, DT_S)
    spring = 5.0 * (depth / DEPTH_M) ** power
    deepest = np.maximum.accumulate(depth)
    share: dict[str, Vector] = {
        "with time": 0.2 * (1.0 - np.exp(-t / 4.0)),
        "below the deepest": 0.2 * np.tanh(3.0 * (1.0 - (depth / np.maximum(deepest, 1e-9)) ** 2)),
        "by friction": -0.06 * np.tanh(speed / 1e-4),
        "by forward speed": -0.06 * np.maximum(speed, 0.0) / DEPTH_M,
        "by the square of the speed": -0.03 * speed * np.abs(speed) / DEPTH_M**2,
        "nothing": np.zeros(t.size),
    }
    force = spring * (1.0 - share[lost]) + 0.04 * spring * speed / DEPTH_M
    force = np.where(x > 0.0, np.maximum(force, 0.0), 0.0)
    rng = np.random.default_rng(11)
    force += NOISE_N * rng.standard_normal(t.size)
    return from_arrays("tip", t, x + 2e-8 * rng.standard_normal(t.size), force)


@pytest.mark.parametrize("power", cases(1.5, 2.0))
@pytest.mark.parametrize(
    ("lost", "names"),
    [
        ("with time", ["softening"]),
        ("below the deepest", ["mullins_softening"]),
        ("by friction", ["coulomb_friction", "hysteresis"]),
        ("by forward speed", ["direction_dependent_damping"]),
        ("by the square of the speed", ["quadratic_damping"]),
    ],
)
def test_a_share_of_the_elastic_force_of_a_tip_is_named_and_predicted(
    lost: str, names: list[str], power: float
) -> None:
    """As shares of a linear spring they got other names beside them, or were partly named."""
    answer = diagnose(_pressed(power, lost), "hunt-crossley", surface=0.0).answer
    assert sorted(answer["class"]) == [[name] for name in names]
    assert answer["effects"][0]["law"].endswith(OF_THE_SPRING)
    error = answer["error"]["std_normalised"]
    assert error["after"] < 0.3 * error["before"]


def test_a_layer_under_a_tip_is_named_with_the_power_that_it_has() -> None:
    """It was a power beside a ripple of a screw."""
    recording = _pressed(2.0, "nothing")
    layer = 3.0 * (np.maximum(recording.position - 0.5 * DEPTH_M, 0.0) / DEPTH_M) ** 2.0
    recording = from_arrays(
        "layer", DT_S * np.arange(layer.size), recording.position, recording.force + layer
    )
    answer = diagnose(recording, "hunt-crossley", surface=0.0).answer
    assert answer["class"] == [["second_layer"]]
    assert answer["error"]["after_over_floor"] < 1.1


def test_a_compliance_is_no_loss_of_a_steeper_spring_than_the_bodys() -> None:
    """The force that a compliance takes rises more steeply than the body's, at all times."""
    recording = _pressed(1.5, "nothing")
    depth = np.maximum(recording.position, 0.0)
    force, rigid = np.zeros(depth.size), 5.0 * (depth / DEPTH_M) ** 1.5
    for _ in range(300):  # to the balance of both; 0.15 mm give at 5 N
        pressed = np.maximum(depth - 0.03 * DEPTH_M * force, 0.0)
        force = 0.5 * force + 2.5 * (pressed / DEPTH_M) ** 1.5
    t = DT_S * np.arange(depth.size)
    recording = from_arrays("soft rig", t, recording.position, recording.force + force - rigid)
    softening = tuple(effect for effect in LIBRARY if effect.name == "softening")
    answer = diagnose(recording, "hunt-crossley", surface=0.0, effects=softening).answer
    assert (answer["verdict"], answer["class"]) == ("unexplained", [])


def test_a_tip_alone_misses_nothing() -> None:
    found = diagnose(_pressed(1.5, "nothing"), "hunt-crossley", surface=0.0).answer
    assert found["verdict"] == "no_missing_effect"


@pytest.mark.parametrize(("base", "with_power"), [("hunt-crossley", True), ("kelvin-voigt", False)])
def test_shares_follow_the_spring_that_the_base_has(base: str, with_power: bool) -> None:
    possible = applicable(LIBRARY, _pressed(1.5, "nothing"), base_of(base))
    laws = {(effect.name, effect.law) for effect in possible}
    assert (("softening", OF_THE_SPRING) in laws) is with_power
    assert (("softening", "") in laws) is not with_power


def test_a_law_that_no_other_of_its_name_is_like_needs_a_base_with_a_power_too() -> None:
    ours = next(effect for effect in LIBRARY if effect.law == OF_THE_SPRING)
    theirs, recording = (replace(ours, name="rust"),), _pressed(1.5, "nothing")
    assert applicable(theirs, recording, base_of("hunt-crossley")) == theirs
    assert applicable(theirs, recording, base_of("kelvin-voigt")) == ()


@pytest.mark.parametrize("base", ["hunt-crossley", "kelvin-voigt"])
def test_a_damping_by_direction_that_the_depth_does_not_change_stays_possible(base: str) -> None:
    possible = applicable(LIBRARY, _pressed(1.5, "nothing"), base_of(base))
    assert ("direction_dependent_damping", "in contact") in {(e.name, e.law) for e in possible}
