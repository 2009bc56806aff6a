from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from teleop_rt.link.messages import ModelMessage
from teleop_rt.master.screening import INSISTENCE, Screening

FINITE = st.floats(allow_nan=False, allow_infinity=False)


def kelvin_voigt(k: float, b: float = 20.0) -> ModelMessage:
    return ModelMessage("kelvin-voigt", 1, 1, 0.0, k=k, b=b)


def test_a_plausible_model_passes_unchanged() -> None:
    model = kelvin_voigt(3600.0)
    screening = Screening(0.006, 12.0)
    assert screening.check(model) is model
    assert not screening.refused


@pytest.mark.parametrize(
    ("model", "reason"),
    [
        (kelvin_voigt(-1.0), "negative stiffness"),
        (ModelMessage("hunt-crossley", 1, 1, 0.0, k=1500.0, n=0.2), "exponent"),
        (ModelMessage("hunt-crossley", 1, 1, 0.0, k=1500.0, n=25.0), "exponent"),
        (
            ModelMessage("hunt-crossley", 1, 1, 0.0, surface_known=False, k=1500.0, n=1.5),
            "no surface",
        ),
        (ModelMessage("kelvin-voigt", 1, 1, 0.0, surface_known=False, offset=1.0), "no stiffness"),
        (kelvin_voigt(1e300), "range"),
        (kelvin_voigt(3600.0, b=1e300), "range"),
        (ModelMessage("kelvin-voigt", 1, 1, 1e300, k=3600.0), "range"),
    ],
)
def test_an_impossible_model_is_refused_and_counted(model: ModelMessage, reason: str) -> None:
    screening = Screening(0.006, 12.0)
    assert screening.check(model) is None
    assert screening.refused == {reason: 1}


@pytest.mark.parametrize(("k", "n", "rendered"), [
    (14_000.0, 0.985, 1.0), (900.0, 0.5, 1.0), (3e12, 5.6, 5.0), (1e19, 9.0, 5.0),
])  # fmt: skip
def test_an_exponent_that_cannot_be_rendered_still_replaces_a_wilder_wall(
    k: float, n: float, rendered: float
) -> None:
    """Refused, it left the hand on 70 kN/m while the slave's estimators said 15."""
    screening = Screening(0.006, 12.0)
    screening.check(kelvin_voigt(min(70_000.0, 10 * k * 0.006 ** (n - 1))))
    checked = screening.check(ModelMessage("hunt-crossley", 1, 1, 0.0, k=k, b=50.0, n=n))
    assert checked is not None
    assert checked.n == rendered
    assert checked.k * 0.006**rendered == pytest.approx(k * 0.006**n)
    assert screening.clamped == 1
    assert not screening.refused


def test_negative_damping_is_rendered_as_none_and_counted() -> None:
    screening = Screening(0.006, 12.0)
    checked = screening.check(kelvin_voigt(3.6, b=-0.02))
    assert checked == kelvin_voigt(3.6, b=0.0)
    assert screening.clamped == 1


@pytest.mark.parametrize("factor", [150.0, 1 / 150.0, 0.0])
def test_a_jump_is_refused_until_it_is_insisted_on(factor: float) -> None:
    screening = Screening(0.006, 12.0)
    screening.check(kelvin_voigt(3600.0))
    jumped = kelvin_voigt(3600.0 * factor)
    for _ in range(INSISTENCE - 1):
        assert screening.check(jumped) is None
    assert screening.check(jumped) is jumped
    assert screening.refused == {"jump": INSISTENCE - 1}


def test_wild_estimates_that_do_not_agree_are_never_accepted() -> None:
    screening = Screening(0.006, 12.0)
    screening.check(kelvin_voigt(36.0))
    for n in range(1000):
        assert screening.check(kelvin_voigt(36.0 * (200 if n % 2 else 1000))) is None
    assert screening.check(kelvin_voigt(40.0)) is not None


def test_stiffness_of_different_models_is_compared_by_force() -> None:
    screening = Screening(0.006, 12.0)
    screening.check(kelvin_voigt(3600.0))
    stiffness = 3600 * 0.006 ** (1 - 1.5)
    assert screening.check(ModelMessage("hunt-crossley", 1, 1, 0.0, k=stiffness, n=1.5)) is not None


@given(st.lists(st.tuples(FINITE, FINITE), max_size=50))
def test_whatever_passes_has_no_negative_parameter(parameters: list[tuple[float, float]]) -> None:
    screening = Screening(0.006, 12.0)
    for k, b in parameters:
        checked = screening.check(kelvin_voigt(k, b))
        assert checked is None or (checked.k >= 0 and checked.b >= 0)


def test_a_surface_that_the_slave_cannot_reach_is_refused() -> None:
    screening = Screening(0.001, farthest=10.0, surface_farthest=0.2)
    for surface in (8e11, -8e11, 0.21, 5.0):
        assert screening.check(ModelMessage("kelvin-voigt", 1, 1, surface, k=3600.0)) is None
    assert screening.refused == {"range": 4}
    assert screening.check(ModelMessage("kelvin-voigt", 1, 1, 0.19, k=3600.0)) is not None
