"""The first sentence of a run's page."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from teleop_rt.config.section import Units
from teleop_rt.view.headline import felt, verdict
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


PASSIVITY = {
    "stiffness": {"true": 8600.0, "rendered": 6680.0},
    "damping": {"true": 20.0, "rendered": 15.8},
}
FELT = {
    "nrmse": 0.1,
    "lag_ms": 0.001,
    "direct_reflection_lag_ms": 156.8,
    "worst": {"phantom_force": 0.433, "phantom_s": 5.6},
    "offset": {"largest": 9.0266e-3, "largest_s": 1.0, "at_end": 1.6e-3},
    "rendering": {"passivity": PASSIVITY},
}


SENTENCES = """\
the felt force lags by less than 0.01 ms; the slave's force, reflected, would lag by 156.8 ms
error and lag compare it with the force of the true environment, in converged contact
the hand felt up to 0.433 N where the true environment gives none, at 5.6 s
the wall was felt up to 9.03 mm from its true place, at 1.0 s, and 1.6 mm at the end
this device can render at most 6680 N/m of the wall's 8600 N/m, its damping included: a stiffer \
wall would not be passive on it
this device can render at most 15.8 N s/m of the wall's damping of 20 N s/m: with more, beside \
its stiffness, the wall would not be passive on it
""".splitlines()


def lines(**more: Any) -> tuple[str, ...]:
    run: Any = SimpleNamespace(
        summary={"master": FELT | more}, units=Units(position="m", force="N")
    )
    return felt(run, "attention").lines


def test_the_force_under_the_hand_is_described_in_whole_sentences() -> None:
    assert list(lines()) == SENTENCES


def test_what_is_not_known_of_a_felt_force_is_no_dash() -> None:
    worst = {"phantom_force": 0.0, "phantom_s": None}
    said = lines(lag_ms=None, direct_reflection_lag_ms=None, worst=worst, offset=None)
    assert said[0] == "the lag of the felt force is not known"
    assert said[2] == "the hand felt no force where the true environment gives none"
