"""Content of an answer beside its verdict: nearest candidate, wrong signs, no prediction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from teleop_rt.contact.effects import LIBRARY, find
from teleop_rt.diagnosis.answers.answer import parameters_of_effect
from teleop_rt.diagnosis.answers.errors import HeldOut, bounded_floor, predicts_worse
from teleop_rt.diagnosis.answers.notes import notes_of
from teleop_rt.diagnosis.answers.residuals import of_nearest
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.ranked import Ranked
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Problem
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.noise.structure import LackOfFit
from teleop_rt.diagnosis.noise.whiten import white
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.diagnosis.samples.turned_sign import turned_sign
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt.view.style import parameter
from teleop_rt_dev.diagnosis.plants import make


def outside_the_library() -> Recording:
    record = make(61, ("depth_waves",), "silicone", size=0.15, noise=0.01, seconds=5.0)
    return from_arrays("waves", record.t, record.position, record.force)


def swung(mass: float, damping: float, stiffness: float) -> Recording:
    t = np.arange(4000) * 2e-3
    w = 2.0 * np.pi * np.array([0.7, 1.9])
    x = 0.02 * np.sin(np.outer(w, t)).sum(axis=0)
    v = (0.02 * w[:, None] * np.cos(np.outer(w, t))).sum(axis=0)
    a = (-0.02 * w[:, None] ** 2 * np.sin(np.outer(w, t))).sum(axis=0)
    noise = 0.002 * np.random.default_rng(1).standard_normal(t.size)
    return from_arrays("swung", t, x, mass * a + damping * v + stiffness * x + noise)


def test_without_an_answer_the_nearest_candidate_is_reported_with_its_errors_without_outliers() -> (
    None
):
    recording = outside_the_library()
    force = recording.force.copy()
    force[500::400] += 4.0 * float(np.ptp(force))
    # A vocabulary that holds nothing of the kind.
    poor = (find("tool_inertia"), find("force_drift"))
    changed = replace(recording, force=force)
    found = diagnose(changed, "kelvin-voigt", surface=0.0, effects=poor).answer
    assert (found["verdict"], found["effects"], found["class"]) == ("unexplained", [], [])
    assert any("stand alone" in note for note in found["notes"])
    nearest = found["nearest"]
    assert 0.0 <= nearest["share"] < 0.95
    assert nearest["before"] == pytest.approx(found["error"]["before"], rel=0.2)
    assert 0.0 < nearest["after"] < 2.0 * nearest["before"]


@pytest.mark.parametrize(
    ("name", "base", "recording"),
    [
        ("spring", "spring,viscous,bias", swung(0.0, 0.5, 20.0)),
        ("damper", "mass-damper", swung(0.05, 4.0, 0.0)),
        ("mass", "mass-damper", swung(2.0, 0.5, 0.0)),
    ],
)
def test_a_force_counted_the_other_way_round_is_noticed_by_a_base_without_contact(
    name: str, base: str, recording: Recording
) -> None:
    model = CandidateModel(base_of(base))
    turned = replace(recording, force=-recording.force)
    assert turned_sign(problem_of(recording, model.base, 0.0), model) is None
    hint = turned_sign(problem_of(turned, model.base, 0.0), model)
    assert hint is not None
    assert f"wrong sign? most of the force is that of a {name}" in hint


def test_a_turned_sign_is_in_the_notes_of_the_answer() -> None:
    recording = swung(0.0, 0.5, 20.0)
    turned = diagnose(replace(recording, force=-recording.force), "spring,viscous,bias").answer
    assert any("--columns force=-NAME" in note for note in turned["notes"])
    named = replace(recording, force=-recording.force, columns=("x_m", "-F [N]"))
    notes = diagnose(named, "spring,viscous,bias").answer["notes"]
    assert any("turn it with --columns 'force=F [N]'" in note for note in notes)


def test_a_force_that_cannot_be_predicted_has_no_figure() -> None:
    rng = np.random.default_rng(2)
    force, where = rng.standard_normal(1000), np.ones(1000)
    motion = RecordedMotion(force, force, force, force, 1e-3)
    problem = Problem(motion, force, white(where, 1.0, 1e-3))
    changed = HeldOut("held-out blocks", problem, 0.5 * force, 1e9 * force, where, 0.01).errors
    assert changed["after"] is None
    assert changed["after_over_floor"] is None
    assert changed["std_normalised"] == {"before": pytest.approx(0.5, rel=1e-2), "after": None}
    assert changed["std_normalised_low_passed"]["after"] is None


def test_a_side_that_pulls_may_also_touch_nothing() -> None:
    recording = outside_the_library()
    with pytest.raises(RecordingError, match=r"wrong sign.*touches nothing.*saturated"):
        diagnose(replace(recording, force=-recording.force), "kelvin-voigt", surface=0.0)


def pressed(*, gap: bool = False) -> Recording:
    """Return 10 s of presses on a spring and damper whose surface lies at 5 mm; a force is lost."""
    t = np.arange(5000) * 2e-3
    x = 6e-3 + 3.0e-3 * np.sin(4.4 * t - 1.57) + 1.2e-3 * np.sin(11.9 * t) + 6e-4 * np.sin(27.0 * t)
    depth = x - 5e-3
    force = np.where(depth > 0.0, np.maximum(2000.0 * depth + 8.0 * np.gradient(x, t), 0.0), 0.0)
    force += 0.03 * np.random.default_rng(3).standard_normal(t.size)
    x = x + 2e-6 * np.random.default_rng(4).standard_normal(t.size)
    kept = (t < 4.0) | (t >= 4.6) if gap else np.ones(t.size, dtype=bool)
    return from_arrays("pressed", t[kept], x[kept], force[kept])


@pytest.mark.parametrize(("surface", "contradicted"), [(9e-3, True), (5.2e-3, False)])
def test_a_given_surface_far_from_the_onset_of_force_is_contradicted(
    surface: float, contradicted: bool
) -> None:
    notes = diagnose(pressed(), "kelvin-voigt", surface=surface).answer["notes"]
    assert any("the force begins at 0.005" in note for note in notes) == contradicted


@pytest.mark.parametrize("surface", [2e-3, 9e-3])
def test_no_effect_is_named_for_a_mistaken_surface(surface: float) -> None:
    answer = diagnose(pressed(), "kelvin-voigt", surface=surface).answer
    assert answer["verdict"] == "no_missing_effect"
    assert answer["base"]["parameters"]["surface"]["value"] == pytest.approx(5e-3, abs=1e-5)
    assert any("it was found instead" in note for note in answer["notes"])


def test_a_mistaken_surface_changes_no_name_and_no_error_on_a_test_recording() -> None:
    first, test = rubbing(seed=1), rubbing(seed=2)
    answers = [diagnose(first, test=test, surface=given).answer for given in (None, 0.0)]
    assert [list(one["probability"]) for one in answers] == [["coulomb_friction"]] * 2
    errors = [one["error"]["std_normalised"]["after"] for one in answers]
    assert errors[1] == pytest.approx(errors[0], rel=0.05)


def rubbing(seed: int) -> Recording:
    """Return such presses with dry friction of 0.6 N, in air as well."""
    clean, draw = pressed(), np.random.default_rng(seed)
    speed = np.gradient(clean.position, clean.dt)
    smooth = np.convolve(speed, np.ones(9) / 9.0, "same")
    noise = 0.03 * draw.standard_normal(speed.size)
    return replace(clean, force=clean.force + 0.6 * np.tanh(smooth / 2e-3) + noise)


def test_a_gap_is_no_lost_contact_and_no_limiter() -> None:
    answer = diagnose(pressed(gap=True), "kelvin-voigt").answer
    assert answer["verdict"] == "no_missing_effect"
    assert answer["gaps"]["count"] == 1
    assert not [note for note in answer["notes"] if "stood still" in note or "limiter" in note]


@pytest.mark.parametrize(("sign", "turned"), [(1.0, "the position"), (-1.0, "both")])
def test_a_position_that_counts_away_from_the_body_is_said_to_be_turned(
    sign: float, turned: str
) -> None:
    held = pressed()
    recording = from_arrays("turned", held.time_s, 0.05 - held.position, sign * held.force)
    with pytest.raises(RecordingError, match=f"turn {turned}"):
        diagnose(recording)


def test_errors_of_another_set_than_the_named_one_are_reported_as_such() -> None:
    recording = pressed()
    answer = diagnose(recording, "kelvin-voigt").answer
    named = {"verdict": "named", "effects": [{"name": "force_bias", "explains": 1.0}]}

    def said(predictor: list[str]) -> list[str]:
        changed = {**answer, **named, "predictor": predictor}
        notes = notes_of(changed, base_of("kelvin-voigt"), "kelvin-voigt", recording, None, "usual")
        return [note for note in notes if note.startswith("the errors are those of the set")]

    assert said(["force_bias"]) == []
    (note,) = said(["gravity_torque", "adhesion"])
    assert note.endswith("gravity_torque + adhesion")


def test_effects_of_the_likelier_sets_of_a_part_are_said_to_be_possible() -> None:
    recording = pressed()
    answer = diagnose(recording, "kelvin-voigt").answer
    part = {"verdict": "partial", "class": [["coulomb_friction"]], "effects": []}

    def said(probability: dict[str, float]) -> list[str]:
        changed = {**answer, **part, "probability": probability}
        notes = notes_of(changed, base_of("kelvin-voigt"), "kelvin-voigt", recording, None, "usual")
        return [note for note in notes if "may act as well" in note]

    assert said({"coulomb_friction": 0.7}) == []
    (note,) = said({"coulomb_friction": 0.7, "channel_delay": 0.7, "backlash": 0.61})
    assert note.startswith("backlash (probability 0.61) and channel_delay (probability 0.70) may")


def test_a_value_at_its_bound_is_said_to_lie_there() -> None:
    recording = pressed()
    problem = problem_of(recording, base_of("kelvin-voigt"), 5e-3)
    soft = next(e for e in LIBRARY if e.name == "force_saturation" and e.law == "soft")
    level = 1.1 * problem.motion.scales["force"]
    fit = problem.solve(
        CandidateModel(base_of("kelvin-voigt"), (soft,)), np.array([level, soft.shapes[1].lower])
    )
    spread = np.eye(len(fit.theta) + len(fit.zeta))
    found = parameters_of_effect(problem, fit, 0, spread, recording.units)
    assert {name for name, one in found.items() if "note" in one} == {"sharpness"}
    assert parameter("sharpness", found["sharpness"]).endswith(" (at its bound)")


def errors(before: float, after: float | None, floor: float | None) -> dict[str, float | None]:
    return {"before": before, "after": after, "noise_floor": floor, "after_over_floor": None}


def test_no_error_of_an_answer_lies_below_its_noise_floor() -> None:
    """A floor of 0.0083 stood above an error of 0.0013."""
    own = errors(0.2, 0.01, 0.008)
    assert bounded_floor(own) == {**own, "after_over_floor": pytest.approx(1.25)}
    nearest = {"before": 0.2, "after": 0.00125}
    assert bounded_floor(own, nearest) == {
        **own, "noise_floor": 0.00125, "after_over_floor": pytest.approx(8.0)
    }  # fmt: skip
    assert bounded_floor(errors(0.2, 0.004, 0.005))["after_over_floor"] == 1.0
    assert bounded_floor(errors(0.2, None, 0.005), {}) == errors(0.2, None, 0.005)
    assert bounded_floor(errors(0.2, 0.1, None), nearest)["noise_floor"] is None


@pytest.mark.parametrize(
    ("draft", "nearest", "worse"),
    [(0.01, None, False), (0.03, None, True), (0.01, 0.005, True), (None, None, True)],
)
def test_a_draft_that_predicts_worse_than_a_set_is_known(
    draft: float | None, nearest: float | None, worse: bool
) -> None:
    answer = {
        "error": errors(0.2, 0.02, 0.001),
        "nearest": None if nearest is None else {"after": nearest},
        "draft": {"error": {"after": draft}},
    }
    assert predicts_worse(answer) is worse


def test_a_nearest_set_that_errs_less_is_said_to_hold_a_law_of_time() -> None:
    found = diagnose(outside_the_library(), "kelvin-voigt", surface=0.0, effects=())
    model = replace(found.base.model, effects=(find("tool_inertia"), find("force_drift")))
    left = LackOfFit(0.0, 1, 0.0, 1.0, 1.0)
    ranked = Ranked(replace(found.base, model=model), 0.0, 0.0, left)
    found = replace(found, candidates=(ranked,))
    answer = {"error": errors(0.2, 0.02, 0.001), "nearest": {"after": 0.01}}
    (note,) = of_nearest(found, answer)
    assert "a law of time (force_drift)" in note
    assert of_nearest(found, answer | {"nearest": {"after": 0.03}}) == []
    assert of_nearest(found, answer | {"nearest": None}) == []


@pytest.mark.parametrize("turned", ["force", "both"])
def test_of_a_run_whose_rig_knows_the_signs_no_column_is_to_be_turned(turned: str) -> None:
    recording = replace(outside_the_library(), run="runs/now/recording.mcap")
    recording = replace(recording, force=-recording.force)
    if turned == "both":
        recording = replace(recording, position=-recording.position)
    with pytest.raises(RecordingError) as raised:
        diagnose(recording, "kelvin-voigt", surface=0.0)
    said = str(raised.value)
    assert said.startswith("runs/now/recording.mcap: moving surface? beyond the surface")
    assert "-NAME" not in said
