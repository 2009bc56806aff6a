"""Known properties of the answers: S1 to S4 and S6 to S11; S5 is the silicone trial."""

import numpy as np
import pytest

from teleop_rt.estimation.bank import Bank, SolverSettings
from teleop_rt.estimation.layout import COVARIANCE
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.rows import SOLVERS, rows_for
from teleop_rt_dev.estimation import oracle
from teleop_rt_dev.estimation.plant import Press, kelvin_voigt, record
from teleop_rt_dev.estimation.regressions import algebraic, direct, force, sine

FREQUENCIES = (0.5, 1.0, 3.0, 5.0, 10.0)
TRUTH = {"kelvin-voigt": [1500.0, 50.0], "hunt-crossley": [1500.0, 50.0, 1.5]}


def theta_over_time(model, regression, solver, frequency, duration=10.0, settings=None):
    t, x, v, a = sine(frequency, duration=duration)
    f = force(model, TRUTH[model], x, v, a)
    made = direct(model, x, v, a, f) if regression == "direct" else algebraic(model, t, x, f)
    phi, y = made
    n = phi.shape[1]
    bank = Bank([solver], [n], settings or SolverSettings())
    theta = np.empty((len(y), n))
    for i in range(len(y)):
        bank.step(phi[i : i + 1], y[i : i + 1])
        theta[i] = bank.theta[0, :n]
    if model == "hunt-crossley":
        k = np.exp(theta[:, 0])
        theta = np.column_stack([k, k * theta[:, 1], theta[:, 2]])
    return theta


def settling(theta, truth):
    outside = np.nonzero(np.abs(theta - truth) > 0.02 * abs(truth))[0]
    return (outside[-1] + 1) / 1000 if len(outside) else 0.0


def nrmse(model, theta, frequency):
    _, x, v, a = sine(frequency, duration=2.0)
    f = force(model, TRUTH[model], x, v, a)
    return np.sqrt(np.mean((f - force(model, theta, x, v, a)) ** 2)) / np.ptp(f)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("regression", ["direct", "algebraic"])
@pytest.mark.parametrize("model", TRUTH)
def test_s1_every_method_converges_without_noise(model, regression, solver):
    for frequency in (1.0, 10.0):
        theta = theta_over_time(model, regression, solver, frequency, duration=4.0)
        assert theta[-1] == pytest.approx(TRUTH[model], rel=0.02)


@pytest.mark.parametrize("model", TRUTH)
def test_s2_convergence_time_falls_as_the_frequency_rises(model):
    times = [
        settling(theta_over_time(model, "direct", "rls", f, 2.0)[:, 1], 50.0) for f in FREQUENCIES
    ]
    assert times == sorted(times, reverse=True)
    assert times[0] > 5 * times[-1]


def test_s3_integral_criterion_is_fastest_on_kelvin_voigt_without_overshoot():
    for frequency in FREQUENCIES:
        theta = theta_over_time("kelvin-voigt", "direct", "iec", frequency, 1.0)
        assert settling(theta[:, 0], 1500.0) <= 0.001
        assert np.max(theta) <= 1500.0 * (1 + 1e-6)
        rls = theta_over_time("kelvin-voigt", "direct", "rls", frequency, 1.0)
        assert settling(rls[:, 0], 1500.0) > 0.001


def test_s4_force_error_hardly_depends_on_frequency():
    rng = np.random.default_rng(4)
    errors = []
    for frequency in FREQUENCIES:
        _, x, v, a = sine(frequency, duration=4.0)
        f = force("kelvin-voigt", TRUTH["kelvin-voigt"], x, v, a)
        noise = 0.02 * np.ptp(f) * rng.normal(size=len(f))
        phi, y = direct("kelvin-voigt", x, v, a, f + noise)
        bank = Bank(["rls"], [2])
        for i in range(len(y)):
            bank.step(phi[i : i + 1], y[i : i + 1])
        errors.append(np.sqrt(np.mean((y - phi @ bank.theta[0, :2]) ** 2)) / np.ptp(y))
    assert max(errors) < 1.1 * min(errors)


@pytest.mark.parametrize(
    ("frequency", "expected"),
    list(zip(FREQUENCIES, (0.085, 0.052, 0.024, 0.016, 0.010), strict=True)),
)
def test_s6_kelvin_voigt_settling_times_of_an_independent_implementation(frequency, expected):
    rls = theta_over_time("kelvin-voigt", "direct", "rls", frequency, 1.0)
    assert settling(rls[:, 0], 1500.0) == pytest.approx(expected, abs=1e-3)
    integral = theta_over_time("kelvin-voigt", "direct", "iec", frequency, 1.0)
    assert settling(integral[:, 0], 1500.0) == pytest.approx(1e-3, abs=1e-9)
    slow = theta_over_time("kelvin-voigt", "algebraic", "rls", frequency, 10.0)
    assert 0.34 <= settling(slow[:, 0], 1500.0) <= 0.56


@pytest.mark.parametrize(
    ("frequency", "expected"),
    list(zip(FREQUENCIES, (0.39, 0.19, 0.066, 0.040, 0.021), strict=True)),
)
def test_s7_hunt_crossley_settling_and_force_error(frequency, expected):
    rls = theta_over_time("hunt-crossley", "direct", "rls", frequency, 10.0)
    assert settling(rls[:, 1], 50.0) == pytest.approx(expected, abs=5e-3)
    for solver in SOLVERS:
        theta = theta_over_time("hunt-crossley", "direct", solver, frequency, 10.0)
        assert nrmse("hunt-crossley", theta[-1], frequency) < 1.1e-4


def test_s8_integral_criterion_finds_hunt_crossley_damping_but_noise_hides_it():
    _, x, v, a = sine(3.0, 0.005, 0.002, 10.0)
    f = force("hunt-crossley", TRUTH["hunt-crossley"], x, v, a)
    assert np.mean(f) == pytest.approx(0.55, abs=0.03)
    assert np.max(np.abs(v)) * 50 / 1500 < 0.0013

    def damping(measured):
        phi, y = direct("hunt-crossley", x, v, a, measured)
        phi[:, 2] -= np.log(5e-3)
        bank = Bank(["iec"], [3])
        for i in range(len(y)):
            bank.step(phi[i : i + 1] * f[i], y[i : i + 1] * f[i])
        k = np.exp(bank.theta[0, 0] - bank.theta[0, 2] * np.log(5e-3))
        return k * bank.theta[0, 1]

    assert damping(f) == pytest.approx(50.0, abs=0.1)
    found = []
    for seed in range(8):
        noise = 0.05 * np.random.default_rng(seed).normal(size=len(f))
        found.append(damping(np.maximum(f + noise, 0.01)))
    assert np.std(found) > 25.0


@pytest.mark.parametrize(("lag_ms", "expected"), [(0.5, 49.2), (1.0, 48.5), (2.0, 47.0)])
def test_s9_lag_of_the_force_biases_damping_and_alignment_removes_it(lag_ms, expected):
    press = Press(duration=4.0, lift_every=100.0)

    def law(x, v):
        return kelvin_voigt(x, v, k=1500.0, b=50.0)

    samples = record(press, law, lag=lag_ms * 1e-3, noise=1e-3)
    found = {}
    for corrected in (False, True):
        settings = PipelineSettings(
            period_s=1e-3,
            position_resolution=5e-6,
            force_noise=0.01,
            onset_force=0.5,
            release_force=0.3,
            force_lag_s=lag_ms * 1e-3 if corrected else 0.0,
            surface=press.surface,
        )
        pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), settings)
        pipeline.run(*samples)
        found[corrected] = pipeline.estimate(0)[1][1]
    assert found[False] == pytest.approx(expected, abs=0.12)
    assert found[True] == pytest.approx(50.0, abs=0.1)


def test_s10_one_sinusoid_about_zero_does_not_excite_a_mass_spring_damper():
    def condition(mean, amplitude, bias=False):
        _, x, v, a = sine(3.0, mean, amplitude, 4.0)
        phi, y = direct("mass-spring-damper", x, v, a, 3600 * x + 20 * v)
        phi = np.column_stack([phi, np.ones_like(x)]) if bias else phi
        phi = phi / np.sqrt(np.mean(phi**2, axis=0))
        bank = Bank(["iec"], [phi.shape[1]])
        for i in range(len(y)):
            bank.step(phi[i : i + 1], y[i : i + 1])
        ready = bank.status[0]
        return bank.condition(0), ready

    blind, status = condition(0.0, 0.008)
    assert blind > 1e12
    assert status == 0
    assert condition(0.005, 0.001)[0] < 1.5
    assert condition(0.005, 0.001)[1] == 1
    assert condition(0.005, 0.001, bias=True)[0] > 1e12


def test_s11_plain_rls_winds_up_and_the_bank_does_not():
    phi = np.array([1.0, 0.5, 0.2])
    truth = np.array([3600.0, 20.0, 5.0])
    rng = np.random.default_rng(0)
    y = float(phi @ truth) + 0.05 * rng.normal(size=40_000)
    plain = oracle.Rls(3, 1e6, 0.995)
    failed = None
    for i in range(20_000):
        plain.step(phi.tolist(), y[i])
        if max(abs(t) for t in plain.theta) > 1e6 or min(plain.P[j][j] for j in range(3)) < 0:
            failed = i
            break
    assert failed is not None
    assert 5_000 < failed < 15_000
    bank = Bank(["rls"], [3], SolverSettings(forgetting=0.995))
    traces = []
    for _ in range(10):  # 40 times as long as the plain solver stands
        bank.run(np.tile(phi, (40_000, 1, 1)), y[:, None])
        traces.append(np.trace(bank.state[0, COVARIANCE : COVARIANCE + 64].reshape(8, 8)))
    assert np.all(np.isfinite(bank.state))
    assert bank.restarts[0] == 0, "kept bounded, not rescued"
    assert max(traces) <= 1e3 * 3 * 1e6
    assert max(traces[5:]) <= 1.001 * max(traces[:5]), "nothing that grows is left"
    assert phi @ bank.theta[0, :3] == pytest.approx(phi @ truth, abs=0.05)
    assert np.max(np.abs(bank.theta)) < 1e4
