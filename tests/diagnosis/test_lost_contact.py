"""Samples beyond the surface at which the tool does not touch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.answers.notes import of_lost_contact
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.samples.lost_contact import without_contact
from teleop_rt.diagnosis.samples.preparation import pose
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.recording import from_arrays

DT_S, NOISE_N = 1e-3, 0.05


def pressed(*, sticks: float, offset: float = 0.0) -> tuple[np.ndarray, ...]:
    """Return force, x, v and where it touches: a spring that lets go `sticks` before the surface.

    It is met again where it let go of the tool; `offset` is the sensor's reading in free air.
    """
    t = np.arange(4000) * DT_S
    x = 0.004 - 0.006 * np.cos(2 * np.pi * t)
    v = np.gradient(x, DT_S)
    touches = x > np.where(t < 0.5, 0.0, sticks)
    force = np.where(touches, 3600.0 * (x - np.where(t < 0.5, 0.0, sticks)), 0.0)
    noise = NOISE_N * np.random.default_rng(5).normal(size=t.size)
    return force + noise + offset, x, v, touches


def pressing(touches: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return where the tool clearly presses, and does so a sample before and after."""
    light = ~touches | (force < 6 * NOISE_N)
    return np.convolve(light, np.ones(3), "same") == 0.0


def test_lost_contact_is_detected_at_release_and_at_the_next_touch() -> None:
    for offset in (0.0, 1.3):
        force, x, v, touches = pressed(sticks=0.002, offset=offset)
        found = without_contact(force, x, v, NOISE_N) > 0.0
        lost = (x > 0.0) & ~touches
        assert lost.sum() > 300
        assert found[lost].mean() > 0.97
        assert not found[pressing(touches, force - offset)].any()
        assert not found[x <= 0.0].any()


def test_a_plain_spring_loses_only_its_lightest_samples() -> None:
    force, x, v, touches = pressed(sticks=0.0)
    found = without_contact(force, x, v, NOISE_N) > 0.0
    assert not found[pressing(touches, force)].any()


def test_a_recording_that_never_leaves_contact_keeps_every_sample() -> None:
    force, x, v, _ = pressed(sticks=0.0)
    assert not without_contact(force + 50.0, x + 0.01, v, NOISE_N).any()


def test_the_samples_that_are_kept_beside_a_stretch_are_not_chosen_by_their_noise() -> None:
    """Kept from the first sample that noise lifts over the bar on, a touch showed a force."""
    t = np.arange(200_000) * DT_S
    x = 0.002 - 0.006 * np.cos(2 * np.pi * t)
    noise = np.random.default_rng(6).normal(size=t.size)
    force = 3600.0 * np.maximum(x, 0.0) + noise
    lost = without_contact(force, x, np.gradient(x, DT_S), 1.0) > 0.0
    kept = ((x > 0.0) & ~lost).astype(int)
    starts, ends = (np.flatnonzero(np.diff(kept) == step) for step in (1, -1))
    assert min(starts.size, ends.size) > 150
    for beside in (starts + 1, starts + 2, ends, ends - 1):
        assert abs(float(np.mean(noise[beside]))) < 4.0 / np.sqrt(beside.size)


@pytest.mark.parametrize("stands_still", [True, False])
def test_a_force_that_stands_still_during_a_touch_is_reported(stands_still: bool) -> None:
    """Its samples look like a late touch, and the rest of the recording is complete."""
    t = np.arange(6000) * DT_S
    x = 0.002 - 0.006 * np.cos(2 * np.pi * 0.9 * t)
    force = 3600.0 * np.maximum(x, 0.0) + 5.0 * np.gradient(x, DT_S) * (x > 0.0)
    if stands_still:
        touch = int(np.flatnonzero((x[1:] > 0.0) & (x[:-1] <= 0.0))[2])
        force[touch - 20 : touch + 90] = force[touch - 20]
    force += NOISE_N * np.random.default_rng(8).normal(size=t.size)
    answer = diagnose(from_arrays("made", t, x, force), "kelvin-voigt", surface=0.0).answer
    said = [note for note in answer["notes"] if "stood still" in note]
    assert answer["verdict"] == "no_missing_effect"
    assert len(said) == stands_still
    if stands_still:
        assert f"first at {touch * DT_S:.2f} s" in said[0]


def test_a_body_that_relaxes_is_said_to_let_go_of_the_tool() -> None:
    """Its force channel was suspected, beside the name of the effect by which it lets go."""
    t = np.arange(6000) * DT_S
    x = 0.002 - 0.006 * np.cos(2 * np.pi * 0.9 * t)
    force = 3600.0 * np.maximum(x, 0.0)
    touch = int(np.flatnonzero((x[1:] > 0.0) & (x[:-1] <= 0.0))[2])
    force[touch - 20 : touch + 90] = 0.0
    recording = from_arrays(
        "made", t, x, force + NOISE_N * np.random.default_rng(8).normal(size=t.size)
    )
    problem, model = pose(recording, base_of("kelvin-voigt"), 0.0)
    base = fit_base(problem, model)
    relaxing = problem.refine(replace(base.model, effects=(find("stress_relaxation"),)), np.ones(1))
    notes = [of_lost_contact(problem, fit, recording, 0.0) for fit in (base, relaxing)]
    assert ["stood still" in note for (note,) in notes] == [True, False]
    assert "lets go of the tool" in notes[1][0]


def crept(*, lets_go: float) -> tuple[np.ndarray, ...]:
    """Return force, x, v and where it touches: pressed all along, held deep and near the surface.

    On withdrawal the body lets go of the tool `lets_go` beyond the surface.
    """
    t = np.arange(8000) * DT_S
    x = 0.001 + 0.0025 * (1.0 - np.cos(2 * np.pi * 0.5 * t)) + 0.0002 * np.sin(2 * np.pi * 1.7 * t)
    v = np.gradient(x, DT_S)
    touches = x > lets_go
    force = 3e5 * np.where(touches, x - lets_go, 0.0) ** 1.8
    noise = NOISE_N * np.random.default_rng(6).normal(size=t.size)
    return force + noise, x, v, touches


def test_contact_lost_by_a_tool_that_never_comes_out_of_the_surface_is_found() -> None:
    force, x, v, touches = crept(lets_go=0.0018)
    found = without_contact(force, x, v, NOISE_N) > 0.0
    assert (~touches).sum() > 500
    assert found[~touches].mean() > 0.8
    assert not found[touches & (force > 10 * NOISE_N)].any()


def test_the_lightest_touch_of_a_body_that_stiffens_is_no_lost_contact() -> None:
    force, x, v, _ = crept(lets_go=0.0)
    assert not without_contact(force, x, v, NOISE_N).any()


def test_a_recording_whose_contacts_all_show_the_force_of_free_air_is_refused():
    t = np.arange(0.0, 10.0, 0.002)
    position = 0.004 * np.sin(2.0 * np.pi * 0.7 * t) + 0.001
    friction = 0.3 * np.tanh(np.gradient(position, t) / 1e-4)
    force = friction + np.random.default_rng(4).normal(0.0, 0.003, t.size)
    with pytest.raises(RecordingError, match=r"no contact: \d+ samples .*--surface"):
        diagnose(from_arrays("air", t, position, force), "kelvin-voigt", surface=0.0)
