"""One language of names and units for everything that people look at."""

import pytest

from teleop_rt.view import diagnosis_page
from teleop_rt.view.quantities import parameter_unit, small_position
from teleop_rt.view.run_folder import selected_row
from teleop_rt.view.style import (
    effect_in_words,
    method_name,
    number,
    parameter,
    printed,
    with_unit,
)


@pytest.mark.parametrize(
    ("model", "name", "units", "shown"),
    [
        ("kelvin-voigt", "k", ("m", "N"), "N/m"),
        ("kelvin-voigt", "b", ("rad", "Nm"), "Nm s/rad"),
        ("hunt-crossley", "b", ("m", "N"), "N s/mⁿ⁺¹"),
        ("hunt-crossley", "n", ("m", "N"), "-"),
        ("kelvin-voigt", "an effect of a user", ("m", "N"), "SI"),
    ],
)
def test_a_parameter_is_shown_with_the_unit_of_the_rig(model, name, units, shown):
    assert parameter_unit(model, name, *units) == shown


@pytest.mark.parametrize(
    ("unit", "shown"),
    [
        ("N s/m^(power+1)", "N s/mᵖᵒʷᵉʳ⁺¹"),
        ("N/m^(n+1)", "N/mⁿ⁺¹"),
        ("N/m^n", "N/mⁿ"),
        ("N s^2/m^4", "N s²/m⁴"),
        ("N/m^2.5", "N/m^2.5"),  # a point cannot be raised
    ],
)
def test_an_exponent_is_raised_where_it_can_be(unit, shown):
    assert printed(unit) == shown


@pytest.mark.parametrize(("unit", "shown"), [("N s^2/m", "kg"), ("Nm s^2/rad", "kg m²")])
def test_a_mass_is_shown_in_kilograms(unit, shown):
    assert parameter("m", {"value": 0.0026, "std": 1e-4, "unit": unit}) == (
        f"m = 0.0026 ± 0.0001 {shown}"
    )
    force, _, position = unit.partition(" s^2/")
    assert parameter_unit("mass", "m", position, force) == shown


def test_a_size_with_a_deviation_beyond_its_range_is_not_determined():
    """It was shown as 0 ± 940: the value had no digit left."""
    unsure = {"value": 0.012, "std": 940.0, "unit": "m/s"}
    assert parameter("smoothing_velocity", unsure) == "smoothing_velocity: not determined"
    assert parameter("smoothing velocity", unsure) == "smoothing velocity: not determined"
    wide = parameter("smoothing_velocity", unsure | {"std": 0.02})
    assert wide == "smoothing_velocity = 0.012 ± 0.02 m/s"
    assert parameter("rest", {"value": 1e-5, "std": 2e-3, "unit": "m"}).startswith(
        "rest = 0 ± 2 mm"
    )


def test_an_effect_beside_a_model_has_its_own_unit():
    assert parameter_unit("kelvin-voigt", "return_spring", "m", "N") == "N/m"


def test_an_effect_whose_laws_have_several_units_shows_none_of_them():
    assert parameter_unit("kelvin-voigt", "second_layer", "m", "N") == "SI"


def test_a_position_is_shown_in_thousandths_and_one_that_is_unknown_as_a_dash():
    assert small_position(0.0137, "m") == "13.7 mm"
    assert small_position(-0.2, "rad") == "-200 mrad"
    assert small_position(None, "m") == "–"


def test_a_length_among_the_parameters_is_shown_in_mm_and_an_angle_as_it_is():
    shown = parameter("travel", {"value": 4e-4, "std": 2.5e-6, "unit": "m"})
    assert shown == "travel = 0.4 ± 0.0025 mm"
    unsure = parameter("surface", {"value": -1.9576e-8, "std": 3.5e-7, "unit": "m"})
    assert unsure == "surface = -0.02 ± 0.35 µm"
    sure = parameter("k", {"value": 3600.348, "std": 0.4512, "unit": "N/m"})
    assert sure == "k = 3600.3 ± 0.45 N/m"
    assert parameter("gap", {"value": 2e-3, "std": None, "unit": "m"}) == "gap = 2 mm"
    assert parameter("phase", {"value": 0.5, "std": None, "unit": "rad"}) == "phase = 0.5 rad"


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (7.67e-11, "m", "0.0767 nm"),
        (4.2e-7, "m", "0.42 µm"),
        (3e-7, "N", "0.3 µN"),
        (4e-10, "N s/m", "0.4 nN s/m"),
        (2.324e22, "N/m^5.42", "0.070184 nN/µm^5.42"),
        (2e11, "N/m^3", "200 N/mm³"),
        (5e6, "N/m^3", "5e+06 N/m³"),  # a body of some mm: as the reference writes it
        (2e-7, "Nm/rad", "2e-07 Nm/rad"),
        (0.0, "m", "0 mm"),
    ],
)
def test_a_parameter_of_a_micro_body_is_shown_in_the_unit_of_its_size(value, unit, shown):
    assert parameter("p", {"value": value, "std": None, "unit": unit}) == f"p = {shown}"


@pytest.mark.parametrize("gone", [None, float("nan")])
def test_a_value_that_is_missing_or_no_number_is_a_dash(gone):
    assert parameter("k", {"value": gone, "std": None, "unit": "N/m"}) == "k –"
    assert number(gone) == "–"
    assert with_unit(gone, "ms") == "–"
    lost = {"depth": {"value": gone, "std": None, "unit": "m"}}
    assert effect_in_words({"parameters": lost, "template": "At {depth}."}) == "At –."


def test_the_sentence_of_an_effect_has_the_units_of_its_parameters():
    depth = {"value": 7.67e-11, "std": None, "unit": "m"}
    effect = {"parameters": {"depth": depth}, "template": "A layer at {depth}."}
    assert effect_in_words(effect) == "A layer at 0.0767 nm."


def test_a_method_keeps_its_name_where_its_effects_are_frozen():
    assert method_name("direct", "rls") == "RLS"
    assert method_name("direct", "rls-with-frozen-effects") == "RLS, effects frozen"
    assert method_name("algebraic", "iec") == "algebraic + integral error"
    assert method_name("direct", "one of a later version") == "one of a later version"


def test_of_rows_that_differ_in_their_effects_alone_the_selected_one_is_found():
    row = {"model": "kelvin-voigt", "regression": "direct", "solver": "rls"}
    rows = [row | {"effects": effects} for effects in (None, "estimated", "frozen")]
    summary = {"estimators": rows, "selected": row | {"effects": "frozen"}}
    assert selected_row(summary) is rows[2]


@pytest.mark.parametrize(("gain", "shown"), [
    (6435170.3, "6.44 × 10⁶"), (1234567890.0, "1.23 × 10⁹"), (41234.5, "41 200"), (13.7, "14"),
    (-2.0, "−2"), (0.0, "0"), (-6435170.3, "−6.44 × 10⁶"),
])  # fmt: skip
def test_a_gain_is_given_to_three_digits(gain, shown):
    row = {
        "effects": ["a"],
        "laws": [""],
        "belongs_to": ["rig"],
        "delta_bic": gain,
        "explains": 0.5,
    }
    (found,) = diagnosis_page._candidates({"class": [], "effects": [], "candidates": [row]})
    assert found["bic"] == shown


def test_candidates_of_the_same_effects_differ_by_their_laws():
    row = {"effects": ["permanent_set", "force_bias"], "belongs_to": ["rig"], "explains": 0.5}
    rows = [
        row | {"laws": [law, ""], "delta_bic": 1.0} for law in ("creeping in", "beyond a yield")
    ]
    found = diagnosis_page._candidates({"class": [], "effects": [], "candidates": rows})
    assert [one["names"] for one in found] == [
        "permanent set (creeping in) + force bias",
        "permanent set (beyond a yield) + force bias",
    ]
