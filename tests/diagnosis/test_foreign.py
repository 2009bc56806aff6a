"""Recordings of a generator that shares nothing with the first, nor with the effect library."""

from __future__ import annotations

import pytest
from foreign_plants import Foreign, foreign

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.recording import from_arrays


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
    [(2031, "series_compliance"), (2105, "position_ripple"), (2114, "permanent_set")],
)
def test_an_effect_of_another_form_is_named_and_predicted_to_the_noise(
    seed: int, effect: str
) -> None:
    found = answer(foreign(seed, (effect,)))
    assert found["class"] == [[effect]]
    assert found["error"]["after_over_floor"] < 1.1
