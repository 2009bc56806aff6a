"""A spring that is held all along and hardens, whose positions count from any zero."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, SAMPLES = 4e-3, 2000
STIFFNESS_N_PER_M, VISCOUS_N_S_PER_M, STROKE_M, NOISE_N = 2500.0, 6.0, 4e-3, 0.03


def held(seed: int, law: str, zero_m: float) -> Recording:
    """Return 8 s of slow strokes of a spring: `even`, or with a law that bends it."""
    rng = np.random.default_rng(seed)
    t = DT_S * np.arange(SAMPLES)
    x, v = np.zeros((2, SAMPLES))
    for frequency_hz, share in ((0.31, 0.6), (0.83, 0.3), (2.1, 0.1)):
        w, phase = 2.0 * np.pi * frequency_hz, rng.uniform(0.0, 2.0 * np.pi)
        x += STROKE_M * share * np.sin(w * t + phase)
        v += STROKE_M * share * w * np.cos(w * t + phase)
    pull = STIFFNESS_N_PER_M * x
    if law == "cubic":
        pull *= 1.0 + 0.15 * (x / STROKE_M) ** 2
    elif law == "inwards":
        pull += 0.4 * np.expm1((x / STROKE_M + 1.0) / 0.8)
    elif law == "rubber":
        pull *= 1.0 + 0.03 * np.expm1(2.4 * (x / STROKE_M) ** 2)
    elif law == "layers":
        pull += 900.0 * np.sign(x) * np.maximum(np.abs(x) - 0.45 * STROKE_M, 0.0)
    elif law == "lump":
        pull += 3e4 * np.maximum(x - 0.1 * STROKE_M, 0.0) ** 1.5
    elif law == "taper":  # a dashpot that narrows along its stroke
        pull += 1e6 * (x + STROKE_M) * v * np.abs(v)
    elif law == "stop":
        pull += 900.0 * np.maximum(x - 0.3 * STROKE_M, 0.0)
    force = pull + VISCOUS_N_S_PER_M * v + 0.7 + NOISE_N * rng.normal(size=SAMPLES)
    return from_arrays(law, t, x + zero_m, force)


@pytest.mark.parametrize("zero_m", [0.0, -0.08])
@pytest.mark.parametrize("law", ["cubic", "inwards"])
def test_a_held_spring_that_hardens_is_named_stiffening(law: str, zero_m: float) -> None:
    answer = diagnose(held(11, law, zero_m), "spring,viscous,bias").answer
    assert answer["class"] == [["nonlinear_stiffening"]]
    # A cubic is not quite the exponential of the second law.
    assert answer["error"]["after"] < 1.2 * answer["error"]["noise_floor"]
    centre = answer["effects"][0]["parameters"]["centre"]
    if law == "cubic":
        assert abs(centre["value"] - zero_m) < 0.3 * STROKE_M


@pytest.mark.parametrize(
    ("law", "name"),
    [
        ("rubber", "nonlinear_stiffening"),
        *cases(("layers", "second_layer"), ("stop", "second_layer"), ("lump", "second_layer")),
        ("taper", "quadratic_damping"),
    ],
)
def test_no_ripple_stands_in_for_what_bends_a_held_spring(law: str, name: str) -> None:
    answer = diagnose(held(13, law, -0.02), "spring,viscous,bias").answer
    assert answer["class"] == [[name]]
    # A power is not quite the exponential of a square.
    assert answer["error"]["after"] < 1.5 * answer["error"]["noise_floor"]


def test_a_held_spring_that_is_even_misses_nothing() -> None:
    answer = diagnose(held(12, "even", 0.05), "spring,viscous,bias").answer
    assert answer["verdict"] == "no_missing_effect"
