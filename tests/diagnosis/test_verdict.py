"""The verdict on fitted candidates: a name, a class, or unknown."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.criteria import HIGHEST_PROBABILITY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.explanation import likelihoods
from teleop_rt.diagnosis.inference.ranked import Ranked
from teleop_rt.diagnosis.inference.second import takes_nearly_all
from teleop_rt.diagnosis.inference.verdict import Judgement, judge
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.noise.structure import LackOfFit
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.plants import make
from teleop_rt_dev.diagnosis.table import brier, reliability

VALUES, RANK, CHANCE_LEFT = 5000, 70, 5.0
BASE = base_of("kelvin-voigt")


def fitted(chi2: float, *names: str) -> Fit:
    effects = tuple(next(e for e in LIBRARY if e.name == name) for name in names)
    return Fit(CandidateModel(BASE, effects), np.zeros(0), np.zeros(0), np.array([np.sqrt(chi2)]),
               np.zeros((0, 1)), VALUES)  # fmt: skip


def judged(
    excess: float, doubt: float = 0.02, at_bound: str = "", **left: tuple[float, float]
) -> Judgement:
    """Judge single effects, each given by its chi-square beyond the noise and the structure left.

    `doubt` is the relative deviation of the noise's level, `at_bound` the effect with a shape at a
    bound.
    """
    alone = fitted(VALUES + excess)
    ranked = []
    for name, (chi2, structure) in left.items():
        fit = fitted(VALUES + chi2, name)
        lack = LackOfFit(structure, RANK, doubt=doubt)
        gains = alone.chi2 - fit.chi2, alone.bic - fit.bic
        ranked.append(Ranked(fit, *gains, lack, at_bound=frozenset({at_bound}) & {name}))
    ranked.sort(key=lambda r: r.fit.bic)
    return judge(LackOfFit(excess, RANK, doubt=doubt), ranked, [], floor=0.0)


def names(judgement: Judgement) -> list[str]:
    return [r.fit.names[0] for r in judgement.sets]


def test_a_bias_counts_by_the_noise_along_it_and_not_by_that_of_all_slow_directions() -> None:
    alone, fit = fitted(VALUES + 220.0), fitted(VALUES, "force_bias")
    left = LackOfFit(0.0, RANK, doubt=0.35, noise_per_direction=6.7)
    ranked = Ranked(fit, alone.chi2 - fit.chi2, alone.bic - fit.bic, left)
    base = LackOfFit(180.0, RANK, doubt=0.35, noise_per_direction=6.7)
    assert judge(base, [ranked], [], floor=0.0).verdict == "no_missing_effect"
    known = replace(ranked, noise_per_direction=1.0)
    assert judge(base, [known], [], floor=0.0).verdict == "named"


@pytest.mark.parametrize(
    ("alone", "both", "takes"),
    [
        ((1800.0, 520.0), (-80.0, 30.0), True),  # chance in all values hides it; structure shows it
        ((9000.0, 100.0), (200.0, 40.0), True),  # the opposite: a ripple is no structure
        ((1800.0, 520.0), (-80.0, 200.0), False),
        ((9000.0, 520.0), (2000.0, 30.0), False),
        ((900.0, 150.0), (0.0, 0.0), False),  # neither shows it
    ],
)
def test_a_small_partner_takes_nearly_all_where_chance_can_show_it(
    alone: tuple[float, float], both: tuple[float, float], takes: bool
) -> None:
    """Each is chi-square beyond the noise, and structure, of the first effect and of both."""
    first, pair = (
        Ranked(fitted(VALUES + chi2, *found), 0.0, 0.0, LackOfFit(structure, RANK, doubt=0.02))
        for found, (chi2, structure) in (
            (("channel_delay",), alone), (("channel_delay", "softening"), both),
        )
    )  # fmt: skip
    assert takes_nearly_all(pair, first) is takes


def test_what_is_far_louder_than_the_noise_is_not_called_nothing() -> None:
    base = LackOfFit(60.0, RANK, doubt=0.35)
    assert judge(base, [], [], floor=0.0).verdict == "no_missing_effect"
    assert judge(base, [], [], floor=0.0, exceeds_noise=True).verdict == "unexplained"


def test_what_gains_less_than_it_leaves_to_the_encoder_is_not_named() -> None:
    """A few draws of the encoder's errors do not show how little of them lies along an effect."""
    alone = fitted(VALUES + 430.0)
    fit = fitted(VALUES + 332.0, "channel_delay")
    left = LackOfFit(306.0, RANK)
    ranked = Ranked(
        fit, alone.chi2 - fit.chi2, alone.bic - fit.bic, left, encoder_energy_along=19.0
    )
    found = judge(LackOfFit(428.0, RANK), [ranked], [], floor=380.0)
    assert found.verdict == "no_missing_effect"
    clear = Ranked(fit, 600.0, 590.0, left, encoder_energy_along=19.0)
    assert judge(LackOfFit(900.0, RANK), [clear], [], floor=380.0).verdict == "named"
    none_of_its_errors = replace(ranked, encoder_energy_along=0.4)
    found = judge(LackOfFit(428.0, RANK), [none_of_its_errors], [], floor=380.0)
    assert found.verdict == "named"


@pytest.mark.parametrize("excess", [400.0, 1e6])
def test_an_effect_that_adds_nothing_to_a_simpler_one_is_no_rival(excess: float) -> None:
    found = judged(excess, coulomb_friction=(4.0, CHANCE_LEFT), stribeck_friction=(1.0, 3.0))
    assert (found.verdict, names(found)) == ("named", ["coulomb_friction"])


def test_an_effect_that_adds_to_a_simpler_one_is_kept_or_named() -> None:
    weak = judged(400.0, coulomb_friction=(25.0, 25.0), stribeck_friction=(0.0, CHANCE_LEFT))
    assert set(names(weak)) == {"coulomb_friction", "stribeck_friction"}
    clear = judged(4000.0, coulomb_friction=(400.0, 380.0), stribeck_friction=(0.0, CHANCE_LEFT))
    assert names(clear) == ["stribeck_friction"]


@pytest.mark.parametrize(
    ("plain", "larger"),
    [("coulomb_friction", "stribeck_friction"), ("contact_offset", "moving_surface")],
)
def test_a_larger_law_at_its_bound_is_another_form_of_its_special_case(
    plain: str, larger: str
) -> None:
    """A surface that settles at once is an offset."""
    left = {plain: (400.0, 380.0), larger: (0.0, CHANCE_LEFT)}
    assert names(judged(9000.0, **left)) == [larger]
    assert names(judged(9000.0, at_bound=larger, **left)) == [plain]
    del left[plain]
    assert names(judged(9000.0, at_bound=larger, **left)) == [larger]


def test_a_law_at_its_bound_comes_behind_one_that_explains_as_much() -> None:
    """Hysteresis at its sharpest took the rest of the error of a friction behind a spring."""
    excess = 1e5
    friction, far = (0.004 * excess, 0.0), (0.006 * excess, 0.0)
    named = partial(judged, excess, at_bound="hysteresis", hysteresis=(0.0, 0.0))
    both = named(coulomb_friction=friction)
    assert names(both) == ["coulomb_friction", "hysteresis"]
    assert 0.01 < likelihoods(both)["coulomb_friction"] < 0.5
    assert names(named(coulomb_friction=far)) == ["hysteresis"]
    assert names(judged(excess, hysteresis=(0.0, 0.0), coulomb_friction=friction)) == ["hysteresis"]


def test_a_law_that_leaves_nothing_is_not_confused_with_one_that_is_clearly_worse() -> None:
    found = judged(1e5, nonlinear_stiffening=(0.0, CHANCE_LEFT), mullins_softening=(150.0, 150.0))
    assert names(found) == ["nonlinear_stiffening"]


def test_laws_that_all_leave_structure_are_not_distinguished_by_less_than_that() -> None:
    found = judged(1e5, nonlinear_stiffening=(300.0, 300.0), mullins_softening=(500.0, 500.0))
    assert names(found) == ["nonlinear_stiffening", "mullins_softening"]


def test_a_member_is_no_rival_of_the_pair_that_is_needed_over_it() -> None:
    """Both leave structure, and the member less than half a percent of the excess more."""
    alone = fitted(VALUES + 3e6)

    def ranked(left: float, *members: str) -> Ranked:
        fit = fitted(VALUES + left, *members)
        lack = LackOfFit(left, RANK, doubt=0.02)
        return Ranked(fit, alone.chi2 - fit.chi2, alone.bic - fit.bic, lack)

    friction, rival = ranked(11_000.0, "coulomb_friction"), ranked(12_000.0, "hysteresis")
    pair = ranked(150.0, "coulomb_friction", "force_drift")
    found = judge(LackOfFit(3e6, RANK, doubt=0.02), [friction, rival], [pair], floor=0.0)
    assert [r.fit.names for r in found.sets] == [
        ("coulomb_friction", "force_drift"),
        ("hysteresis",),
    ]


def test_a_rival_that_is_not_sure_by_itself_is_not_excluded_by_that() -> None:
    # Of the same gain, with so many more parameters that alone it would be no find.
    found = judged(35.0, force_bias=(0.0, CHANCE_LEFT), softening=(8.5, CHANCE_LEFT))
    assert set(names(found)) == {"force_bias", "softening"}


def test_what_chance_could_leave_is_nothing() -> None:
    assert judged(20.0, force_bias=(2.0, 1.0)).verdict == "no_missing_effect"


def test_a_preference_counts_for_less_where_the_noise_is_doubtful() -> None:
    left = {"force_drift": (0.0, CHANCE_LEFT), "hysteresis": (18.0, CHANCE_LEFT)}
    assert names(judged(5000.0, **left)) == ["force_drift"]
    assert set(names(judged(5000.0, doubt=0.35, **left))) == {"force_drift", "hysteresis"}


@pytest.mark.parametrize(
    ("seed", "effect", "material", "size", "noise"),
    [
        (2066809874, "tool_inertia", "silicone", 0.156, 0.0146),
        (1868424255, "series_compliance", "foam", 0.0596, 0.00167),
    ],
)
def test_what_an_encoder_makes_of_a_mass_or_a_spring_does_not_speak_against_it(
    seed: int, effect: str, material: str, size: float, noise: float
) -> None:
    """On one tone many effects fit; those that read the encoder less are no likelier for that."""
    record = make(seed, (effect,), material, "sinusoid", size, noise)
    recording = from_arrays("tone", record.t, record.position, record.force)
    assert [effect] in diagnose(recording, record.base, surface=0.0).answer["class"]


def test_a_class_states_how_likely_each_of_its_effects_is() -> None:
    found = judged(10000.0, force_bias=(0.0, 0.0), contact_offset=(4.0, 0.0))
    probability = likelihoods(found)
    assert set(probability) == set(names(found)) == {"force_bias", "contact_offset"}
    assert sum(probability.values()) == pytest.approx(1.0)
    assert probability["force_bias"] > 0.8
    assert likelihoods(replace(found, sets=found.sets[:1])) == {"force_bias": HIGHEST_PROBABILITY}
    assert likelihoods(Judgement("unexplained", (), None, 1.0)) == {}


def test_the_reliability_table_compares_stated_and_observed_shares() -> None:
    answers = [
        {"effects": ["force_bias"], "probability": {"force_bias": 0.95, "force_lag": 0.05}},
        {"effects": ["force_bias"], "probability": {"force_lag": 0.95}},
    ]
    lowest, *_, highest = reliability(answers)
    assert (highest["hits"], highest["of"], highest["stated"]) == (1, 2, pytest.approx(0.95))
    assert (lowest["hits"], lowest["of"]) == (0, 1)
    assert brier(answers) == pytest.approx((0.05**2 + 0.05**2 + 0.95**2) / 3.0)


def test_a_bias_is_not_named_beside_a_drift_that_settles_at_once() -> None:
    """The drift contains it; a class of both ended with the drift in the extended model."""
    rng = np.random.default_rng(12)
    t = np.arange(3000) / 500.0
    x = 3e-3 * np.sin(2.0 * np.pi * 0.6 * t) + 1e-3 * np.sin(2.0 * np.pi * 1.7 * t)
    force = np.maximum(900.0 * x + 5.0 * np.gradient(x, t), 0.0) + 0.3
    force += 0.02 * rng.standard_normal(t.size)
    answer = diagnose(from_arrays("bias", t, x, force), surface=0.0).answer
    assert answer["class"] == [["force_bias"]]


def test_a_drift_is_named_although_it_contains_a_bias() -> None:
    rng = np.random.default_rng(13)
    t = np.arange(3000) / 500.0
    x = 3e-3 * np.sin(2.0 * np.pi * 0.6 * t) + 1e-3 * np.sin(2.0 * np.pi * 1.7 * t)
    force = np.maximum(900.0 * x + 5.0 * np.gradient(x, t), 0.0)
    force += 0.5 * (1.0 - np.exp(-t / 2.0)) + 0.02 * rng.standard_normal(t.size)
    answer = diagnose(from_arrays("drift", t, x, force), surface=0.0).answer
    assert answer["class"] == [["force_drift"]]
