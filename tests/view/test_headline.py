"""The first sentence of a run's page."""

from __future__ import annotations

from typing import Any

import pytest

from teleop_rt.view.headline import verdict
from teleop_rt.view.html import Tile


def _summary(**more: Any) -> dict[str, Any]:
    return {"safety": {"fault": {"code": 0}, "state": "DISARMED"}, "notes": [], **more}


@pytest.mark.parametrize("code", [0, 7])
def test_a_recording_that_lacks_a_part_is_never_said_to_have_run_to_its_end(code: int) -> None:
    summary = _summary()
    summary["safety"]["fault"] |= {"code": code, "cause": "too hot", "next_step": "cool it"}
    grade, text = verdict(summary, [], "The recording is cut off.")
    assert grade == ("bad" if code else "attention")
    assert text.endswith("The recording is cut off.")
    assert ("Stopped: too hot." in text) == bool(code)


@pytest.mark.parametrize("grade", ["good", "attention"])
def test_a_run_that_was_interrupted_did_not_run_to_its_end(grade: str) -> None:
    tiles = [Tile("Loop", grade, "", ())]
    assert verdict(_summary(interrupted=True), tiles)[1].startswith("Interrupted without a fault")
    assert "to its end" in verdict(_summary(), tiles)[1]
