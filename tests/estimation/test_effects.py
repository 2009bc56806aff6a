"""Declared effects join the regressions as additive terms."""

import numpy as np
import pytest

from teleop_rt.contact.effect import Amplitude, Effect, Shape
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.report import report
from teleop_rt.estimation.rows import rows_for
from teleop_rt.kernels.jit import kernel
from teleop_rt_dev.estimation.plant import Press, hunt_crossley, kelvin_voigt, record


@kernel
def _friction(state, x, v, a, t, dt, eta):
    return np.tanh(v / eta[0])


@kernel
def _relaxing(state, x, v, a, t, dt, eta):
    state[0] += dt / eta[0] * (x - state[0])
    return x - state[0]


FRICTION = Effect(
    name="coulomb_friction",
    family="friction",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("friction", "{f}"),
    step=_friction,
    sentence="friction of {friction}",
    compensation="subtract_force",
    shapes=(Shape("smoothing", "{x}/s", 1e-4, 1e-1, 0.01),),
    derivative_order=1,
)
RELAXATION = Effect(
    name="stress_relaxation",
    family="relaxation",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("arm", "{f}/{x}"),
    step=_relaxing,
    sentence="a Maxwell arm of {arm}",
    compensation="render",
    shapes=(Shape("time_constant", "s", 1e-2, 10.0, 0.5),),
    state_size=1,
)
PRESS = Press(duration=8.0, lift_every=4.0)
BASE = {
    "period_s": 1e-3,
    "position_resolution": 5e-6,
    "force_noise": 0.05,
    "onset_force": 1.5,
    "release_force": 1.0,
    "force_lag_s": 1e-3,
    "surface": PRESS.surface,
}


def with_friction(law):
    return lambda x, v: law(x, v) + np.where(x > 0, 2.0 * np.tanh(v / 0.01), 0.0)


@pytest.mark.parametrize(
    ("regression", "tolerance"), [("direct", 0.03), ("algebraic", 0.1)], ids=["direct", "algebraic"]
)
def test_friction_beside_kelvin_voigt_is_distinguished_from_damping(regression, tolerance):
    rows = rows_for(["kelvin-voigt"], [regression], ["rls"], effects=(FRICTION,))
    pipeline = Pipeline(rows, PipelineSettings(**BASE))
    pipeline.run(*record(PRESS, with_friction(kelvin_voigt)))
    names, values, _ = pipeline.estimate(0)
    found = dict(zip(names, values, strict=True))
    assert found["coulomb_friction"] == pytest.approx(2.0, rel=tolerance)
    assert found["k"] == pytest.approx(3600, rel=0.005)
    assert found["b"] == pytest.approx(20, rel=2 * tolerance)


def test_without_the_effect_friction_is_taken_for_damping():
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), PipelineSettings(**BASE))
    pipeline.run(*record(PRESS, with_friction(kelvin_voigt)))
    assert pipeline.estimate(0)[1][1] > 30


def test_friction_leaves_the_force_before_the_logarithm_of_hunt_crossley():
    samples = record(PRESS, with_friction(hunt_crossley))
    biased = Pipeline(rows_for(["hunt-crossley"], ["direct"], ["rls"]), PipelineSettings(**BASE))
    biased.run(*samples)
    rows = rows_for(["hunt-crossley"], ["direct"], ["rls"], effects=(FRICTION,))
    freed = Pipeline(rows, PipelineSettings(**BASE, forgetting_factor=0.9995))
    freed.run(*samples)
    names, values, _ = freed.estimate(0)
    found = dict(zip(names, values, strict=True))
    assert found["coulomb_friction"] == pytest.approx(2.0, rel=0.15)
    assert found["n"] == pytest.approx(1.5, abs=0.03)
    assert found["k"] == pytest.approx(30000, rel=0.1)
    error = abs(found["b"] - 500)
    assert error < 0.25 * abs(biased.estimate(0)[1][1] - 500)


def test_an_effect_with_memory_keeps_its_own_state():
    def law(x, v):
        arm, last = np.zeros_like(x), 0.0
        for i in range(len(x)):
            last += 1e-3 / 0.5 * (x[i] - last)
            arm[i] = x[i] - last
        return np.where(x > 0, 3600 * x + 20 * v + 800 * arm, 0.0)

    rows = rows_for(["kelvin-voigt"], ["direct"], ["rls"], effects=(RELAXATION,))
    settings = PipelineSettings(**BASE, shapes={"stress_relaxation": [0.5]})
    pipeline = Pipeline(rows, settings)
    pipeline.run(*record(Press(duration=6.0, lift_every=100.0), law))
    names, values, _ = pipeline.estimate(0)
    found = dict(zip(names, values, strict=True))
    assert found["stress_relaxation"] == pytest.approx(800, rel=0.1)
    assert found["k"] == pytest.approx(3600, rel=0.03)


def test_the_report_names_effects_with_their_units():
    rows = rows_for(["kelvin-voigt"], ["direct"], ["rls"], effects=(FRICTION,))
    pipeline = Pipeline(rows, PipelineSettings(**BASE))
    pipeline.run(*record(Press(duration=3.0), with_friction(kelvin_voigt)))
    parameters = report(pipeline, "m", "N")[0]["parameters"]
    assert parameters["coulomb_friction"]["unit"] == "N"
    assert parameters["k"]["unit"] == "N/m"


def test_shapes_of_the_wrong_number_are_refused():
    rows = rows_for(["kelvin-voigt"], ["direct"], ["rls"], effects=(FRICTION,))
    with pytest.raises(ValueError, match="smoothing"):
        Pipeline(rows, PipelineSettings(**BASE, shapes={"coulomb_friction": [1.0, 2.0]}))
