"""Recordings of a generator that shares nothing with the first, nor with the effect library."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.foreign_laws import H, elasto_plastic
from teleop_rt_dev.diagnosis.foreign_plants import Foreign, foreign, recorded
from teleop_rt_dev.diagnosis.foreign_rigs import rig


def answer(record: Foreign) -> dict[str, object]:
    recording = from_arrays("f", record.t, record.position, record.force, units=record.units)
    return diagnose(recording, record.base, surface=0.0).answer


@pytest.mark.parametrize("seed", [1005, 1046])
def test_nothing_is_missing_in_a_quiet_recording_of_a_fast_motion(seed: int) -> None:
    found = answer(foreign(seed))
    assert found["verdict"] == "no_missing_effect"
    assert found["error"]["after_over_floor"] < 1.1


@pytest.mark.parametrize(
    ("seed", "effect"),
    [
        (2031, "series_compliance"),
        (2105, "position_ripple"),
        (2114, "permanent_set"),
        (198557227, "force_lag"),  # its form had been misnamed
        (564964177, "moving_surface"),  # as above
        *cases(
            (264811030, "hysteresis"),  # slips bit by bit: had got a second name
            (2146696779, "hysteresis"),  # as above: had been unexplained
        ),
    ],
)
def test_an_effect_of_another_form_is_named_and_predicted_to_the_noise(
    seed: int, effect: str
) -> None:
    found = answer(foreign(seed, (effect,)))
    assert found["class"] == [[effect]]
    assert found["error"]["after_over_floor"] < 1.1


def test_a_bias_far_above_slow_noise_is_named() -> None:
    """The remainder of filters at each touch had drowned it."""
    assert answer(foreign(65156946, ("force_bias",)))["class"] == [["force_bias"]]


@pytest.mark.parametrize(
    ("seed", "effect"),
    [
        *cases(
            (2005619774, "moving_surface"),  # a damper's jumps hid its gain
            (806196185, "moving_surface"),  # as above
        ),
        *cases(
            (1018553798, "second_layer"),  # from a base that lies askew a wrong law promised more
            (404417601, "adhesion"),  # as above
        ),
    ],
)
def test_an_effect_is_named_by_its_own_descent_where_the_surface_had_to_be_found(
    seed: int, effect: str
) -> None:
    """Seen from where the base came to lie the right law gains little, or less than a wrong one."""
    record = foreign(seed, (effect,))
    recording = from_arrays("axis", record.t, record.position - 0.0123, record.force)
    assert diagnose(recording, record.base).answer["class"] == [[effect]]


def test_a_body_that_stiffens_is_not_one_that_was_worn_deeper_than_it_is_pressed() -> None:
    """Such wear never shows: its law is then that of a spring, and bends after any other."""
    record = foreign(130439201, ("nonlinear_stiffening",))
    recording = from_arrays("axis", record.t, record.position - 0.1668, record.force)
    assert diagnose(recording, record.base).answer["class"] == [["nonlinear_stiffening"]]


def rubbed(motion: str, forward: float, backward: float, bias: float) -> dict[str, object]:
    """Answer for a guide with dry friction (after Dupont) and a bias, as shares of the force."""
    rng = np.random.default_rng(4)
    r = rig(rng, "kelvin-voigt", motion, 11.0, 0.3)
    slid = elasto_plastic(np.gradient(r.x, H), 1.0, 1000.0 / r.depth, 0.6)
    friction = np.where(slid > 0.0, forward * slid, backward * slid)
    force = recorded(r.force() + r.k * r.depth * (friction + bias), 10)
    noisy = force + 0.01 * np.std(force) * rng.standard_normal(force.size)
    x = recorded(r.x, 10)
    found = diagnose(from_arrays("r", recorded(r.t, 10), x, noisy), "kelvin-voigt", surface=0.0)
    return found.answer | {"level": r.k * r.depth}


def test_dry_friction_that_differs_by_direction_is_found_with_both_its_sizes() -> None:
    found = rubbed("strokes", 0.06, 0.04, 0.0)
    assert found["class"][0] == ["coulomb_friction"]
    size, ratio = (
        found["effects"][0]["parameters"][key]["value"]
        for key in ("friction_force", "backward_ratio")
    )
    assert size / found["level"] == pytest.approx(0.06, rel=0.05)
    assert ratio == pytest.approx(2.0 / 3.0, rel=0.05)


def test_friction_by_direction_does_not_hide_a_bias_beside_even_friction() -> None:
    moving = rubbed("tones", 0.05, 0.05, 0.02)
    assert moving["verdict"] in {"named", "class"}
    assert ["coulomb_friction", "force_bias"] in map(sorted, moving["class"])
    assert rubbed("tones", 0.0, 0.0, 0.02)["class"] == [["force_bias"]]


def test_a_recording_that_starts_pressed_is_not_judged_by_what_came_before_it() -> None:
    found = answer(foreign(1775732689, ("nonlinear_stiffening",), motion="ramps", air=-0.964,
                           noise=0.0012, size=0.177, seconds=10.0))  # fmt: skip
    assert ["nonlinear_stiffening"] in found["class"]


@pytest.mark.parametrize(
    ("seed", "effect", "drawn"),
    [
        # Its swing is descended to the end by pairs only, whose second member then does nothing.
        (939699338, "moving_surface", {"size": 0.06816602309306365, "noise": 0.0137663574681684,
                                       "air": 0.3388408865619146}),
        # The encoder's errors at each touch are louder than friction, but not like it.
        (1300527629, "coulomb_friction", {"size": 0.062124795088101856,
                                          "noise": 0.021475887264269463,
                                          "air": -0.2901191367641509}),
    ],
)  # fmt: skip
def test_a_narrow_motion_shows_one_effect_as_one(
    seed: int, effect: str, drawn: dict[str, float]
) -> None:
    record = foreign(seed, (effect,), motion="two tones", seconds=10.0, **drawn)
    assert answer(record)["class"] == [[effect]]
