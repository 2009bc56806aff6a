"""A law drafted from the unexplained force: its terms, its file, its worth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from schema_checks import violations

from teleop_rt.cli.schema import SchemaName
from teleop_rt.contact.effects.user import load_file
from teleop_rt.diagnosis.answers.notes import of_time
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.draft.choice import Law, law_of
from teleop_rt.diagnosis.draft.declaration import NAME, drafted_from, text_of
from teleop_rt.diagnosis.draft.drafted import drafted
from teleop_rt.diagnosis.draft.terms import MEMORIES, Scaling, Term, candidates, quantities, row_of
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.simulate import run_step
from teleop_rt.diagnosis.samples.preparation import pose
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt_dev.diagnosis.plants import make

GROUPED = 12
FRICTION = ("tanh(u / 0.01)", "tanh(u / 0.2)")


def pressed(extra: str = "", base: str = "kelvin-voigt", seed: int = 1) -> Recording:
    """A spring and damper, with a force that the base does not know, over two sines."""
    rng = np.random.default_rng(seed)
    t = np.arange(6000) * 1e-3
    w = 2.0 * np.pi * np.array([0.7, 1.9])
    x = 0.006 * np.sin(np.outer(w, t) + seed).sum(axis=0) + 0.004
    v = np.gradient(x, t)
    touching = np.where(x > 0.0, 1.0, 0.0) if base == "kelvin-voigt" else 1.0
    depth = touching * x
    force = 1000.0 * depth + 5.0 * touching * v
    if extra == "friction":
        force = force + 2.0 * np.tanh(v / 0.003)
    if extra == "depth":
        force = force + 8e4 * depth * np.abs(depth)
    if extra == "time":
        force = force + 3.0 * (1.0 - np.exp(-t / 2.0))
    if extra == "past":
        arm = np.zeros_like(x)
        for i in range(1, x.size):
            arm[i] = (arm[i - 1] + depth[i] - depth[i - 1]) * np.exp(-1e-3 / 0.12)
        force = force + 900.0 * arm
    if extra == "bridge":
        # Wetted in contact, the tool is pulled back in air until the bridge breaks at 2 mm.
        wet = np.zeros(t.size)
        for i in range(1, t.size):
            wet[i] = 1.0 if x[i] > 0.0 else wet[i - 1] * (x[i] > -0.002)
        force = force - 0.8 * wet * (x <= 0.0) * np.clip(1.0 + x / 0.002, 0.0, 1.0)
    return from_arrays(extra or "plain", t, x, force + 0.02 * rng.standard_normal(t.size))


def posed(recording: Recording, base: str = "kelvin-voigt") -> tuple[Problem, Fit]:
    problem, model = pose(recording, base_of(base), 0.0)
    return problem, fit_base(problem, model)


@pytest.mark.parametrize("base", ["kelvin-voigt", "spring,viscous,bias"])
def test_the_written_kernel_gives_what_the_chosen_terms_gave(tmp_path: Path, base: str) -> None:
    problem, fit = posed(pressed(base=base), base)
    scaling = Scaling.of(problem, fit)
    known = quantities(problem, fit, scaling)
    drafted_ones = (t for t in candidates(fit.model.base) if t.group != "time")
    every = list({(t.expression, t.memory): t for t in drafted_ones}.values())
    assert {t.memory for t in every} >= (
        {"", "q", "z", "y"} if base != "kelvin-voigt" else MEMORIES.keys()
    )
    motion = problem.motion
    for first in range(0, len(every), GROUPED):
        terms = tuple(every[first : first + GROUPED])
        coefficients = tuple(2.0 - 0.3 * i for i in range(len(terms)))
        law = Law(terms, coefficients, scaling, only_in_contact=False, shares={})
        path = tmp_path / f"draft_{first}.py"
        path.write_text(text_of(law, "r.csv", ("m", "N")))
        (effect,) = load_file(path)
        eta = np.array([shape.start for shape in effect.shapes])
        given = coefficients[0] * run_step(
            effect, motion.x, motion.v, motion.a, motion.t, motion.dt, eta
        )
        wanted = sum(
            c * row_of(t, known, motion.dt) for c, t in zip(coefficients, terms, strict=True)
        )
        assert given == pytest.approx(wanted, rel=1e-5, abs=1e-5)
        assert all(shape.lower < shape.start < shape.upper for shape in effect.shapes)


@pytest.mark.parametrize(
    ("extra", "groups"),
    [("friction", {"velocity", "past"}), ("depth", {"position", "force"}), ("past", {"past"})],
)
def test_the_shares_report_the_dependence_of_the_residual(extra: str, groups: set[str]) -> None:
    law = law_of(*posed(pressed(extra)))
    assert law is not None
    own = sum(share for group, share in law.shares.items() if group in groups)
    assert own > 0.5
    assert own > 1.5 * (sum(law.shares.values()) - own)
    assert sum(law.shares.values()) <= 1.001


def test_a_bridge_that_pulls_in_air_is_drafted_by_a_pull_on_withdrawal() -> None:
    """Without a term of the way out in air alone, the draft left more than half of its force."""
    problem, fit = posed(pressed("bridge"))
    law = law_of(problem, fit)
    assert law is not None
    assert not law.only_in_contact
    assert sum(law.shares.values()) > 0.6
    assert law.shares["velocity"] > 0.4


def test_a_dependence_on_time_is_reported_and_not_drafted() -> None:
    problem, fit = posed(pressed("time"))
    law = law_of(problem, fit)
    assert law is not None
    assert law.shares["time"] > 0.5
    (note,) = of_time({str(group): share for group, share in law.shares.items()})
    assert "carries over to no other recording" in note
    assert of_time({"time": 0.02}) == of_time(None) == []
    other = law_of(problem, fit, of_time=False)
    assert other is None or all(term.group != "time" for term in other.terms)


def test_nothing_is_drafted_of_noise() -> None:
    for seed in range(3):
        assert law_of(*posed(pressed(seed=seed))) is None


@pytest.mark.parametrize("effect", ["stress_relaxation", "coulomb_friction"])
def test_a_draft_takes_most_of_the_error_on_a_motion_that_it_has_not_seen(
    tmp_path: Path, effect: str
) -> None:
    made = make(3, (effect,), "silicone", size=0.15, noise=0.01, seconds=8.0)
    whole = from_arrays("r", made.t, made.position, made.force)
    half = whole.position.size // 2
    first, second = (
        replace(whole, position=whole.position[p], force=whole.force[p], mask=whole.mask[p])
        for p in (slice(None, half), slice(half, None))
    )
    found = diagnose(first, "kelvin-voigt", surface=0.0, effects=())
    assert found.answer["verdict"] == "unexplained"
    draft = drafted(found, first, tmp_path)
    assert draft is not None
    error = draft.predicted(second, 0.0).errors
    assert error["after"] < 0.35 * error["before"]
    entry = draft.entry(second, 0.0)
    assert entry["effect"]["explains"] > 0.8
    assert entry["effect"]["belongs_to"] == (
        "rig" if effect == "coulomb_friction" else "environment"
    )
    assert entry["error"]["after"] == error["after"]
    printed = {key: value for key, value in found.answer.items() if key != "seconds"}
    assert violations(SchemaName.ANSWER, printed | {"draft": entry}) == []


def test_a_draft_keeps_the_users_other_effects(tmp_path: Path) -> None:
    problem, fit = posed(pressed())
    term = Term("position", "stiffening", "s * s", "the square of the position")
    law = Law((term,), (3.0,), Scaling.of(problem, fit), only_in_contact=True, shares={})
    mine, both = tmp_path / "mine.py", tmp_path / "both.py"
    text = text_of(law, "a.csv", ("m", "N"))
    mine.write_text(text.replace(f'"{NAME}"', '"own_effect"'))
    both.write_text(text_of(law, "b.csv", ("m", "N"), mine))
    assert [effect.name for effect in load_file(both)] == ["own_effect", NAME]


def test_a_law_of_two_terms_in_the_same_words_lists_these_words_once() -> None:
    fast, slow = (t for t in candidates(base_of("viscous")) if t.expression in FRICTION)
    problem, fit = posed(pressed("friction"), "spring,viscous,bias")
    law = Law((fast, slow), (1.0, 0.5), Scaling.of(problem, fit), only_in_contact=False, shares={})
    assert law.words == ["the direction"]
    assert "the sum of 2 terms: the direction (2 terms)." in text_of(law, "a.csv", ("m", "N"))


def test_a_draft_drops_terms_that_do_not_differ_from_zero_and_knows_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = pressed("depth")
    found = diagnose(recording, "kelvin-voigt", surface=0.0, effects=())
    law = law_of(found.problem, found.best, of_time=False)
    assert law is not None
    known = {term.expression for term in law.terms}
    idle = next(t for t in candidates(base_of("kelvin-voigt")) if t.expression == "w")
    assert idle.expression not in known
    padded = replace(
        law, terms=(*law.terms, idle), coefficients=(*law.coefficients, 1e-9 * law.coefficients[0])
    )
    monkeypatch.setattr("teleop_rt.diagnosis.draft.drafted.law_of", lambda *_, **__: padded)
    draft = drafted(found, recording, tmp_path)
    assert draft is not None
    assert idle not in draft.law.terms
    for name, one in draft.effect["parameters"].items():
        assert not name.startswith("weight_") or abs(one["value"]) > 2.0 * one["std"]
    assert "weight_2" in draft.effect["parameters"] or len(draft.law.terms) == 1
    assert drafted_from(draft.file, recording)
    assert not drafted_from(draft.file, pressed("depth", seed=9))
