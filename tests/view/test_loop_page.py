"""The first sentence of a closed loop's page."""

from __future__ import annotations

from typing import Any

import pytest

from teleop_rt.view.loop_page import verdict

SAME = {"before": 0.084, "after": 0.083}
FELL = {"before": 0.084, "after": 0.004}
NONE = {"before": None, "after": None}


def _answer(free_run: Any, on_line: Any, felt: Any) -> dict[str, Any]:
    fresh = {"slave": {"free_run": free_run, "on_line": on_line}, "master": felt}
    return {
        "verdict": "named",
        "effects": [{"name": "force_bias"}],
        "withdrawn": [],
        "fresh": fresh,
    }


@pytest.mark.parametrize(
    ("errors", "grade"),
    [((FELL, FELL, NONE), "good"), ((SAME, FELL, NONE), "good"), ((SAME, SAME, NONE), "attention")],
)
def test_an_effect_that_leaves_every_error_as_it_was_asks_for_a_look(
    errors: Any, grade: str
) -> None:
    assert verdict(_answer(*errors))[0] == grade


def test_nothing_missing_is_no_reason_to_worry() -> None:
    answer = {"verdict": "no_missing_effect", "effects": [], "withdrawn": [], "fresh": None}
    assert verdict(answer)[0] == "good"
