"""Sampling and rounding are no effects: gaps, steps of the encoder, a clamp that hides."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.contact.effects import LIBRARY, find
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.needed import needed_sets
from teleop_rt.diagnosis.inference.ranking import Ranking
from teleop_rt.diagnosis.inference.screening import screen
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.noise.encoder import input_errors
from teleop_rt.diagnosis.noise.structure import lack_of_fit, tangent_space
from teleop_rt.diagnosis.samples.preparation import problem_of, without_impacts
from teleop_rt.recordings.recording import from_arrays

STEP_M = 5e-6
LAG_S = 8e-3


def pressed(noise: float, lag: float = 0.0) -> tuple[np.ndarray, ...]:
    """Return time, position and force of a contact that never pulls, 2000 N/m and 20 N s/m."""
    t = np.arange(4000) * 1e-3

    def place(at: np.ndarray) -> np.ndarray:
        fast = 1e-3 * np.sin(2 * np.pi * 5.3 * at)
        return 2e-3 - 4e-3 * np.cos(2 * np.pi * 0.9 * at) + fast

    x, v = place(t - lag), np.gradient(place(t - lag), t)
    force = np.where(x > 0.0, np.maximum(2000.0 * x + 20.0 * v, 0.0), 0.0)
    return t, place(t), force + noise * np.random.default_rng(11).standard_normal(t.size)


@pytest.mark.parametrize("off", [-0.9, 0.9])
def test_a_surface_given_to_a_step_of_the_encoder_is_not_off(off: float) -> None:
    t, x, force = pressed(noise=0.01)
    recording = from_arrays("rounded", t, STEP_M * np.round(x / STEP_M), force)
    assert diagnose(recording, surface=off * STEP_M).answer["verdict"] == "no_missing_effect"


def test_a_surface_that_is_some_steps_off_is_named() -> None:
    t, x, force = pressed(noise=0.01)
    recording = from_arrays("off", t, STEP_M * np.round(x / STEP_M), force)
    assert diagnose(recording, surface=-4.0 * STEP_M).answer["class"][0] == ["contact_offset"]


def test_a_bend_hidden_by_a_gap_is_no_effect() -> None:
    t, x, force = pressed(noise=0.01)
    keep = np.ones(t.size, dtype=bool)
    for gap in (700, 1500, 2600, 3100):
        keep[gap : gap + 60] = False
    recording = from_arrays("gaps", t[keep], STEP_M * np.round(x / STEP_M)[keep], force[keep])
    assert diagnose(recording, surface=0.0).answer["verdict"] == "no_missing_effect"


def test_a_late_force_is_seen_where_the_base_alone_takes_the_contact_to_pull() -> None:
    t, x, force = pressed(noise=0.01, lag=LAG_S)
    base = base_of("kelvin-voigt")
    problem = problem_of(from_arrays("late", t, x, force), base, 0.0)
    unclamped = problem.solve(CandidateModel(base), np.zeros(0))
    (start,) = screen(problem, unclamped, (find("channel_delay"),))
    assert start.model.clamp == "base"
    assert start.gain > 0.8 * unclamped.chi2
    assert abs(start.zeta[0] - LAG_S) < 2e-3


def test_a_play_found_on_its_unloading_flank_is_nothing_but_a_play() -> None:
    t, x, _ = pressed(noise=0.0)
    tip = x.copy()
    for i in range(1, x.size):
        tip[i] = min(max(tip[i - 1], x[i] - 3e-4), x[i])
    v = np.gradient(tip, t)
    force = np.where(tip > 0.0, np.maximum(2000.0 * tip + 20.0 * v, 0.0), 0.0)
    force += 0.02 * np.random.default_rng(5).standard_normal(t.size)
    recording = from_arrays("play", t, STEP_M * np.round(x / STEP_M), force)
    assert diagnose(recording, surface=0.0).answer["class"] == [["backlash"]]


def test_a_second_effect_must_exceed_the_firsts_encoder_errors() -> None:
    """A tool's mass passes errors of the encoder on that the spring of the base does not."""
    t, x, force = pressed(noise=0.005)
    force += 0.5 * np.gradient(np.gradient(x, t), t)
    recording = from_arrays("heavy", t, STEP_M * np.round(x / STEP_M), force)
    base = base_of("kelvin-voigt")
    problem = problem_of(recording, base, 0.0)
    errors = input_errors(problem.motion, recording)
    rank = Ranking(problem, fit_base(problem, base), errors, STEP_M)
    model = CandidateModel(base, (find("tool_inertia"),), clamp="base")
    heavy = rank(problem.solve(model, np.zeros(0)))
    assert rank.floor_of(heavy.fit) > 5.0 * rank.floor
    left = lack_of_fit(problem, rank.base, tangent_space(problem, rank.base))
    assert needed_sets(rank, left, [heavy], LIBRARY) == ([], [heavy])


@pytest.mark.parametrize(("mass", "step"), [(0.3, 2e-5), (0.5, 1e-5), (2.0, 1e-5)])
def test_a_heavy_tool_is_not_excluded_by_errors_of_a_coarse_encoder(
    mass: float, step: float
) -> None:
    """A tone as fast as the motion makes nothing of it, and was named alone for that."""
    t, x, force = pressed(noise=0.01)
    force += mass * np.gradient(np.gradient(x, t), t)
    recording = from_arrays("heavy", t, step * np.round(x / step), force)
    found = diagnose(recording, surface=0.0).answer["class"]
    assert ["tool_inertia"] in found
    assert all(names in (["tool_inertia"], ["periodic_disturbance"]) for names in found)


def test_each_rest_of_a_coarse_encoder_has_an_error_of_its_own() -> None:
    """Held at a reading, the tool is anywhere within its step, and elsewhere at the next."""
    t = np.arange(9000) * 1e-3
    levels = np.repeat(np.arange(1, 10) * 37.3 * STEP_M, 1000)
    x = np.convolve(np.pad(levels, 100, mode="edge"), np.full(201, 1 / 201), "valid")
    read = STEP_M * np.round(x / STEP_M)
    recording = from_arrays("held", t, read, 2000.0 * x)
    motion = problem_of(recording, base_of("kelvin-voigt"), 0.0).motion
    held = slice(500, None, 1000)
    errors = np.array([row.x[held] - motion.x[held] for row in input_errors(motion, recording)])
    among_rests = float(np.mean(np.std(errors, axis=1)))
    assert among_rests == pytest.approx(STEP_M / np.sqrt(12.0), rel=0.3)


def test_a_damper_that_the_base_lacks_is_no_damping_by_direction() -> None:
    """A power law's damper fades at the surface; the body's does not, in neither direction."""
    t, x, force = pressed(noise=0.01)
    recording = from_arrays("plain", t, STEP_M * np.round(x / STEP_M), force)
    answer = diagnose(recording, "hunt-crossley", surface=0.0).answer
    assert (answer["verdict"], answer["class"]) == ("unexplained", [])


def test_samples_dropped_one_by_one_are_no_effect() -> None:
    t = np.arange(2400) * 5e-3
    x = 6e-3 + 9e-3 * np.sin(2 * np.pi * 1.1 * t) + 2e-3 * np.sin(2 * np.pi * 3.7 * t)
    v = np.gradient(x, t)
    force = np.where(x > 0.0, 600.0 * x + 3.0 * v + 0.9 * np.gradient(v, t), 0.0)
    rng = np.random.default_rng(13)
    force += 0.01 * rng.standard_normal(t.size)
    read, kept = 1e-6 * np.round(x / 1e-6), rng.uniform(size=t.size) > 0.03
    recording = from_arrays("dropped", t[kept], read[kept], force[kept])
    assert np.mean(np.abs(recording.position - read) > 2e-6) < 0.005
    answer = diagnose(recording, "mass-spring-damper", surface=0.0).answer
    assert answer["verdict"] == "no_missing_effect"


def test_a_pull_without_evidence_is_not_named() -> None:
    """A sensor that reads the first newton of force as none: nothing pulls."""
    t, x, force = (row[::2] for row in pressed(noise=0.0))
    measured = np.maximum(force - 1.0, 0.0) + 0.01 * np.random.default_rng(9).standard_normal(
        t.size
    )
    recording = from_arrays("dead", t, STEP_M * np.round(x / STEP_M), measured)
    answer = diagnose(recording, surface=0.0).answer
    assert ["adhesion"] not in answer["class"]
    assert answer["verdict"] != "no_missing_effect"


def struck(tip: np.ndarray, size: float = 0.05) -> np.ndarray:
    """Return the force of a spring behind a play, whose closings ring by a size [N]."""
    closes = np.diff((np.abs(np.diff(tip, prepend=tip[0])) > 0.0).astype(float), prepend=0.0) > 0.0
    force = 5000.0 * tip + 0.01 * np.random.default_rng(6).standard_normal(tip.size)
    for late, ring in enumerate((0.6, 1.0, 0.6, -0.4, -0.8, -0.4)):
        force += size * ring * np.roll(closes, late)
    return force


def test_only_the_ends_of_a_play_are_left_out_as_impacts() -> None:
    """A hand that hardly moves stays within the play, where the slip follows the drive's speed."""
    t = 0.01 * np.arange(2000)
    x = 1.5e-3 + 2e-4 * np.sin(2.0 * t) + 2e-5 * np.sin(11.0 * t)
    force = 5000.0 * x + 0.01 * np.random.default_rng(6).standard_normal(t.size)
    base = base_of("kelvin-voigt")
    problem = problem_of(from_arrays("within the play", t, x, force), base, 0.0)
    model = CandidateModel(base, (find("backlash"),))
    fit = problem.solve(model, np.array([3e-4]))
    before, after = (
        np.count_nonzero(p.whitener.mask) for p in (problem, without_impacts(problem, [fit]))
    )
    closings = 2 * round(2.0 * t[-1] / (2.0 * np.pi))
    assert 0.8 * before < after < before - closings


def test_the_ends_of_a_play_that_opens_at_no_force_are_left_out_too() -> None:
    t = 0.01 * np.arange(2000)
    x = 1e-3 * np.sin(2.0 * t) + 2e-5 * np.sin(11.0 * t)
    tip = x - np.clip(x, -2e-4, 2e-4)
    base = base_of("spring,viscous,bias")
    problem = problem_of(from_arrays("slack", t, x, struck(tip)), base, 0.0)
    [law] = (e for e in LIBRARY if e.acts == "slackens" and e.name == "backlash")
    fit = problem.solve(CandidateModel(base, (law,)), np.array([1.0]), np.array([5000.0, 0.0, 0.0]))
    spared = without_impacts(problem, [fit]).whitener.mask
    left_out = (problem.whitener.mask > 0.0) & (spared == 0.0)
    edges = np.flatnonzero(np.diff(np.abs(x) < 2e-4))
    nearest = np.min(np.abs(np.flatnonzero(left_out)[:, None] - edges[None, :]), axis=1)
    assert np.count_nonzero(left_out) >= edges.size
    assert np.max(nearest) < 10
    quiet = problem_of(from_arrays("quiet", t, x, struck(tip, size=0.0)), base, 0.0)
    assert np.array_equal(without_impacts(quiet, [fit]).whitener.mask, quiet.whitener.mask)


def test_a_play_that_explains_little_leaves_no_samples_out() -> None:
    """Beside a friction it took a third of the samples of this motion, whatever it explained."""
    t = 1e-3 * np.arange(6000)
    tones = ((1.3, 1e-3, 0.1), (5.1, 5e-4, 1.0), (13.0, 2e-4, 2.0), (31.0, 6e-5, 0.5))
    x = sum((a * np.sin(2.0 * np.pi * f * t + phase) for f, a, phase in tones), np.zeros(t.size))
    turned, friction = 0.0, np.empty(t.size)
    for i, moved in enumerate(np.diff(x, prepend=x[0]).tolist()):
        turned += moved / 6e-5 * (1.0 - turned * np.sign(moved))
        friction[i] = 0.9 * turned
    force = 2500.0 * x + 18.0 * np.gradient(x, t) + friction
    force += 0.03 * np.random.default_rng(5).standard_normal(t.size)
    found = diagnose(from_arrays("rubs", t, np.round(x / 1e-7) * 1e-7, force))
    assert found.answer["class"] == [["coulomb_friction"]]
    assert np.mean(found.problem.whitener.mask > 0.0) > 0.95
