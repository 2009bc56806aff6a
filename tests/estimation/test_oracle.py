"""The bank agrees with plain-Python solvers on every combination of model and regression."""

import numpy as np
import pytest

from teleop_rt.estimation.bank import Bank, SolverSettings
from teleop_rt.estimation.rows import REGRESSIONS, SOLVERS, allowed
from teleop_rt_dev.estimation import oracle
from teleop_rt_dev.estimation.regressions import algebraic, direct, force, rich

TRUTH = {
    "mass": [0.02],
    "kelvin-voigt": [18.0, 0.02],
    "kelvin-voigt-unilateral": [18.0, 0.02],
    "mass-spring-damper": [0.001, 18.0, 0.02],
    "hunt-crossley": [18.0, 0.02, 1.5],
}
COMBINATIONS = [
    (model, regression)
    for model in TRUTH
    for regression in REGRESSIONS
    if allowed(model, regression)
]
SETTINGS = SolverSettings(
    forgetting=0.998, beta=1e-3, gamma=8.0, gamma_noise_immunised=0.4, noise_variance=1e-3
)


def plain(solver, n):
    one = SETTINGS
    return {
        "rls": lambda: oracle.Rls(n, one.prior, one.forgetting),
        "sprls": lambda: oracle.Sprls(n, one.beta, one.gamma, one.prior, one.forgetting),
        "ni-sprls": lambda: oracle.NiSprls(
            n,
            one.beta,
            one.gamma_noise_immunised,
            one.noise_variance,
            one.rho,
            one.prior,
            one.forgetting,
        ),
        "gn-vff-rls": lambda: oracle.GnVffRls(
            n, one.alpha, one.lambda_min, one.lambda_max, one.delta_start, 1e-12, one.prior
        ),
        "iec": lambda: oracle.Iec(n, one.forgetting),
    }[solver]()


def data(model, regression, samples=300):
    t, x, v, a = rich(1.0)
    noise = 0.03 * np.random.default_rng(1).normal(size=len(t))
    f = force(model, TRUTH[model], x, v, a)
    f = f * np.exp(noise) if model == "hunt-crossley" else f + noise
    # Algebraic regressions vanish at t = 0: the window is half a second old, as in a long contact.
    first = 500 if regression == "algebraic" else 0
    made = direct(model, x, v, a, f) if regression == "direct" else algebraic(model, t, x, f)
    phi, y = made
    return phi[first : first + samples], y[first : first + samples]


@pytest.mark.parametrize(("model", "regression"), COMBINATIONS)
@pytest.mark.parametrize("solver", SOLVERS)
def test_bank_agrees_with_plain_python_sample_by_sample(model, regression, solver):
    phi, y = data(model, regression)
    # Scaled to near one, as the pipeline does; the solvers themselves know no units.
    scale = np.sqrt(np.mean(phi**2, axis=0))
    phi = phi / scale
    n = phi.shape[1]
    bank = Bank([solver], [n], SETTINGS)
    reference = plain(solver, n)
    for i in range(len(y)):
        bank.step(phi[i : i + 1], y[i : i + 1])
        reference.step(phi[i].tolist(), float(y[i]))
        if solver == "iec" and bank.count[0] == 0:
            continue
        expected = np.array(reference.theta)
        # Before there are a few samples per parameter the problem itself is near singular.
        if i >= 20:
            worst = np.max(np.abs(bank.theta[0, :n] - expected) / np.maximum(1.0, abs(expected)))
            assert worst <= 1e-8, f"sample {i}"
    assert bank.restarts[0] == 0
    assert np.any(bank.theta[0, :n] != 0.0)


def test_self_perturbing_rows_are_in_fact_perturbed_in_this_comparison():
    phi, y = data("kelvin-voigt", "direct")
    thetas = []
    for solver in ("rls", "sprls", "ni-sprls", "gn-vff-rls"):
        bank = Bank([solver], [2], SETTINGS)
        for i in range(len(y)):
            bank.step(phi[i : i + 1], y[i : i + 1])
        thetas.append(bank.theta[0, :2].copy())
    for i, theta in enumerate(thetas):
        assert all(not np.allclose(theta, other, rtol=1e-6) for other in thetas[:i])
