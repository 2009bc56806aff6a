"""A base that damps in one direction only, on a body that damps in both."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import Recording, from_arrays


def pressed(withdrawing: float) -> Recording:
    """A body that never pulls, with a damping of which this share acts while it is left."""
    rng = np.random.default_rng(3)
    t = 2e-3 * np.arange(4000)
    swing = np.sin(2 * np.pi * 0.7 * t) + 0.4 * np.sin(2 * np.pi * 2.3 * t)
    x = 3e-3 * swing * np.minimum(t, 1.0)
    v = np.gradient(x, t)
    push = 2000.0 * x + 30.0 * np.where(v > 0.0, v, withdrawing * v)
    force = np.where(x > 0.0, np.maximum(push, 0.0), 0.0)
    return from_arrays("body", t, x, force + 0.02 * rng.standard_normal(t.size))


@pytest.mark.parametrize(("withdrawing", "said"), [(1.0, True), (0.0, False)])
def test_a_base_that_needs_fewer_effects_is_reported(withdrawing: float, said: bool) -> None:
    base = "kelvin-voigt-unilateral" if said else "kelvin-voigt"
    other = "kelvin-voigt" if said else "kelvin-voigt-unilateral"
    answer = diagnose(pressed(withdrawing), base, surface=0.0).answer
    notes = [note for note in answer["notes"] if f"--base {other}" in note]
    assert len(notes) == 1
    assert "without any effect" in notes[0]


def test_the_right_base_with_a_missing_effect_gets_no_such_note() -> None:
    recording = pressed(1.0)
    biased = from_arrays("bias", 2e-3 * np.arange(4000), recording.position, recording.force + 0.8)
    answer = diagnose(biased, "kelvin-voigt", surface=0.0).answer
    assert answer["class"] == [["force_bias"]]
    assert not [note for note in answer["notes"] if "--base" in note]
