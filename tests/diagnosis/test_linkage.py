"""A weight on a linkage that a linear drive turns; positions of a drive count from any zero."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S = 2e-3
MASS, VISCOUS, ARM_M, TORQUE_N, NOISE_N = 0.4, 12.0, 0.03, 1.5, 0.03
SPRING_N_PER_M = 60.0


def strokes(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position [m], velocity and acceleration of 8 s of a motion of several tones."""
    rng = np.random.default_rng(seed)
    t = DT_S * np.arange(4000)
    x, v, a = np.zeros((3, t.size))
    for frequency_hz in (0.23, 0.61, 1.3, 2.9):
        w, phase = 2.0 * np.pi * frequency_hz, rng.uniform(0.0, 2.0 * np.pi)
        size = 0.02 / (1.0 + frequency_hz)
        x += size * np.sin(w * t + phase)
        v += size * w * np.cos(w * t + phase)
        a -= size * w * w * np.sin(w * t + phase)
    return x, v, a


def drive(seed: int, held: str, zero_m: float = 0.0) -> Recording:
    """Return a drive that moves a `linkage`, a `spring` or nothing else."""
    x, v, a = strokes(seed)
    force = MASS * a + VISCOUS * v + NOISE_N * np.random.default_rng(seed + 1).normal(size=x.size)
    if held == "linkage":
        force += TORQUE_N * np.sin(x / ARM_M + 0.4)
    elif held == "spring":
        force += SPRING_N_PER_M * x
    return from_arrays(held, DT_S * np.arange(x.size), x + zero_m, force)


@pytest.mark.parametrize("zero_m", [0.0, 0.3])
def test_the_weight_on_a_linkage_is_named_with_its_arm_wherever_zero_is(zero_m: float) -> None:
    answer = diagnose(drive(3, "linkage", zero_m), "mass-damper").answer
    assert answer["class"] == [["gravity_torque"]]
    (effect,) = answer["effects"]
    arm = effect["parameters"]["arm"]
    assert abs(arm["value"] - ARM_M) < 4.0 * arm["std"] < 0.1 * ARM_M
    assert abs(effect["parameters"]["torque"]["value"] - TORQUE_N) < 0.1 * TORQUE_N


def test_a_spring_that_holds_the_drive_is_named_a_spring_and_no_weight() -> None:
    answer = diagnose(drive(4, "spring"), "mass-damper").answer
    assert answer["class"] == [["return_spring"]]
    stiffness = answer["effects"][0]["parameters"]["spring_stiffness"]
    assert abs(stiffness["value"] - SPRING_N_PER_M) < 4.0 * stiffness["std"] < 1.0


def hung(seed: int, *, arm_m: float, torque_N: float, friction_N: float) -> Recording:
    """Return a light slide on a spring of 75 N/m, with a weight on a linkage, and dry friction."""
    x, v, _ = (0.5 * row for row in strokes(seed))
    force = 75.0 * x + 4.5 * v + 0.6 + torque_N * np.cos(x / arm_m + 0.7)
    force += friction_N * np.tanh(v / 2e-3)
    force += 0.01 * np.random.default_rng(seed + 1).normal(size=x.size)
    return from_arrays("hung", DT_S * np.arange(x.size), x + 0.05, force)


@pytest.mark.parametrize(
    ("arm_m", "friction_N"),
    cases((0.0066, 0.0), (0.0066, 0.2), (0.01, 0.2)),
)
def test_a_weight_is_named_beside_a_spring_that_holds_the_slide(
    arm_m: float, friction_N: float
) -> None:
    """Over most of a turn it looks like a contact with free air before it."""
    recording = hung(8, arm_m=arm_m, torque_N=0.9, friction_N=friction_N)
    answer = diagnose(recording, "spring,viscous,bias").answer
    names = ["coulomb_friction", "gravity_torque"] if friction_N else ["gravity_torque"]
    assert [sorted(found) for found in answer["class"]] == [names]
    values = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    assert values["arm"] == pytest.approx(arm_m, rel=0.03)
    assert values["torque"] == pytest.approx(0.9, rel=0.05)


def test_a_drive_without_a_weight_has_no_missing_effect() -> None:
    assert diagnose(drive(5, "nothing"), "mass-damper").answer["verdict"] == "no_missing_effect"


def pressing(seed: int, *, weight_N: float, layer_N_per_m: float = 0.0) -> Recording:
    """Return a probe that presses a gel and withdraws; a weight may hang on its linkage."""
    x, v, _ = strokes(seed)
    depth = x - 0.004
    body = 900.0 * depth + 8.0 * v + layer_N_per_m * np.maximum(depth - 0.006, 0.0) ** 1.5
    force = np.where(depth > 0.0, np.maximum(body, 0.0), 0.0)
    force += weight_N * np.sin(x / 0.012 + 0.9)
    force += NOISE_N * np.random.default_rng(seed + 1).normal(size=x.size)
    return from_arrays("pressing", DT_S * np.arange(x.size), x + 0.11, force)


@pytest.mark.parametrize("weight_N", cases(3.0, 1.0))
def test_a_weight_hides_no_contact_and_is_named_beside_it(weight_N: float) -> None:
    """The larger one pushes in free air where the force rises as from a surface."""
    answer = diagnose(pressing(6, weight_N=weight_N), "kelvin-voigt").answer
    assert answer["class"] == [["gravity_torque"]]
    stiffness = answer["base"]["parameters"]["k"]
    assert abs(stiffness["value"] - 900.0) < 4.0 * stiffness["std"] < 45.0


def test_a_weight_stands_in_for_no_bias_and_layer() -> None:
    recording = pressing(7, weight_N=0.0, layer_N_per_m=9000.0)
    biased = from_arrays(
        "biased",
        DT_S * np.arange(recording.position.size),
        recording.position,
        recording.force + 0.8,
    )
    assert ["force_bias", "second_layer"] in [
        sorted(names) for names in diagnose(biased, "kelvin-voigt").answer["class"]
    ]


@pytest.mark.parametrize("way", cases(1.0, -1.0))
def test_a_gas_spring_is_a_return_spring_whichever_way_it_is_compressed(way: float) -> None:
    """A polytropic column: it stiffens as no weight on a linkage does."""
    x, v, a = strokes(5)
    push = way * 4.0 * (1.0 - way * x / 0.05) ** -1.25
    force = (
        MASS * a + VISCOUS * v + push + 0.3 * NOISE_N * np.random.default_rng(6).normal(size=x.size)
    )
    answer = diagnose(
        from_arrays("gas", DT_S * np.arange(x.size), x + 0.2, force), "mass-damper"
    ).answer
    assert answer["class"] == [["return_spring"]]
    end = answer["effects"][0]["parameters"]["column_end"]
    assert end["value"] == pytest.approx(0.2 + way * 0.05, abs=0.004)
    assert answer["error"]["after_over_floor"] < 1.05
