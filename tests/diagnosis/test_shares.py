"""Shares of the effects of a set: they add up to that of the set."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.answers.shares import shapley, shares_of_members
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.samples.preparation import pose
from teleop_rt.recordings.recording import from_arrays


def test_players_that_can_stand_for_each_other_share_what_either_brings() -> None:
    worth = {frozenset(some): 1.0 for some in ("a", "b", "ab")} | {frozenset(): 0.0}
    assert [shapley(one, 2, worth) for one in "ab"] == [0.5, 0.5]


@pytest.mark.parametrize("names", [("force_bias",), ("force_bias", "tool_inertia"),
                                   ("force_bias", "tool_inertia", "force_drift")])  # fmt: skip
def test_shares_of_effects_add_up_to_one(names: tuple[str, ...]) -> None:
    """Those of a bias and a mass added up to 0.91, of other pairs to 1.84."""
    t = np.arange(3000) * 2e-3
    x = 0.002 - 0.006 * np.cos(2 * np.pi * 0.9 * t) + 0.001 * np.sin(2 * np.pi * 5.0 * t)
    a = np.gradient(np.gradient(x, t), t)
    force = 2200.0 * np.maximum(x, 0.0) + 4.4 + 0.9 * a
    force += 0.03 * np.random.default_rng(8).normal(size=t.size)
    problem, model = pose(from_arrays("made", t, x, force), base_of("kelvin-voigt"), 0.0)
    base = fit_base(problem, model)
    effects = tuple(map(find, names))
    start = np.array([shape.start for effect in effects for shape in effect.shapes])
    best = problem.refine(replace(base.model, effects=effects), start)
    shares = shares_of_members(problem, base, best)
    assert sum(shares) == pytest.approx(1.0)
    assert min(shares) >= 0.0
    if len(names) == 2:
        assert shares[0] > shares[1] > 0.0
