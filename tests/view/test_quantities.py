"""One language of names and units for everything that people look at."""

import pytest

from teleop_rt.view.quantities import parameter_unit, small_position
from teleop_rt.view.run_folder import selected_row
from teleop_rt.view.style import method_name, parameter


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


def test_an_effect_beside_a_model_has_its_own_unit():
    assert parameter_unit("kelvin-voigt", "second_layer", "m", "N") == "N/m"


def test_a_position_is_shown_in_thousandths_and_one_that_is_unknown_as_a_dash():
    assert small_position(0.0137, "m") == "13.7 mm"
    assert small_position(-0.2, "rad") == "-200 mrad"
    assert small_position(None, "m") == "–"


def test_a_length_among_the_parameters_is_shown_in_mm_and_an_angle_as_it_is():
    shown = parameter("travel", {"value": 4e-4, "std": 2.5e-6, "unit": "m"})
    assert shown == "travel = 0.4 ± 0.0025 mm"
    unsure = parameter("surface", {"value": -1.9576e-8, "std": 3.5e-7, "unit": "m"})
    assert unsure == "surface = -2e-05 ± 0.00035 mm"
    sure = parameter("k", {"value": 3600.348, "std": 0.4512, "unit": "N/m"})
    assert sure == "k = 3600.3 ± 0.45 N/m"
    assert parameter("gap", {"value": 2e-3, "std": None, "unit": "m"}) == "gap = 2 mm"
    assert parameter("phase", {"value": 0.5, "std": None, "unit": "rad"}) == "phase = 0.5 rad"


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
