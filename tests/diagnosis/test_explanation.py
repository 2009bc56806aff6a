"""Sets judged beside something unknown: probabilities, shares, bounds, and the predictor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import find
from teleop_rt.diagnosis.criteria import HIGHEST_BESIDE_UNKNOWN
from teleop_rt.diagnosis.inference.explanation import bounded_by_error, explain, predictor
from teleop_rt.diagnosis.inference.ranked import Ranked
from teleop_rt.diagnosis.inference.sets import Scored
from teleop_rt.diagnosis.inference.verdict import Judgement
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.noise.structure import LackOfFit

_BASE = base_of("spring,viscous,bias")


def _set(*names: str, path: tuple[float, ...], at_bound: tuple[str, ...] = ()) -> Scored:
    """Return a set whose inner energies, the base's first, are `path`."""
    effects: tuple[Effect, ...] = tuple(find(name) for name in names)
    nothing = np.zeros(0)
    fit = Fit(CandidateModel(_BASE, effects), nothing, nothing, nothing, np.zeros((0, 0)), 100.0)
    return Scored(fit, path, frozenset(at_bound))


_ALONE = _set(path=(1.0,))


def test_one_effect_that_explains_most_is_partly_named() -> None:
    found = explain(
        [_ALONE, _set("coulomb_friction", path=(1.0, 0.3)), _set("force_lag", path=(1.0, 0.7))]
    )
    assert found.verdict == "partial"
    assert [one.fit.names for one in found.sets] == [("coulomb_friction",)]
    assert found.probability == {"coulomb_friction": HIGHEST_BESIDE_UNKNOWN}


def test_an_effect_that_explains_nearly_all_is_named() -> None:
    found = explain([_ALONE, _set("coulomb_friction", path=(1.0, 0.02))])
    assert found.verdict == "named"


def test_noise_is_no_structure_that_a_set_must_explain() -> None:
    sets = [_ALONE, _set("coulomb_friction", path=(1.0, 0.3))]
    assert explain(sets, noise=0.25).verdict == "partial"
    assert explain(sets, noise=0.28).verdict == "named"


def test_an_effect_that_explains_only_noise_is_not_named() -> None:
    friction = _set("coulomb_friction", path=(1.0, 0.25))
    both = _set("coulomb_friction", "force_lag", path=(1.0, 0.25, 0.04))
    assert explain([_ALONE, friction, both]).sets[0].fit.names == both.fit.names
    assert explain([_ALONE, friction, both], noise=0.25).sets[0].fit.names == friction.fit.names


def test_two_laws_with_similar_residuals_form_a_class() -> None:
    one = _set("coulomb_friction", path=(1.0, 0.030))
    other = _set("force_lag", path=(1.0, 0.031))
    found = explain([_ALONE, one, other])
    assert found.verdict == "class"
    assert {s.fit.names[0] for s in found.sets} == {"coulomb_friction", "force_lag"}
    assert sum(found.probability.values()) == pytest.approx(1.0)


def _different(apart: float) -> Callable[[Scored, Scored], float]:
    return lambda one, other: apart


@pytest.mark.parametrize(
    ("apart", "verdict"), [(0.02, "partial"), (0.2, "unexplained")]
)  # of 0.63 that each explains
def test_many_effects_are_an_answer_where_the_motion_makes_them_one(
    apart: float, verdict: str
) -> None:
    names = ("tool_inertia", "force_lag", "stress_relaxation", "force_bias", "moving_surface")
    sets = [_set(name, path=(1.0, 0.37)) for name in names]
    found = explain([_ALONE, *sets], noise=0.04, apart=_different(apart))
    assert found.verdict == verdict
    assert len(found.sets) == (len(names) if verdict == "partial" else 0)


def test_a_second_law_of_the_same_physics_is_not_named() -> None:
    first = _set("stress_relaxation", path=(1.0, 0.3))
    second = _set("fractional_relaxation", path=(1.0, 0.5))
    both = _set("stress_relaxation", "fractional_relaxation", path=(1.0, 0.3, 0.02))
    found = explain([_ALONE, first, second, both])
    assert [one.fit.names for one in found.sets] == [("stress_relaxation",)]
    assert predictor([_ALONE, first, second, both]).energy == both.energy


def test_an_effect_that_explains_little_is_not_named() -> None:
    assert explain([_ALONE, _set("force_lag", path=(1.0, 0.85))]).verdict == "unexplained"


def test_a_law_at_its_bound_is_not_named_nor_is_a_worse_one() -> None:
    bent = _set("hysteresis", path=(1.0, 0.1), at_bound=("hysteresis",))
    worse = _set("force_lag", path=(1.0, 0.4))
    assert explain([_ALONE, bent, worse]).verdict == "unexplained"
    assert explain([_ALONE, replace(bent, unsupported=frozenset()), worse]).verdict == "partial"


def test_a_part_that_was_tried_is_named_if_the_supported_set_was_not() -> None:
    first = _set("adhesion", path=(1.0, 0.5))
    bent = ("stress_relaxation",)
    two = _set("adhesion", *bent, path=(1.0, 0.5, 0.3), at_bound=bent)
    three = _set("adhesion", *bent, "force_lag", path=(1.0, 0.5, 0.3, 0.05), at_bound=bent)
    found = explain([_ALONE, first, two, three])
    assert found.verdict == "partial"
    assert [one.fit.names for one in found.sets] == [("adhesion",)]


def test_of_a_set_without_all_its_names_the_part_is_named_that_explains_most() -> None:
    friction, relaxation = "coulomb_friction", "stress_relaxation"
    alone = [_set(friction, path=(1.0, 0.62)), _set(relaxation, path=(1.0, 0.7))]
    both = _set(relaxation, friction, path=(1.0, 0.7, 0.3), at_bound=(friction,))
    found = explain([_ALONE, *alone, both])
    assert [one.fit.names for one in found.sets] == [(friction,)]


def test_a_set_that_all_others_of_a_class_contain_is_partly_named() -> None:
    one = _set("coulomb_friction", path=(1.0, 0.55))
    two = _set("coulomb_friction", "force_lag", path=(1.0, 0.55, 0.345))
    found = explain([_ALONE, one, two])
    assert found.verdict == "partial"
    assert [s.fit.names for s in found.sets] == [("coulomb_friction",)]
    assert found.probability["coulomb_friction"] == HIGHEST_BESIDE_UNKNOWN
    assert 0.5 < found.probability["force_lag"] <= HIGHEST_BESIDE_UNKNOWN


def test_a_special_case_is_named_if_its_extension_gains_nothing() -> None:
    plain = _set("coulomb_friction", path=(1.0, 0.2))
    wider = _set("stribeck_friction", path=(1.0, 0.199), at_bound=("stribeck_friction",))
    found = explain([_ALONE, wider, plain])
    assert [one.fit.names for one in found.sets] == [("coulomb_friction",)]


@pytest.mark.parametrize("wide", ["stribeck_friction", "hysteresis"])
def test_a_special_case_left_beside_its_general_law_comes_first(wide: str) -> None:
    plain = _set("coulomb_friction", path=(1.0, 0.0424))
    found = explain([_ALONE, _set(wide, path=(1.0, 0.0400)), plain])
    assert found.verdict == "class"
    assert [one.fit.names for one in found.sets] == [("coulomb_friction",), (wide,)]


def test_small_partners_predict_but_are_not_named() -> None:
    one = _set("coulomb_friction", path=(1.0, 0.20))
    two = _set("coulomb_friction", "force_lag", path=(1.0, 0.20, 0.12))
    found = explain([_ALONE, one, two])
    assert [s.fit.names for s in found.sets] == [("coulomb_friction",)]
    assert predictor([_ALONE, one, two]) is two


@pytest.mark.parametrize(
    ("first", "both", "named"),
    [
        (0.10, 0.012, ("coulomb_friction", "stress_relaxation")),
        (0.10, 0.040, ("coulomb_friction",)),  # much is left, as of a form that neither law has
        (0.04, 0.010, ("coulomb_friction",)),  # enough is explained without a second name
    ],
)
def test_a_small_partner_is_named_where_it_explains_nearly_all_that_is_left(
    first: float, both: float, named: tuple[str, ...]
) -> None:
    """A relaxation of 8 % beside friction was left out, although noise alone stayed with it."""
    one = _set("coulomb_friction", path=(1.0, first))
    two = _set("coulomb_friction", "stress_relaxation", path=(1.0, first, both))
    found = explain([_ALONE, one, two], noise=0.01)
    assert [s.fit.names for s in found.sets] == [named]


def test_the_order_of_the_search_does_not_change_the_shares() -> None:
    damping = _set("direction_dependent_damping", path=(1.0, 0.3))
    friction = _set("coulomb_friction", path=(1.0, 0.05))
    both = _set("direction_dependent_damping", "coulomb_friction", path=(1.0, 0.3, 0.03))
    found = explain([_ALONE, damping, friction, both])
    assert [s.fit.names for s in found.sets] == [("coulomb_friction",)]


def test_the_predictor_takes_no_effect_that_lowers_the_error_by_less_than_two_hundredths() -> None:
    one = _set("coulomb_friction", path=(1.0, 0.200))
    two = _set("coulomb_friction", "force_lag", path=(1.0, 0.200, 0.195))
    assert predictor([_ALONE, one, two]) is one


def test_the_law_within_its_bounds_is_named_and_the_best_one_predicts() -> None:
    bent = _set("coulomb_friction", path=(1.0, 0.08), at_bound=("coulomb_friction",))
    within = _set("coulomb_friction", path=(1.0, 0.15))
    found = explain([_ALONE, bent, within])
    assert found.sets == (within,)
    assert predictor([_ALONE, bent, within]) is bent


def test_a_law_at_its_bound_withholds_no_other_name() -> None:
    """The saturation of a relaxing body was lost where the relaxation's law had another form."""
    clipped = _set("force_saturation", path=(1.0, 0.4))
    bent = _set(
        "force_saturation",
        "stress_relaxation",
        path=(1.0, 0.4, 0.02),
        at_bound=("stress_relaxation",),
    )
    found = explain([_ALONE, clipped, bent])
    assert found.verdict == "partial"
    assert [one.fit.names for one in found.sets] == [("force_saturation",)]
    spoilt = [replace(one, unsupported=one.unsupported | {"force_saturation"})
              for one in (clipped, bent)]  # fmt: skip
    assert explain([_ALONE, *spoilt]).verdict == "unexplained"


def test_a_poor_law_within_its_bounds_does_not_replace_a_far_better_one() -> None:
    bent = _set("hysteresis", path=(1.0, 0.01), at_bound=("hysteresis",))
    poor = _set("hysteresis", path=(1.0, 0.55))
    other = _set("coulomb_friction", path=(1.0, 0.14))
    assert explain([_ALONE, bent, poor, other]).verdict == "unexplained"


def test_a_law_at_its_bound_alone_is_named_where_a_larger_set_supports_it() -> None:
    friction = _set("coulomb_friction", path=(1.0, 0.22), at_bound=("coulomb_friction",))
    late = _set("coulomb_friction", "force_lag", path=(1.0, 0.22, 0.16))
    found = explain([_ALONE, friction, late], noise=0.12)
    assert found.verdict == "partial"
    assert [one.fit.names for one in found.sets] == [("coulomb_friction",)]
    unsupported = replace(late, unsupported=frozenset({"coulomb_friction"}))
    assert explain([_ALONE, friction, unsupported], noise=0.12).verdict == "unexplained"


def test_a_pair_that_fits_less_well_than_its_member_leaves_the_next_no_more_to_explain() -> None:
    """The pair's laws are within their bounds; the third effect had seemed to complete it."""
    friction = _set("coulomb_friction", path=(1.0, 0.22))
    pair = _set("coulomb_friction", "channel_delay", path=(1.0, 0.30, 0.24))
    three = _set("coulomb_friction", "channel_delay", "quadratic_damping",
                 path=(1.0, 0.30, 0.24, 0.136))  # fmt: skip
    found = explain([_ALONE, friction, pair, three], noise=0.114)
    assert [one.fit.names for one in found.sets] == [("coulomb_friction",)]


def test_a_law_at_its_bound_that_fits_no_better_excludes_no_name() -> None:
    bent = _set("hysteresis", path=(1.0, 0.103), at_bound=("hysteresis",))
    named = _set("coulomb_friction", path=(1.0, 0.1))
    found = explain([_ALONE, bent, named])
    assert [one.fit.names for one in found.sets] == [("coulomb_friction",)]
    assert found.probability == {"coulomb_friction": HIGHEST_BESIDE_UNKNOWN}


def test_a_law_of_time_predicts_only_if_it_is_named() -> None:
    one = _set("coulomb_friction", path=(1.0, 0.20))
    two = _set("coulomb_friction", "force_drift", path=(1.0, 0.20, 0.12))
    assert predictor([_ALONE, one, two]) is one
    assert predictor([_ALONE, one, two], {"force_drift"}) is two


@pytest.mark.parametrize(
    ("ratio", "highest", "verdict"),
    [(0.9, 0.97, "named"), (1.9, 0.511, "named"), (2.0, 0.485, "partial"), (9.0, 0.4, "partial")],
)
def test_a_set_that_leaves_more_than_noise_is_less_certain(
    ratio: float, highest: float, verdict: str
) -> None:
    ranked = Ranked(_set("adhesion", path=(1.0, 0.1)).fit, 900.0, 880.0, LackOfFit(1.0, 10))
    chances = {"adhesion": 0.97, "backlash": 0.3}
    judgement = Judgement("named", (ranked,), None, 900.0, probability=chances)
    bounded = bounded_by_error(judgement, ratio)
    assert bounded.probability == {"adhesion": pytest.approx(highest, abs=1e-3), "backlash": 0.3}
    assert bounded.verdict == verdict
    several = bounded_by_error(replace(judgement, verdict="class"), ratio)
    assert several.verdict == "class", "its experiment is still to be made"
