"""The watch on the residual: silent on residuals of the model's own kind, awake to others."""

import dataclasses

import numpy as np
import pytest

from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for
from teleop_rt_dev.estimation.plant import Press, hunt_crossley, kelvin_voigt, record

from . import cube_rig

PRESS = Press(duration=6.0)


class Hold(Press):
    """A tool that presses once and then sinks in slowly: no excursion ever ends."""

    def position(self, t):
        down = np.minimum(t / self.ramp, 1.0)
        depth = -0.005 + down * down * (3.0 - 2.0 * down) * (self.mean + 0.005)
        return self.surface + depth + 1e-3 * np.maximum(t - self.ramp, 0.0)


HOLD = Hold(duration=5.0)
SETTINGS = dataclasses.replace(cube_rig.SETTINGS, onset_force=0.4, release_force=0.2)


def alarms(law, seed=0, models=("kelvin-voigt",), press=PRESS, **sensors):
    """At which of the samples the alarm stood."""
    pipeline = Pipeline(rows_for(models, ["direct"], ["rls"]), SETTINGS)
    position, force, valid = record(press, law, seed, **sensors)
    found = np.zeros(len(position), dtype=bool)
    for i in range(len(position)):
        pipeline.update(position[i], force[i], bool(valid[i]))
        found[i] = pipeline.inadequate
    return found


def test_no_seed_raises_a_false_alarm_on_an_adequate_model():
    raised = sum(alarms(kelvin_voigt, seed).any() for seed in range(40))
    assert raised == 0


@pytest.mark.parametrize("noise", [0.005, 0.12])
def test_noise_other_than_configured_is_no_structure(noise):
    assert not any(alarms(kelvin_voigt, seed, noise=noise).any() for seed in range(4))


def test_coloured_noise_is_no_structure():
    rng = np.random.default_rng(1)
    slow = np.zeros(len(PRESS.position(np.arange(6000) * 1e-3)))
    for i in range(1, slow.size):
        slow[i] = 0.99 * slow[i - 1] + 0.01 * rng.normal()
    position, force, valid = record(PRESS, kelvin_voigt)
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), SETTINGS)
    raised = False
    for p, f, ok, n in zip(position, force, valid, slow, strict=True):
        pipeline.update(p, f + n, bool(ok))
        raised = raised or pipeline.inadequate
    assert not raised


@pytest.mark.parametrize(
    "missing",
    [
        lambda x, v: np.where(x > 0, 3.0 * np.tanh(v / 0.005), 0.0),
        lambda x, v: np.where(x > 0, 2e5 * np.maximum(x - 0.008, 0.0) ** 2, 0.0),
        lambda x, v: np.where(x > 0, 300.0 * v * np.abs(v), 0.0),
    ],
    ids=["friction", "stiffening", "quadratic damping"],
)
def test_a_missing_effect_raises_the_alarm_and_keeps_it(missing):
    found = alarms(lambda x, v: kelvin_voigt(x, v) + missing(x, v))
    assert found[2500:].any()
    assert found[-1]


def stiffening(x, v):
    return kelvin_voigt(x, v) + np.where(x > 0, 2e6 * np.maximum(x - 0.008, 0.0) ** 2, 0.0)


def test_a_model_that_is_in_use_is_judged_though_the_hand_only_holds():
    assert alarms(stiffening, press=HOLD)[-1]
    assert not any(alarms(kelvin_voigt, seed, press=HOLD).any() for seed in range(10))


def test_a_model_that_does_fit_takes_the_alarm_back():
    alone = alarms(hunt_crossley)
    both = alarms(hunt_crossley, models=("kelvin-voigt", "hunt-crossley"))
    assert alone[-1]
    assert not both[-1]


def test_nothing_is_said_of_a_tool_that_never_touches():
    assert not alarms(lambda x, v: 0.0 * x).any()
