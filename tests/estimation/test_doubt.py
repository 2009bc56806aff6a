"""A parameter that the data do not determine is printed with the reason, alike everywhere."""

import pytest

from teleop_rt.trial.table import estimator_lines
from teleop_rt.view.style import parameter

MASS = {"value": 0.0046, "std": 1e-4, "unit": "N s^2/m"}


@pytest.mark.parametrize(
    ("changes", "doubt"),
    [
        ({}, ""),
        ({"identified": True}, ""),
        ({"std": 0.003, "identified": False}, " (not identified)"),
        ({"value": -0.0046, "identified": False}, " (not identified)"),
        ({"value": -0.0046, "std": None, "identified": False}, " (not identified)"),
        ({"std": 0.014, "identified": False}, " (not determined: its deviation exceeds it)"),
    ],
)
def test_a_mass_smaller_than_its_deviation_is_not_determined(changes, doubt):
    mass = MASS | changes
    row = {"model": "mass", "regression": "direct", "solver": "rls", "status": "estimated",
           "nrmse": None, "convergence_s": None, "parameters": {"m": mass}}  # fmt: skip
    _, line = estimator_lines({"selected": None, "estimators": [row]})
    for text in (line, parameter("m", mass)):
        assert text.endswith(f" kg{doubt}")
