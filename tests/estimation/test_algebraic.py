"""The algebraic regressions are identities on analytic motions, added terms included."""

import numpy as np
import pytest

from teleop_rt.estimation import algebraic
from teleop_rt_dev.estimation.regressions import algebraic as by_numpy
from teleop_rt_dev.estimation.regressions import direct, force, rich

TRUTH = {
    "mass": [0.02],
    "kelvin-voigt": [18.0, 0.02],
    "mass-spring-damper": [0.001, 18.0, 0.02],
}
FILL = {
    "mass": algebraic.mass_regression,
    "kelvin-voigt": algebraic.kelvin_voigt_regression,
    "mass-spring-damper": algebraic.mass_spring_damper_regression,
}


def windows(x, f, dt, term=None):
    """Yield the window after each sample."""
    window, extra = np.zeros(algebraic.N_LINEAR), np.zeros(algebraic.N_TERM)
    algebraic.start_linear(window, x[0], f[0])
    if term is not None:
        algebraic.start_term(extra, term[0])
    for i in range(1, len(x)):
        if term is not None:
            algebraic.advance_term(extra, term[i], window[algebraic.T], dt)
        algebraic.advance_linear(window, x[i], f[i], dt)
        yield i, window, extra


@pytest.mark.parametrize("model", TRUTH)
def test_the_regression_holds_without_derivatives(model):
    t, x, v, a = rich(2.0, rate=16000.0)
    f = force(model, TRUTH[model], x, v, a)
    phi = np.zeros(8)
    for i, window, _ in windows(x, f, t[1]):
        if i % 2000 == 0:
            y = FILL[model](window, phi)
            predicted = phi[: len(TRUTH[model])] @ TRUTH[model]
            assert predicted == pytest.approx(y, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("model", TRUTH)
def test_integrals_equal_those_of_whole_arrays(model):
    t, x, v, a = rich(1.0)
    f = force(model, TRUTH[model], x, v, a)
    expected_phi, expected_y = by_numpy(model, t, x, f)
    phi = np.zeros(8)
    for i, window, _ in windows(x, f, 1e-3):
        y = FILL[model](window, phi)
        n = expected_phi.shape[1]
        assert phi[:n] == pytest.approx(expected_phi[i], rel=1e-9, abs=1e-12)
        assert y == pytest.approx(expected_y[i], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("model", TRUTH)
def test_added_friction_and_bias_join_the_regression(model):
    t, x, v, a = rich(2.0, rate=16000.0)
    friction, bias = 1.3, -0.7
    term = np.tanh(v / 0.5)
    f = force(model, TRUTH[model], x, v, a) + friction * term + bias
    order = 1 if model == "kelvin-voigt" else 2
    slot = algebraic.J_TP if order == 1 else algebraic.JJ_T2P
    phi = np.zeros(8)
    for i, window, extra in windows(x, f, t[1], term):
        if i % 2000 == 0:
            y = FILL[model](window, phi)
            predicted = phi[: len(TRUTH[model])] @ TRUTH[model]
            predicted += friction * extra[slot] + bias * algebraic.constant_regressor(window, order)
            assert predicted == pytest.approx(y, rel=1e-4, abs=1e-6)


def test_hunt_crossley_holds_as_far_as_its_logarithm_does():
    t, x, v, a = rich(2.0, rate=4000.0)
    theta = np.array([np.log(18.0), 1e-4, 1.5])
    phi_direct, _ = direct("hunt-crossley", x, v, a, np.ones_like(x))
    log_f = phi_direct @ theta
    window, phi = np.zeros(algebraic.N_LOG), np.zeros(8)
    log_x = np.log(x)
    algebraic.start_log(window, x[0], log_x[0], log_f[0])
    for i in range(1, len(x)):
        algebraic.advance_log(window, x[i], log_x[i], log_f[i], t[1])
        if i % 500 == 0:
            y = algebraic.hunt_crossley_regression(window, phi)
            assert phi[:3] @ theta == pytest.approx(y, rel=1e-5)


def test_initial_conditions_do_not_matter():
    """The same tones from another phase: nothing of position or velocity at t0 is assumed."""
    for shift in (0, 123, 777):
        t, x, v, a = rich(2.0, rate=4000.0)
        f = force("mass-spring-damper", TRUTH["mass-spring-damper"], x, v, a)
        phi = np.zeros(8)
        for i, window, _ in windows(x[shift:], f[shift:], t[1]):
            if i == 4000:
                y = algebraic.mass_spring_damper_regression(window, phi)
                assert phi[:3] @ TRUTH["mass-spring-damper"] == pytest.approx(y, rel=1e-4)
