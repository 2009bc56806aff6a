"""The contact law: every place that evaluates it gives the force of its one declaration."""

import math

import numpy as np
import pytest

from teleop_rt.contact.law import (
    spring_depth,
    spring_energy,
    spring_force,
    spring_force_of_log,
    spring_slope,
    touches,
)
from teleop_rt.contact.models import MODELS, contact_force
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.estimation import rows as row_kinds
from teleop_rt.estimation import walls
from teleop_rt.estimation.regressors import model_force
from teleop_rt.link.messages import ModelMessage
from teleop_rt.master.walls import wall_of
from teleop_rt.slave import felt

PARAMETERS = {"m": 0.8, "k": 900.0, "b": 12.0, "n": 1.6}
RNG = np.random.default_rng(1)
MOTIONS = [
    *zip(
        RNG.uniform(1e-4, 0.02, 30), RNG.uniform(-0.3, 0.3, 30), RNG.uniform(-5, 5, 30), strict=True
    ),
    (0.01, -200.0, 0.0),  # so fast that damping alone would pull
    (0.0, 0.1, 1.0),
    (-0.003, 0.1, 1.0),
]
CONTACT = [name for name, model in MODELS.items() if model.in_contact_only]
WITHOUT_MASS = [name for name in CONTACT if "m" not in MODELS[name].names]


def declared(name, x, v, a=0.0):
    return contact_force(name, PARAMETERS, x, v, a)


def written(name, x, v):
    """Return chapter 2's equations for a tool in contact, without any code of the package."""
    _, k, b, n = PARAMETERS.values()
    force = {
        "kelvin-voigt": k * x + b * v,
        "kelvin-voigt-unilateral": k * x + b * max(v, 0.0),
        "hunt-crossley": max(0.0, k * x**n + b * x**n * v) if x > 0 else 0.0,
    }[name]
    return force if x > 0.0 else 0.0


@pytest.mark.parametrize("exponent", [0.8, 1.0, 1.6])
def test_depth_and_slope_of_a_spring_belong_to_its_force(exponent):
    for x, _, _ in MOTIONS:
        if x > 0.0:
            force = spring_force(x, 900.0, exponent)
            assert spring_depth(force, 900.0, exponent) == pytest.approx(x, rel=1e-12)
            rise = spring_force(1.001 * x, 900.0, exponent) - spring_force(
                0.999 * x, 900.0, exponent
            )
            slope = spring_slope(x, 900.0, exponent)
            assert slope == pytest.approx(rise / (0.002 * x), rel=1e-6)


@pytest.mark.parametrize("exponent", [0.8, 1.0, 1.6])
def test_the_logarithm_and_the_energy_of_a_spring_belong_to_its_force(exponent):
    for x in (x for x, _, _ in MOTIONS if x > 0.0):
        force = spring_force(x, 900.0, exponent)
        assert spring_force_of_log(x, math.log(900.0), exponent) == pytest.approx(force, rel=1e-12)
        depths = np.linspace(0.0, x, 2001)
        work = np.trapezoid(spring_force(depths, 900.0, exponent), depths)
        assert spring_energy(x, 900.0, exponent) == pytest.approx(work, rel=1e-4)


def test_a_tool_at_the_surface_is_in_free_air_by_one_rule_for_a_sample_and_for_many():
    depths = np.array([-1e-9, 0.0, 1e-9, np.nan])
    assert touches(depths).tolist() == [touches(float(x)) for x in depths]
    assert touches(depths).tolist() == [False, False, True, False]


@pytest.mark.parametrize("name", WITHOUT_MASS)
def test_the_declaration_is_the_law_of_the_report(name):
    for x, v, _ in MOTIONS:
        assert declared(name, x, v) == pytest.approx(written(name, x, v), rel=1e-12)


@pytest.mark.parametrize("name", CONTACT)
def test_the_effects_of_a_model_add_up_to_it_unless_it_would_pull(name):
    shape = np.array([PARAMETERS["n"]])
    for x, v, a in MOTIONS:
        total = sum(
            PARAMETERS[effect.amplitude.name] * effect.step(np.zeros(1), x, v, a, 0.0, 1e-3, shape)
            for effect in MODELS[name].effects
        )
        if x > 0.0 and not (name == "hunt-crossley" and total < 0.0):
            assert declared(name, x, v, a) == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("name", CONTACT)
def test_the_bank_predicts_the_law(name):
    values = [PARAMETERS[p] for p in MODELS[name].names]
    theta = np.array(values)
    if name == "hunt-crossley":
        k, b, n = values
        theta = np.array([math.log(k), b / k, n])
    for x, v, a in (motion for motion in MOTIONS if motion[0] > 0.0):
        found = model_force(row_kinds.MODEL_CODES[name], theta, x, v, max(v, 0.0), a)
        assert found == pytest.approx(declared(name, x, v, a), rel=1e-9)


@pytest.mark.parametrize("name", WITHOUT_MASS)
def test_the_slave_judges_what_is_felt_by_the_law(name):
    wall = np.zeros(felt.N_WALL)
    wall[walls.MODEL], wall[walls.SURFACE] = row_kinds.MODEL_CODES[name], 0.0137
    wall[walls.K], wall[walls.B], wall[walls.N] = (PARAMETERS[key] for key in "kbn")
    for x, v, _ in MOTIONS:
        found = felt.wall_force(wall, 0.0137 + x, v)
        assert found == pytest.approx(declared(name, x, v), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", WITHOUT_MASS)
def test_the_master_renders_the_law_where_it_pushes(name):
    k, b, n = (PARAMETERS[key] for key in "kbn")
    wall = wall_of(ModelMessage(name, 1, 1, surface=0.0137, k=k, b=b, n=n))
    assert wall is not None
    for x, v, _ in MOTIONS:
        found = wall.force(0.0137 + x, v)
        assert found == pytest.approx(max(0.0, declared(name, x, v)), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", CONTACT)
def test_the_bases_of_diagnosis_are_the_law_before_it_is_clamped(name):
    base = base_of(name)
    x, v, a = np.array(MOTIONS).T
    columns = base.columns(x, v, a, PARAMETERS["n"])
    total = sum(PARAMETERS[t.name] * c for t, c in zip(base.terms, columns, strict=True))
    if name == "hunt-crossley":
        total = np.maximum(total, 0.0)
    expected = [declared(name, *motion) for motion in MOTIONS]
    assert total == pytest.approx(expected, rel=1e-12, abs=1e-12)
