"""An extended model on-line: terms are estimated, samples corrected, spoilt ones masked."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.contact.fitted import ExtendedModelError
from teleop_rt.estimation.corrections import Corrections
from teleop_rt.estimation.extension import extension_from
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.rows import rows_for
from teleop_rt.offline.closing import handled
from teleop_rt_dev.estimation.plant import Press, kelvin_voigt, record

from . import cube_rig
from .streamed_wall import streamed

PRESS = Press(duration=8.0)
SETTINGS = dataclasses.replace(cube_rig.SETTINGS, onset_force=0.4, release_force=0.2)


def document(*effects, base="kelvin-voigt"):
    entries = [{"name": n, "law": law, "parameters": p} for n, law, p in effects]
    return {"base": {"model": base, "parameters": {}}, "effects": entries}


def run(samples, *effects, settings=SETTINGS, base="kelvin-voigt"):
    """The pipeline after a run, with the effects beside the base."""
    extension = extension_from("model.yaml", document(*effects, base=base))
    rows = rows_for([base], ["direct"], ["rls"])
    if effects:
        rows, settings = extension.rows(rows), extension.settings(settings)
    pipeline = Pipeline(rows, settings)
    pipeline.run(*samples)
    return pipeline


def estimates(pipeline, row=0):
    names, values, _ = pipeline.estimate(row)
    return dict(zip(names, values, strict=True))


STIFFENING = ("nonlinear_stiffening", "power", {"stiffening": 3e5, "power": 2.0})
FRICTION = (
    "coulomb_friction",
    "smoothed sign",
    {"friction_force": 2.0, "smoothing_velocity": 0.01},
)


def stiffening(x, v):
    return kelvin_voigt(x, v) + 2.4e5 * np.maximum(x, 0.0) ** 2


def assert_streamed_as_estimated(pipeline):
    """The numbers of the wall are those of the selected row's estimate."""
    wall, row = streamed(pipeline), pipeline.rows[pipeline.selected]
    found = {"k": 0.0, "b": 0.0, "n": 1.0, "offset": 0.0, "m": 0.0}
    found |= estimates(pipeline, pipeline.selected)
    assert wall.model == row.model
    assert [wall.k, wall.b, wall.n, wall.offset, wall.m] == [
        found[name] for name in ("k", "b", "n", "offset", "m")
    ]
    effects = pipeline.streaming.effects
    assert wall.amplitudes == tuple(
        found.get(one.effect.name, one.amplitude) for one in effects[: len(wall.amplitudes)]
    )


def test_an_amplitude_is_estimated_beside_the_base_and_streamed_to_the_master():
    pipeline = run(record(PRESS, stiffening), STIFFENING)
    assert [row.effects_are for row in pipeline.rows] == ["frozen", "estimated"]
    found = estimates(pipeline, 1)
    assert found["k"] == pytest.approx(3600, rel=0.01)
    assert found["nonlinear_stiffening"] == pytest.approx(2.4e5, rel=0.02)
    (effect,) = pipeline.streaming.effects
    assert effect.effect.name == "nonlinear_stiffening"
    assert streamed(pipeline).amplitudes == pytest.approx((2.4e5,), rel=0.02)
    assert streamed(pipeline).time_s == pytest.approx(8.0, abs=0.01)
    assert_streamed_as_estimated(pipeline)


def test_where_the_data_cannot_decide_yet_the_diagnosed_amplitude_is_streamed():
    """Pressed once, and shallow: stiffness and stiffening look alike."""
    shallow = Press(duration=1.2, mean=0.004, amplitude=0.0002, lift_every=10.0)
    law = lambda x, v: kelvin_voigt(x, v) + 3e5 * np.maximum(x, 0.0) ** 2  # noqa: E731 - one use
    pipeline = run(record(shallow, law), STIFFENING)
    assert pipeline.rows[pipeline.selected].frozen
    assert streamed(pipeline).amplitudes == (3e5,)
    assert_streamed_as_estimated(pipeline)
    assert estimates(pipeline)["k"] == pytest.approx(3600, rel=0.05)


def test_a_rig_effect_is_distinguished_and_not_streamed():
    def law(x, v):
        return kelvin_voigt(x, v) + 2.0 * np.tanh(v / 0.01)

    samples = record(PRESS, law)
    pipeline = run(samples, FRICTION)
    assert estimates(pipeline, 1)["coulomb_friction"] == pytest.approx(2.0, rel=0.03)
    assert streamed(pipeline).amplitudes == pipeline.streaming.effects == ()
    assert_streamed_as_estimated(pipeline)
    assert pipeline.onsets >= 2
    assert pipeline.contact.surface == pytest.approx(PRESS.surface, abs=5e-5)
    alone = run(samples)
    assert not abs(alone.contact.surface - PRESS.surface) < 5e-5
    in_free_air = run(tuple(column[:150] for column in samples), FRICTION)
    assert in_free_air.rig_force == pytest.approx(samples[1][130:150].mean(), rel=0.05)
    assert in_free_air.contact.contact_id == 0


def test_a_disturbance_is_found_whatever_its_phase_in_this_run():
    position, force, valid = record(PRESS, kelvin_voigt)
    t = np.arange(force.size) * 1e-3
    hum = ("periodic_disturbance", "", {"disturbance": 1.0, "frequency": 20.0, "phase": 0.3})
    pipeline = run((position, force + 0.3 * np.sin(2 * np.pi * 20 * t + 2.0), valid), hum)
    found = estimates(pipeline, 1)
    size = np.hypot(found["periodic_disturbance_sine"], found["periodic_disturbance_cosine"])
    assert size == pytest.approx(0.3, rel=0.05)


def bent(compliance):
    position, force, valid = record(PRESS, kelvin_voigt)
    return position + compliance * np.interp(np.arange(force.size) + 1, np.arange(force.size),
                                             force), force, valid  # fmt: skip


def played(gap):
    """The encoder runs ahead of the tip by half the gap, in the direction of motion."""
    tip, force, valid = record(PRESS, kelvin_voigt, lag=0.0)
    ahead = np.sign(np.gradient(PRESS.position(np.arange(tip.size) * 1e-3)))
    return tip + 0.5 * gap * ahead, force, valid


def slow_of(bandwidth):
    """Return the coefficients of a first-order low-pass [Hz] at 1 kHz."""
    decay = np.exp(-2 * np.pi * bandwidth * 1e-3)
    return [1 - decay], [1, -decay]


def slow(bandwidth):
    position, force, valid = record(PRESS, kelvin_voigt, lag=0.0)
    return position, lfilter(*slow_of(bandwidth), force), valid


COMPLIANCE = ("series_compliance", "", {"compliance": 5e-5})
BACKLASH = ("backlash", "centred", {"gap": 0.0005})
SLOW = ("force_lag", "first order", {"bandwidth": 15.0})
DELAY = ("channel_delay", "", {"lag": 0.006})
LEVEL = ("force_saturation", "hard", {"level": 45.0})
SPARKS = ("outliers", "", {"share": 0.01})


def clipped(level):
    position, force, valid = record(PRESS, kelvin_voigt)
    return position, np.minimum(force, level), valid


def sparked():
    position, force, valid = record(PRESS, kelvin_voigt)
    hit = np.random.default_rng(3).random(force.size) < 0.01
    return position, force + 20.0 * hit, valid


@pytest.mark.parametrize(
    ("samples", "effect", "lag"),
    [
        (bent(5e-5), COMPLIANCE, 1e-3),
        (played(0.0005), BACKLASH, 0.0),
        (slow(15.0), SLOW, 0.0),
        (record(PRESS, kelvin_voigt, lag=7e-3), DELAY, 1e-3),
        (clipped(45.0), LEVEL, 1e-3),
        (sparked(), SPARKS, 1e-3),
    ],
    ids=["compliance", "backlash", "lag", "delay", "saturation", "outliers"],
)
def test_what_spoils_the_samples_no_longer_spoils_the_estimate(samples, effect, lag):
    settings = PipelineSettings(**{n: getattr(SETTINGS, n) for n in SETTINGS.__slots__} |
                                {"force_lag_s": lag})  # fmt: skip
    alone, cured = (run(samples, *e, settings=settings) for e in ((), (effect,)))
    errors = [
        np.hypot(found["k"] / 3600 - 1, (found["b"] - 20) / 60)
        for found in map(estimates, (alone, cured))
    ]
    assert errors[1] < 0.5 * errors[0]
    assert errors[1] < 0.05
    assert (cured.masked > 0) == (effect in (LEVEL, SPARKS))


def pipeline_of(effect, diagnosed_surface, settings):
    """Return a pipeline with an effect that was fitted beside a surface."""
    described = document(effect)
    described["base"]["parameters"]["surface"] = diagnosed_surface
    extension = extension_from("model.yaml", described)
    rows = extension.rows(rows_for(["kelvin-voigt"], ["direct"], ["rls"]))
    return Pipeline(rows, extension.settings(settings))


def on_screw(pitch_error, pitch, phase, surface):
    """Return samples whose tip is ahead of the encoder by a screw's error [m] along the stroke."""
    tip, force, valid = record(PRESS, kelvin_voigt, lag=0.0)
    encoder = tip.copy()
    for _ in range(20):
        encoder = tip - pitch_error * np.sin(2 * np.pi * (encoder - surface) / pitch + phase)
    return encoder, force, valid


@pytest.mark.parametrize(
    "channel",
    [
        ("charge_leak", "", {"time_constant": 2.0}),
        ("gain_drift", "", {"gain_change": -0.2, "time_constant": 5.0}),
    ],
)
def test_what_a_channel_has_forgotten_in_another_run_is_not_corrected(channel):
    """It is known for the recording alone on which it was found."""
    extension = extension_from("model.yaml", document(channel))
    assert extension.corrections == ()
    assert extension.terms == ()
    answer = {"effects": [{"name": channel[0], "law": channel[1], "belongs_to": "rig"}]}
    (handling,) = handled(answer, LIBRARY)
    assert handling["how"].startswith("it is not corrected on-line")


def test_a_screw_keeps_its_phase_where_another_surface_is_met():
    """Counted from each surface that was met, the phase before the first one was arbitrary."""
    effect = ("position_ripple", "of a screw's pitch",
              {"pitch_error": 2e-4, "pitch": 4e-3, "phase": 1.0})  # fmt: skip
    diagnosed_at = PRESS.surface - 1.1e-3
    samples = on_screw(2e-4, 4e-3, 1.0, diagnosed_at)
    pipeline = pipeline_of(effect, diagnosed_at, dataclasses.replace(SETTINGS, force_lag_s=0.0))
    pipeline.run(*samples)
    assert pipeline.contact.surface + pipeline.shift == pytest.approx(PRESS.surface, abs=3e-5)
    assert pipeline.nrmse(0) < 0.002
    assert estimates(pipeline)["k"] == pytest.approx(3600, rel=0.005)


def test_a_spring_of_the_rig_is_known_before_the_surface_is_met():
    """Its rest counted from the place where the run began: 1 N too much was taken off the force."""

    def law(x, v):
        return kelvin_voigt(x, v) + 200.0 * (x + PRESS.surface)

    spring = (
        "return_spring",
        "about its rest",
        {"spring_stiffness": 200.0, "rest": -PRESS.surface},
    )
    samples = record(PRESS, law)
    pipeline = pipeline_of(spring, PRESS.surface, SETTINGS)
    pipeline.run(*(column[:150] for column in samples))
    assert pipeline.contact.contact_id == 0
    assert pipeline.rig_force == pytest.approx(samples[1][140:150].mean(), rel=0.03)
    pipeline.run(*(column[150:] for column in samples))
    assert pipeline.contact.surface == pytest.approx(PRESS.surface, abs=5e-5)


def test_a_slow_channel_shows_a_tap_without_the_way_to_it():
    """With the way to the surface in it, the position belonged to a force 1.4 N below, of 18 N."""
    tap_m = 5e-3 * np.sin(2 * np.pi * 3.0 * np.arange(2000) * 1e-3)
    force = 3600.0 * lfilter(*slow_of(15.0), np.maximum(0.0, tap_m))
    extension = extension_from("model.yaml", document(SLOW))
    corrections = Corrections(extension.corrections, 1e-3, 0.01)
    tip_m = np.array([corrections.apply(x, f, 0.0) for x, f in zip(tap_m, force, strict=True)])
    assert np.max(np.abs(3600.0 * np.maximum(0.0, tip_m) - force)) < 0.05 * np.max(force)


def hysteretic(x, v):
    """A body with a Coulomb element behind a soft spring: it lets go before its surface."""
    force, twist = np.zeros_like(x), 0.0
    for i, (depth, speed) in enumerate(zip(x, v, strict=True)):
        if depth > 0.0:
            sign = 1.0 if speed > 0.0 else -1.0
            twist += (sign - twist) * (1.0 - np.exp(-abs(speed) * 1e-3 / 0.003))
            force[i] = max(0.0, 3600.0 * depth + 20.0 * speed + 12.0 * twist)
    return force


def relaxing(x, v):
    force, stretch = np.zeros_like(x), 0.0
    for i, (depth, speed) in enumerate(zip(x, v, strict=True)):
        stretch = np.exp(-1e-3 / 0.1) * (stretch + (speed * 1e-3 if depth > 0.0 else 0.0))
        if depth > 0.0:
            force[i] = max(0.0, 3600.0 * depth + 20.0 * speed + 1500.0 * stretch)
    return force


SHORT = Press(duration=5.0, lift_every=1.5, frequency=2.0, mean=0.006, amplitude=0.003)


def test_a_body_that_lets_go_keeps_its_surface_though_it_is_met_again_deeper():
    effect = ("hysteresis", "plain", {"yield_force": 12.0, "yield_travel": 0.003, "sharpness": 1.0})
    extension = extension_from("model.yaml", document(effect))
    rows = extension.rows(rows_for(["kelvin-voigt"], ["direct"], ["rls"]))
    pipeline = Pipeline(rows, extension.settings(SETTINGS))
    trace = pipeline.run(*record(SHORT, hysteretic))
    found = trace.signals[:, 2]
    assert pipeline.onsets >= 3
    assert np.abs(found[np.isfinite(found)] - SHORT.surface).max() < 1e-4


def test_a_body_does_not_remember_a_tool_that_had_not_met_it():
    effect = ("stress_relaxation", "one arm", {"arm_stiffness": 1500.0, "time_constant": 0.1})
    pipeline = run(record(SHORT, relaxing), effect)
    assert pipeline.nrmse(0) < 0.003
    assert pipeline.nrmse(1) < 0.003


def test_a_surface_that_recedes_is_followed_and_streamed():
    """It is where it is now that counts for the guard, and its law that counts for the master."""
    position, _, valid = record(PRESS, kelvin_voigt)
    t = np.arange(position.size) * 1e-3
    x, v, _ = PRESS.state(t - 1e-3)
    force = kelvin_voigt(x - PRESS.surface - 0.0003 * t, v - 0.0003)
    force += 0.05 * np.random.default_rng(1).normal(size=t.size)
    pipeline = run((position, force, valid),
                   ("moving_surface", "steady", {"surface_velocity": 0.0003}))  # fmt: skip
    assert estimates(pipeline)["k"] == pytest.approx(3600, rel=0.02)
    assert pipeline.contact.surface == pytest.approx(PRESS.surface + 0.0003 * 8, abs=5e-5)
    assert streamed(pipeline).surface == pytest.approx(PRESS.surface, abs=5e-5)
    assert pipeline.streaming.effects[0].effect.name == "moving_surface"


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (document(base="voigt"), "'voigt' does not run on-line"),
        (document(("sticktion", "", {})), "no effect 'sticktion'"),
        (document(("backlash", "loose", {"gap": 1.0})), "its laws: centred"),
        (document(("coulomb_friction", "presliding", {"friction_force": 1.0})),
         "give a number for presliding_travel"),
    ],
)  # fmt: skip
def test_an_extended_model_that_cannot_run_says_why(made, words):
    with pytest.raises(ExtendedModelError, match=words):
        extension_from("model.yaml", made)
