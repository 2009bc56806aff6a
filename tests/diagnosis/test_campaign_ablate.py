"""The ablation of diagnosis: a gate is left out everywhere, and put back."""

from __future__ import annotations

import importlib
import inspect
from typing import Any

import numpy as np
import pytest

from teleop_rt.diagnosis.inference import explanation, ranking, unsupported
from teleop_rt.diagnosis.samples.smoothing import half_window
from teleop_rt_dev.campaign import ablate as campaign
from teleop_rt_dev.diagnosis.replaced import always, instead, watched


def test_a_gate_is_left_out_wherever_it_was_imported_and_put_back() -> None:
    before = unsupported.lacks_named_property
    with instead("inference.unsupported:lacks_named_property", always(lambda *_: "left out")):
        for module in (unsupported, ranking):
            assert module.lacks_named_property(None, None, None) == "left out"
    for module in (unsupported, ranking):
        assert module.lacks_named_property is before


@pytest.mark.parametrize("gate", campaign.GATES)
def test_every_gate_is_a_function_of_diagnosis(gate: str) -> None:
    path, without = campaign.GATES[gate]
    found: list[Any] = []
    with instead(path, lambda function: found.append(function) or without):
        pass
    assert all(function.__module__.startswith("teleop_rt.diagnosis") for function in found)
    assert found
    inspect.signature(without).bind(*inspect.signature(found[0]).parameters)


@pytest.mark.parametrize(
    ("result", "plain", "acts"),
    [
        (True, False, True), (False, False, False), (0.0, 0.0, False), (1.5, 0.0, True),
        ([], [], False), ([1], [], True), (np.zeros(3), 0.0, False), (np.ones(3), 0.0, True),
        (None, None, False), ("fit", None, True),
    ],
)  # fmt: skip
def test_a_gate_acts_where_it_differs_from_its_replacement(
    result: Any, plain: Any, acts: bool
) -> None:
    flags: list[bool] = []
    gate = watched(always(plain), flags)(always(result))
    assert gate() is result
    assert bool(flags) is acts


def test_constants_are_tried_at_half_and_at_twice_and_put_back() -> None:
    seen: list[float] = []

    def judged(*_: Any) -> Any:
        seen.append(explanation.UNKNOWN_DIRECTIONS)
        return explanation.Explanation("unexplained", (), None, {})

    before = explanation.UNKNOWN_DIRECTIONS
    changed = campaign.by_constants([(judged, (), {})])
    assert set(seen) == {before, 0.5 * before, 2.0 * before}
    assert before == explanation.UNKNOWN_DIRECTIONS
    assert not any(flag for flags in changed.values() for flag in flags)


@pytest.mark.parametrize("name", campaign.ELSEWHERE)
def test_a_constant_outside_the_judgement_is_halved_and_doubled_and_put_back(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """A diagnosis reads it again: its module's own functions read it, and no kernel does."""
    module, _, constant = name.partition(":")
    owner = importlib.import_module(f"teleop_rt.{module}")
    before, seen = getattr(owner, constant), []

    def answered(_case: Any) -> tuple[str, int]:
        seen.append(getattr(owner, constant))
        return str(seen[-1]), 0

    monkeypatch.setattr(campaign, "answered", answered)
    found = campaign.ablated(("drawn", {}), [], [name])
    assert seen == [before, *(type(before)(round(f * before, 9)) for f in (0.5, 2.0))]
    assert [one["changed"] for one in found["elsewhere"][name].values()] == [True, True]
    assert getattr(owner, constant) == before
    readers = [f for f in vars(owner).values() if constant in names_in(f)]
    assert readers
    assert not any(hasattr(reader, "py_func") for reader in readers)
    assert campaign.show([found], [], [name]).count(f"| {name} |") == 2


def names_in(function: Any) -> tuple[str, ...]:
    """Return the names of the module that a function reads, compiled or not."""
    plain = getattr(function, "py_func", function)
    code = getattr(plain, "__code__", None)
    return () if code is None else code.co_names


def test_constants_outside_the_judgement_are_tried_only_on_request() -> None:
    assert campaign.named(None) == []
    assert campaign.named([]) == list(campaign.ELSEWHERE)
    assert campaign.named(["EXTENDED", "held:"]) == [
        "diagnosis.inference.one_more:EXTENDED", "diagnosis.samples.held:_REPEATED",
    ]  # fmt: skip


def test_a_window_that_is_remembered_does_not_hide_that_its_gate_is_left_out() -> None:
    """The second diagnosis of a record found the window of the first in a cache."""
    t = np.arange(4000) * 1e-2
    position = np.sin(0.4 * t) + 0.01 * np.random.default_rng(1).standard_normal(t.size)
    path, without = campaign.GATES["window by the spectrum"]
    wide = half_window(position, 1e-2)
    with instead(path, always(without)):
        assert half_window(position, 1e-2) < wide
    assert half_window(position, 1e-2) == wide
