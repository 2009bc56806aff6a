"""The model to stream is chosen by open-loop force error, without flapping; changes are tracked."""

import numpy as np
import pytest

from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.rows import rows_for
from teleop_rt.estimation.tracking import tracking_delay
from teleop_rt_dev.estimation.plant import Press, hunt_crossley, kelvin_voigt, record

BASE = {
    "period_s": 1e-3,
    "position_resolution": 5e-6,
    "force_noise": 0.05,
    "onset_force": 0.5,
    "release_force": 0.3,
    "force_lag_s": 1e-3,
}
MODELS = ["kelvin-voigt", "mass-spring-damper", "hunt-crossley"]


def choices(trace):
    selected = trace.signals[:, 5]
    return selected[np.concatenate([[True], np.diff(selected) != 0])].astype(int).tolist()


def test_the_simplest_of_equals_is_streamed_and_kept():
    rows = rows_for(MODELS, ["direct", "algebraic"], ["rls"])
    pipeline = Pipeline(rows, PipelineSettings(**BASE))
    for seed in range(5):
        pipeline.reset()
        trace = pipeline.run(*record(Press(), kelvin_voigt, seed=seed))
        assert choices(trace) == [-1, 0]


def test_a_better_model_takes_over_once():
    rows = rows_for(MODELS, ["direct"], ["rls"])
    pipeline = Pipeline(rows, PipelineSettings(**BASE))
    for seed in range(5):
        pipeline.reset()
        trace = pipeline.run(*record(Press(), hunt_crossley, seed=seed))
        assert choices(trace) == [-1, 0, 2]


def test_predictions_come_from_parameters_of_an_excursion_before():
    """After a step in stiffness the first prediction still is that of the old material."""

    def law(x, v):
        k = np.where(np.arange(len(x)) < 5000, 3600.0, 1800.0)
        return np.where(x > 0, k * x + 20 * v, 0.0)

    rows = rows_for(["kelvin-voigt"], ["direct"], ["rls"])
    pipeline = Pipeline(rows, PipelineSettings(**BASE, forgetting_factor=0.98))
    samples = record(Press(duration=6.0, lift_every=100.0), law)
    for i, (position, force, valid) in enumerate(zip(*samples, strict=True)):
        pipeline.update(position, force, valid)
        if i == 5300:
            k = pipeline.estimate(0)[1][0]
            assert k == pytest.approx(1800, rel=0.03), "the row itself has followed"
            old = 3600 * (pipeline.contact.penetration)
            assert pipeline.predicted_force(0) > 0.75 * old, "its prediction has not"


@pytest.mark.parametrize("solver", ["rls", "sprls", "ni-sprls", "gn-vff-rls"])
def test_steps_and_ramps_of_stiffness_are_tracked(solver):
    def stiffness(t):
        ramp = 3600 + np.clip((t - 6.0) / 2.0, 0, 1) * 1200
        return np.where(t < 4.0, 2400.0, ramp)

    def law(x, v):
        t = np.arange(len(x)) * 1e-3
        return np.where(x > 0, stiffness(t) * x + 20 * v, 0.0)

    press = Press(duration=11.0, lift_every=100.0)
    rows = rows_for(["kelvin-voigt"], ["direct"], [solver])
    pipeline = Pipeline(rows, PipelineSettings(**BASE, forgetting_factor=0.995))
    trace = pipeline.run(*record(press, law))
    k = trace.physical(0, "k")
    t = (np.arange(len(k)) + 1) * trace.period_s
    assert k[-1] == pytest.approx(4800, rel=0.02)
    assert k[5900] == pytest.approx(3600, rel=0.02)
    delay = tracking_delay(t[2000:], k[2000:], stiffness(t)[2000:])
    assert 0.0 <= delay < 0.6


def test_plain_rls_without_forgetting_is_seen_to_lag():
    t = np.arange(0, 10, 1e-3)
    truth = np.where(t < 5, 1.0, 2.0)
    lagged = np.where(t < 5.25, 1.0, 2.0)
    assert tracking_delay(t, lagged, truth) == pytest.approx(0.25, abs=2e-3)
    assert tracking_delay(t, truth, truth) == pytest.approx(0.0, abs=2e-3)
    assert tracking_delay(t, np.ones_like(t), truth) is None
    assert tracking_delay(t, lagged, np.ones_like(t)) is None


def exact_wall():
    """Free air, then an exact Kelvin-Voigt wall: position [m] and force [N] at 1 kHz."""
    t = np.arange(0.0, 6.0, 1e-3)
    x = 0.012 * np.sin(2 * np.pi * 0.9 * t) + 0.002 * np.sin(2 * np.pi * 2.3 * t)
    v = np.gradient(x, t)
    return x, np.where(x > 0, np.maximum(2500.0 * x + 12.0 * v, 0.0), 0.0), t >= 0.0


def test_a_free_mass_never_wins_over_a_wall_met_from_free_air():
    models = ["mass", "kelvin-voigt", "mass-spring-damper", "hunt-crossley"]
    pipeline = Pipeline(rows_for(models), PipelineSettings(**BASE | {"force_lag_s": 0.0}))
    trace = pipeline.run(*exact_wall())
    chosen = {pipeline.rows[row].model for row in choices(trace) if row >= 0}
    assert "mass" not in chosen
    selected = pipeline.rows[pipeline.selected]
    assert selected.model == "kelvin-voigt"
    assert pipeline.nrmse(pipeline.selected) < 0.02


def test_a_row_of_negative_mass_or_stiffness_is_never_streamed():
    x, force, valid = exact_wall()
    rows = rows_for(["mass"], ["direct"], ["rls"])
    pipeline = Pipeline(rows, PipelineSettings(**BASE | {"force_lag_s": 0.0}))
    pipeline.run(x, force, valid)
    assert pipeline.estimate(0)[1][0] < 0.0, "in a wall's force a free mass comes out negative"
    assert pipeline.selected == -1
