"""A sensor that gave no force for a while: a gap, and no effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.answers.errors import HeldOut
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Problem
from teleop_rt.diagnosis.noise.whiten import white
from teleop_rt.diagnosis.samples.dropouts import dropouts
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.recordings.recording import from_arrays

T = np.arange(10_000) * 1e-3
X = 1e-3 + 3e-3 * np.sin(2 * np.pi * 0.55 * T) + 1e-3 * np.sin(2 * np.pi * 2.3 * T + 1.0)
DEEP = np.flatnonzero((X[:-1] <= 3e-3) & (X[1:] > 3e-3)).tolist()


def lost(
    dry_n: float, times: list[slice], effects: tuple[Effect, ...] = LIBRARY
) -> dict[str, object]:
    """Diagnose presses of 2000 N/m by a tool with dry friction whose sensor reads 0 for a while."""
    t, x = T, X
    v = np.gradient(x, t)
    force = np.where(x > 0.0, 2000.0 * x + 8.0 * v, 0.0) + dry_n * np.tanh(v / 1e-3)
    force += 0.02 * np.random.default_rng(6).standard_normal(t.size)
    for stretch in times:
        force[stretch] = 0.0
    recording = from_arrays("lost", t, 1e-6 * np.round(x / 1e-6), force)
    return diagnose(recording, surface=0.0, effects=effects).answer


@pytest.mark.parametrize(("dry_n", "named"), [(0.0, []), (0.3, [["coulomb_friction"]])])
def test_a_sensor_that_drops_out_once_leaves_a_gap_that_is_reported(
    dry_n: float, named: list[list[str]]
) -> None:
    first = DEEP[3]
    answer = lost(dry_n, [slice(first, first + 50)])
    assert answer["class"] == named
    assert answer["gaps"]["count"] == 1
    assert 50 <= answer["gaps"]["samples"] < 80
    start = f"from {T[first]:.1f}"
    assert any(note.startswith(start) and "drop out" in note for note in answer["notes"])
    assert answer["error"]["after_over_floor"] < 1.1


@pytest.mark.parametrize(("times", "gaps"), [(1, 1), (3, 3), (5, 0)])
def test_repeated_stretches_are_no_dropout(times: int, gaps: int) -> None:
    depth = np.maximum(X, 0.0)
    force = 2000.0 * depth + 0.02 * np.random.default_rng(6).standard_normal(T.size)
    lost_at = [slice(first, first + 50) for first in DEEP[3 : 3 + times]]
    whole = problem_of(from_arrays("whole", T, X, force), base_of("kelvin-voigt"), 0.0)
    fit = fit_base(whole, base_of("kelvin-voigt"))
    for stretch in lost_at:
        force[stretch] = 0.0
    found = dropouts(replace(whole, force=force), fit)
    assert len(found) == gaps
    assert all(f <= s.start and p >= s.stop for (f, p), s in zip(found, lost_at, strict=False))


@pytest.mark.parametrize("clump", [6, 7, 8, 9])
def test_outliers_that_lie_close_are_no_dropout(clump: int) -> None:
    """Of eleven samples six to nine jump, none to one value: for a sample or few most are off."""
    depth, rng = np.maximum(X, 0.0), np.random.default_rng(clump)
    force = 2000.0 * depth + 0.02 * rng.standard_normal(T.size)
    whole = problem_of(from_arrays("whole", T, X, force), base_of("kelvin-voigt"), 0.0)
    fit = fit_base(whole, base_of("kelvin-voigt"))
    off = DEEP[3] + 2 + np.sort(rng.permutation(11)[:clump])
    force[off] += rng.uniform(2.0, 6.0, clump) * rng.choice([-1.0, 1.0], clump)
    assert dropouts(replace(whole, force=force), fit) == []


def test_a_force_with_repeated_dropouts_has_no_gap() -> None:
    """Whatever it is, it is not left out: something is there that the base does not explain."""
    answer = lost(0.0, [slice(first, first + 40) for first in DEEP], effects=())
    assert answer["gaps"]["count"] == 0
    assert answer["verdict"] != "no_missing_effect"


def test_a_sample_that_does_not_count_is_not_filtered_into_those_that_do() -> None:
    t = 1e-3 * np.arange(4000)
    predicted = np.sin(7.0 * t)
    force, where = predicted.copy(), np.ones(t.size)
    force[2000:2040], where[2000:2040] = 30.0, 0.0
    problem = Problem(RecordedMotion(t, t, t, t, 1e-3), force, white(where, 0.01, 1e-3))
    errors = HeldOut("held-out blocks", problem, 0.5 * predicted, predicted, where, 0.01).errors
    smooth = errors["std_normalised_low_passed"]
    assert smooth["after"] == pytest.approx(errors["std_normalised"]["after"], abs=1e-9)
    assert smooth["before"] < 0.5


def test_a_layer_that_a_single_press_reaches_is_no_dropout() -> None:
    t, x = T, X.copy()
    deepest = T[int(np.argmax(X[4000:6000])) + 4000]
    x += 3e-3 * np.exp(-0.5 * ((T - deepest) / 0.15) ** 2)
    v, layer = np.gradient(x, t), np.maximum(x - 5e-3, 0.0)
    force = np.where(x > 0.0, 2000.0 * x + 8.0 * v, 0.0) + 3e4 * layer + 18.0 * v * (layer > 0.0)
    force += 0.02 * np.random.default_rng(6).standard_normal(t.size)
    answer = diagnose(from_arrays("layer", t, 1e-6 * np.round(x / 1e-6), force), surface=0.0).answer
    assert "second_layer" in {name for names in answer["class"] for name in names}
    assert answer["gaps"]["count"] == 0
