"""A wall's law as the kernel of a tick computes it, against the wall itself and the formulas."""

import math

import numpy as np
import pytest

from teleop_rt.kernels.jit import bound
from teleop_rt.master.wall_law import felt
from teleop_rt.master.walls import NO_WALL, Wall

SURFACE, FORCE_MAX = 0.05, 20.0
KELVIN_VOIGT = Wall(SURFACE, 3600.0, 20.0)
WALLS = {
    "kelvin-voigt": KELVIN_VOIGT,
    "damped one way": Wall(SURFACE, 3600.0, 20.0, approach_only=True),
    "hunt-crossley": Wall(SURFACE, 9e4, 800.0, 1.7, 1.7),
    "bent": Wall(SURFACE, 9e4, 800.0, 1.7, 1.7, stiffest=900.0, damped_depth=0.004, calming=3.0),
    "softer all along": Wall(SURFACE, 3600.0, 20.0, stiffest=1000.0),
    "bilateral": Wall(SURFACE, 800.0, 5.0, bilateral=True, offset=2.0),
    "moving": Wall(SURFACE, 3600.0, 20.0, surface_velocity=0.03),
    "none": NO_WALL,
}


@pytest.fixture(scope="module")
def kernel():
    return bound(felt, (), *NO_WALL.law, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", WALLS)
def test_the_kernel_answers_as_the_wall_does(kernel, name):
    wall, rng = WALLS[name], np.random.default_rng(5)
    for _ in range(300):
        position, velocity = SURFACE + rng.uniform(-0.002, 0.012), rng.uniform(-0.3, 0.3)
        force, spring, stored_J = kernel(*wall.law, position - wall.surface, velocity, FORCE_MAX)
        assert force == max(-FORCE_MAX, min(FORCE_MAX, wall.force(position, velocity)))
        assert spring == max(-FORCE_MAX, min(FORCE_MAX, wall.elastic_force(position)))
        assert stored_J == wall.energy(position, FORCE_MAX)


def test_the_kernel_answers_by_the_formulas(kernel):
    x, v = 0.004, 0.05
    force, spring, stored_J = kernel(*KELVIN_VOIGT.law, x, v, 100.0)
    assert (force, spring) == pytest.approx((3600 * x + 20 * v, 3600 * x))
    assert stored_J == pytest.approx(0.5 * 3600 * x * x)
    force, spring, stored_J = kernel(*WALLS["hunt-crossley"].law, x, v, 100.0)
    assert force == pytest.approx(x**1.7 * (9e4 + 800 * v))
    assert stored_J == pytest.approx(9e4 * x**2.7 / 2.7)
    assert kernel(*WALLS["moving"].law, x, 0.03, 100.0)[0] == pytest.approx(3600 * x)
    assert kernel(*WALLS["damped one way"].law, x, -v, 100.0)[0] == pytest.approx(3600 * x)


@pytest.mark.parametrize("v", [0.0, 0.2])
def test_a_bent_spring_goes_on_straight_from_its_knee(kernel, v):
    wall = WALLS["bent"]
    knee = wall.law.knee
    assert 1.7 * 9e4 * knee**0.7 == pytest.approx(900.0)
    at_knee, deeper = (kernel(*wall.law, x, 0.0, math.inf)[1] for x in (knee, knee + 0.003))
    assert deeper - at_knee == pytest.approx(900.0 * 0.003)
    damping = kernel(*wall.law, 0.009, v, math.inf)[0] - kernel(*wall.law, 0.009, 0.0, math.inf)[0]
    assert damping == pytest.approx((800.0 * 0.004**1.7 + 3.0) * v)


def test_outside_nothing_is_felt_and_nothing_is_beyond_the_largest_force(kernel):
    assert kernel(*KELVIN_VOIGT.law, 0.0, -1.0, FORCE_MAX) == (0.0, 0.0, 0.0)
    assert kernel(*KELVIN_VOIGT.law, 0.001, -1.0, FORCE_MAX)[0] == 0.0, "no wall pulls"
    force, spring, stored_J = kernel(*KELVIN_VOIGT.law, 0.02, 0.1, FORCE_MAX)
    assert (force, spring) == (FORCE_MAX, FORCE_MAX)
    yields = FORCE_MAX / 3600.0
    assert stored_J == pytest.approx(FORCE_MAX * (0.02 - yields) + 0.5 * FORCE_MAX * yields)


def test_a_spring_that_may_have_no_slope_gives_no_force():
    wall = Wall(SURFACE, 9e4, 0.0, 1.7, 1.7, stiffest=0.0)
    assert wall.force(SURFACE + 0.01, 0.0) == 0.0
