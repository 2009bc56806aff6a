"""A recording that starts in contact: only its beginning may show that a body keeps a set."""

from __future__ import annotations

import numpy as np

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.recordings.recording import from_arrays

DT, NOISE_N = 2e-3, 0.02
K_N_PER_M, B_NS_PER_M, SURFACE_M = 1500.0, 12.0, 0.05


def pressed_first(share: float, steps_n: float = 0.0) -> Diagnosis:
    """Diagnose presses of which the first is the deepest and was begun before the recording.

    `share` of the deepest penetration stays. `steps_n` is a force that was there until the first
    release, of which the body knows nothing.
    """
    t = np.arange(0.0, 10.0, DT)
    x = 3e-3 * np.sin(2 * np.pi * 0.45 * t + 0.4) + 1e-3 * np.sin(2 * np.pi * 2.3 * t)
    x += np.where(t < 1.0, 2e-3 * np.sin(np.pi * np.minimum(t, 1.0)) ** 2, 0.0)
    gone = share * np.maximum.accumulate(np.maximum(x, 0.0))
    depth = x - gone
    force = np.where(depth > 0.0, K_N_PER_M * depth + B_NS_PER_M * np.gradient(x, DT), 0.0)
    released = int(np.argmax(depth < 0.0))
    force[: released // 2] += steps_n
    force += NOISE_N * np.random.default_rng(5).standard_normal(t.size)
    return diagnose(from_arrays("first", t, x + SURFACE_M, force), "kelvin-voigt")


def test_a_set_with_evidence_only_in_the_beginning_is_named_with_a_note() -> None:
    found = pressed_first(0.06)
    assert ["permanent_set"] in found.answer["class"]
    assert found.samples == "from the start"
    assert any("starts in contact" in note for note in found.answer["notes"])


def test_a_beginning_like_the_rest_gets_no_note() -> None:
    found = pressed_first(0.0)
    assert found.answer["verdict"] == "no_missing_effect"
    assert found.samples == "usual"
    assert not any("starts" in note for note in found.answer["notes"])


def test_an_unexplained_beginning_gets_a_note_and_no_name() -> None:
    found = pressed_first(0.0, steps_n=0.4)
    assert found.answer["verdict"] == "no_missing_effect"
    assert found.samples == "without an odd beginning"
