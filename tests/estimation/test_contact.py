"""Contact is detected with hysteresis, and the surface is found and refined."""

import dataclasses
import math

import numpy as np
import pytest

from teleop_rt.contact.detection import SURFACE_VARIANCE
from teleop_rt.contact.models import MODELS, contact_force
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for
from teleop_rt_dev.estimation.plant import Press, hunt_crossley, kelvin_voigt, record

from .test_pipeline import SETTINGS

KELVIN_VOIGT = rows_for(["kelvin-voigt"], ["direct"], ["rls"])


def soft(x, v):
    return hunt_crossley(x, v, k=1500.0, b=50.0)


def feed(pipeline, position, force):
    """Feed a stretch of samples; return the contact after each."""
    seen = []
    for p, f in zip(position, force, strict=True):
        pipeline.update(p, f, True)  # noqa: FBT003 - the axis's flag
        seen.append(pipeline.contact)
    return seen


def test_the_onset_alone_places_the_surface_within_two_tenths_of_a_millimetre():
    position, force, valid = record(Press(), kelvin_voigt)
    pipeline = Pipeline(KELVIN_VOIGT, SETTINGS)
    pipeline.run(position[:1000], force[:1000], valid[:1000])
    assert pipeline.contact.surface == pytest.approx(Press().surface, abs=2e-4)


def surface_errors(stiffness, damping, speed, in_air=lambda t: 0.0 * t):
    """Return by how much the onset of an even approach misses the surface, for eight seeds [m]."""
    pipeline = Pipeline(KELVIN_VOIGT, dataclasses.replace(SETTINGS, force_lag_s=0.0))
    errors = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        t = np.arange(-1.5, 1.5 * 0.4 / stiffness / speed + 0.1, SETTINGS.period_s)
        t += SETTINGS.period_s * seed / 8
        force = np.where(t > 0, stiffness * speed * t + damping * speed, in_air(t))
        pipeline.reset()
        for x, f in zip(speed * t, force + 0.05 * rng.standard_normal(t.size), strict=True):
            pipeline.update(round(x / 5e-6) * 5e-6, f, True)  # noqa: FBT003 - the axis's flag
        assert pipeline.contact.contact_id == 1
        errors.append(pipeline.contact.surface)
    return np.array(errors)


@pytest.mark.parametrize("speed", [0.003, 0.01, 0.033])
@pytest.mark.parametrize(
    ("stiffness", "damping", "tolerance"), [(400.0, 3.0, 1e-4), (3600.0, 20.0, 2e-5)]
)
def test_an_onset_places_the_surface_of_a_soft_body_better_than_its_threshold(
    stiffness, damping, tolerance, speed
):
    """Force leaves the noise, 0.1 N here, only 0.25 mm within a foam of 400 N/m."""
    errors = surface_errors(stiffness, damping, speed)
    assert math.sqrt(np.mean(errors**2)) < tolerance


@pytest.mark.parametrize("lost", [3, 6, 9])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_an_onset_within_lost_samples_is_as_uncertain_as_they_were_many(lost, share):
    """The line that bridges a gap begins at the last place in the air, too early."""
    speed, step_s, air = 0.05, SETTINGS.period_s, 1500
    places = np.arange(air + lost + 6)  # the samples of number air + 1 to air + lost do not come
    valid = (places <= air) | (places > air + lost)
    t = step_s * (places - air - share * (lost + 1))
    gap = speed * step_s * (lost + 1)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        force = np.where(t > 0, 3600.0 * speed * t + 20.0 * speed, 0.0)
        force += 0.05 * rng.standard_normal(t.size)
        pipeline = Pipeline(KELVIN_VOIGT, dataclasses.replace(SETTINGS, force_lag_s=0.0))
        for x, f, good in zip(speed * t, force, valid.tolist(), strict=True):
            pipeline.update(x, f, good)
        assert pipeline.contact.contact_id == 1
        deviation = math.sqrt(pipeline.stored["detector"][0, SURFACE_VARIANCE])
        assert abs(pipeline.contact.surface) < 3.0 * deviation
        assert deviation < gap


@pytest.mark.parametrize("push", [-0.3, 0.3])
def test_what_the_tools_mass_did_in_the_air_before_moves_no_surface(push):
    def bump(t):
        return np.where((t > -0.7) & (t < -0.4), push, 0.0)

    assert np.abs(surface_errors(3600.0, 20.0, 0.01, bump)).max() < 4e-5


@pytest.mark.parametrize(
    ("law", "tolerance"),
    [(kelvin_voigt, 2e-5), (hunt_crossley, 2e-5), (soft, 2e-4)],
    ids=["silicone", "hunt-crossley", "soft"],
)
def test_the_surface_is_refined_after_a_contact(law, tolerance):
    for seed in range(5):
        pipeline = Pipeline(KELVIN_VOIGT, SETTINGS)
        pipeline.run(*record(Press(duration=8.5), law, seed=seed))
        assert pipeline.contact.surface == pytest.approx(Press().surface, abs=tolerance)


@pytest.mark.parametrize("mean", [0.010, 0.012, 0.014])
@pytest.mark.parametrize("depth", [0.009, 0.013])
def test_a_harder_layer_below_moves_no_surface_into_what_was_free_air(mean, depth):
    """The best power law through two slopes begins millimetres before the surface."""

    def layered(x, v):
        return kelvin_voigt(x, v) + 2500.0 * np.maximum(x - depth, 0.0)

    press = Press(duration=12.5, mean=mean, frequency=1.0)
    pipeline = Pipeline(KELVIN_VOIGT, SETTINGS)
    position, force, _ = record(press, layered)
    met = [c.surface for c in feed(pipeline, position, force) if c.surface_known]
    assert pipeline.contact.contact_id == 4
    assert np.abs(np.array(met) - press.surface).max() < 2e-4


def test_a_straight_line_alone_would_miss_a_curved_environment_by_millimetres():
    position, force, _ = record(Press(), hunt_crossley, lag=0.0)
    deep = force > 2.0
    k, offset = np.polyfit(position[deep] - Press().surface, force[deep], 1)
    assert abs(offset / k) > 1e-3


def test_a_run_that_starts_in_contact_finds_the_surface_after_it_has_left():
    position, force, valid = record(Press(duration=9.0), kelvin_voigt)
    pipeline = Pipeline(KELVIN_VOIGT, SETTINGS)
    pipeline.run(position[1000:3000], force[1000:3000], valid[1000:3000])
    assert pipeline.estimate(0)[0] == ["k", "b", "offset"]
    assert pipeline.contact.in_contact
    pipeline.run(position[3000:], force[3000:], valid[3000:])
    assert pipeline.surface_reason is None
    assert pipeline.contact.surface == pytest.approx(Press().surface, abs=2e-5)
    names, values, _ = pipeline.estimate(0)
    assert names == ["k", "b"]
    assert values[0] == pytest.approx(3600, rel=0.003)


def test_onset_needs_counted_samples_and_release_has_hysteresis():
    pipeline = Pipeline(KELVIN_VOIGT, SETTINGS)
    quiet = feed(pipeline, np.zeros(50), np.zeros(50))
    assert not quiet[-1].in_contact
    spikes = feed(pipeline, np.zeros(30), np.tile([5.0, 5.0, 0.0], 10))
    assert not any(contact.in_contact for contact in spikes)
    pressed = feed(pipeline, np.full(10, 1e-3), np.full(10, 0.6))
    assert [c.in_contact for c in pressed].index(True) == SETTINGS.onset_samples - 1
    between = feed(pipeline, np.full(50, 1e-3), np.full(50, 0.4))
    assert all(contact.in_contact for contact in between), "0.4 N is below onset, above release"
    let_go = feed(pipeline, np.full(10, 0.0), np.zeros(10))
    assert [c.in_contact for c in let_go].index(False) == SETTINGS.release_samples - 1


def test_an_onset_without_free_air_before_gives_no_surface():
    pipeline = Pipeline(KELVIN_VOIGT, SETTINGS)
    contacts = feed(pipeline, np.full(100, 0.01), np.full(100, 30.0))
    assert contacts[-1].in_contact
    assert not contacts[-1].surface_known
    assert pipeline.onsets == 0
    assert contacts[-1].contact_id == 1


def rest_inside(pipeline, seed, *, touched_before):
    """Press a foam, if before; leave it fast, as far as to a rest inside it; press on from there.

    Its damping lets go of the tool on the way out, and 0.35 N at rest is less than an onset.
    """
    rng = np.random.default_rng(seed)
    moves = [(-0.01, 0.0, 0.0)] + ([(0.0026, 0.01, 1.0)] if touched_before else [])
    moves += [(0.000875, 0.2 if touched_before else 0.004, 1.3), (0.004, 0.01, 0.2)]
    t = np.arange(0.0, 0.3, SETTINGS.period_s)
    position, at = [np.full(t.size, -0.01)], -0.01
    for goal, speed, rest_s in moves[1:]:
        count = round(abs(goal - at) / speed / SETTINGS.period_s)
        position += [np.linspace(at, goal, count), np.full(round(rest_s / SETTINGS.period_s), goal)]
        at = goal
    x = np.concatenate(position)
    force = np.where(x > 0.0, 400.0 * x + 3.0 * np.gradient(x, SETTINGS.period_s), 0.0)
    force = np.maximum(force, 0.0) + 0.05 * rng.standard_normal(x.size)
    return feed(pipeline, np.round(x / 5e-6) * 5e-6, force)


@pytest.mark.parametrize("seed", range(6))
def test_a_tool_that_rests_inside_and_presses_on_moves_no_surface(seed):
    pipeline = Pipeline(KELVIN_VOIGT, dataclasses.replace(SETTINGS, force_lag_s=0.0))
    contacts = rest_inside(pipeline, seed, touched_before=True)
    assert contacts[-1].contact_id == 2, "it was let go"
    assert contacts[-1].surface == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_a_first_touch_that_rests_inside_gives_no_surface_at_the_place_of_rest(seed):
    pipeline = Pipeline(KELVIN_VOIGT, dataclasses.replace(SETTINGS, force_lag_s=0.0))
    last = rest_inside(pipeline, seed, touched_before=False)[-1]
    assert last.in_contact
    assert not last.surface_known or abs(last.surface) < 1.5e-4


def test_the_deepest_free_position_is_kept():
    pipeline = Pipeline(KELVIN_VOIGT, SETTINGS)
    assert math.isnan(pipeline.contact.verified_free)
    down = np.linspace(-0.01, 0.004, 100)
    contacts = feed(pipeline, np.concatenate([down, down[::-1]]), np.zeros(200))
    assert contacts[-1].verified_free == pytest.approx(0.004, abs=2e-4)


def test_an_environment_that_moved_is_followed():
    near = record(Press(duration=4.0), kelvin_voigt)
    far = record(Press(duration=4.0, surface=0.0137 + 5e-3), kelvin_voigt, seed=1)
    pipeline = Pipeline(KELVIN_VOIGT, SETTINGS)
    pipeline.run(*near)
    assert pipeline.contact.surface == pytest.approx(0.0137, abs=5e-5)
    pipeline.run(*far)
    assert pipeline.contact.surface == pytest.approx(0.0187, abs=5e-5)
    assert pipeline.estimate(0)[1][0] == pytest.approx(3600, rel=0.005)


def test_a_given_surface_makes_contact_a_matter_of_position():
    settings = dataclasses.replace(SETTINGS, surface=0.01)
    pipeline = Pipeline(KELVIN_VOIGT, settings)
    contacts = feed(pipeline, np.full(20, 0.011), np.full(20, -3.0))
    assert contacts[-1].in_contact
    assert contacts[-1].surface == 0.01
    contacts = feed(pipeline, np.full(20, 0.009), np.full(20, 30.0))
    assert not contacts[-1].in_contact


@pytest.mark.parametrize("lag", [-2.3e-3, -1e-3, 0.4e-3, 7.5e-3])
def test_lag_of_either_sign_and_of_part_of_a_tick_is_aligned(lag):
    settings = dataclasses.replace(SETTINGS, force_lag_s=lag)
    pipeline = Pipeline(KELVIN_VOIGT, settings)
    pipeline.run(*record(Press(), kelvin_voigt, lag=lag))
    _, (k, b), _ = pipeline.estimate(0)
    assert k == pytest.approx(3600, rel=0.003)
    assert b == pytest.approx(20, rel=0.03)


def test_a_mass_in_free_motion_needs_no_contact():
    t = np.arange(6000) * 1e-3
    w = 2 * np.pi * 2
    x = 0.02 * np.sin(w * t) + 0.004 * np.sin(3.3 * w * t)
    a = -0.02 * w**2 * np.sin(w * t) - 0.004 * (3.3 * w) ** 2 * np.sin(3.3 * w * t)
    force = 0.8 * a + 0.02 * np.random.default_rng(0).normal(size=len(t))
    settings = dataclasses.replace(
        SETTINGS, force_lag_s=0.0, surface=1.0, force_noise=0.02, cutoff_hz=20.0
    )
    pipeline = Pipeline(rows_for(["mass", "mass-damper"], solvers=["rls"]), settings)
    pipeline.run(np.round(x / 5e-6) * 5e-6, force, np.ones(len(t), dtype=bool))
    assert pipeline.estimate(0)[1][0] == pytest.approx(0.8, rel=0.01)
    assert pipeline.estimate(1)[1][0] == pytest.approx(0.8, rel=0.03)
    assert pipeline.estimate(2)[1] == pytest.approx([0.8, 0.0], abs=0.02)


def test_models_say_their_force_and_refuse_what_they_are_not():
    assert contact_force("kelvin-voigt", {"k": 100, "b": 2}, 0.1, 1.0) == pytest.approx(12)
    assert contact_force("kelvin-voigt", {"k": 100, "b": 2}, -0.1, 1.0) == 0.0
    assert contact_force("kelvin-voigt-unilateral", {"k": 100, "b": 2}, 0.1, -1.0) == pytest.approx(
        10
    )
    full = {"k": 100, "b": 2, "m": 3}
    assert contact_force("mass-spring-damper", full, 0.1, 1.0, 2.0) == pytest.approx(18)
    assert contact_force("mass", {"m": 3}, -0.1, 0.0, 2.0) == pytest.approx(6)
    curved = {"k": 1500, "b": 50, "n": 1.5}
    assert contact_force("hunt-crossley", curved, 0.01, 0.1) == pytest.approx(1.505)
    assert contact_force("hunt-crossley", curved, 0.01, -100.0) == 0.0, "it never pulls"
    with pytest.raises(KeyError):
        contact_force("putty", {}, 0.1, 0.0)


@pytest.mark.parametrize("name", ["mass", "kelvin-voigt", "kelvin-voigt-unilateral",
                                  "mass-spring-damper", "mass-damper"])  # fmt: skip
def test_a_model_is_the_sum_of_its_effects(name):
    model = MODELS[name]
    parameters = {p.name: 1.7 + i for i, p in enumerate(model.parameters)}
    empty = np.zeros(0)
    for x, v, a in ((0.01, 0.2, 3.0), (0.01, -0.2, -3.0), (-0.01, 0.2, 3.0)):
        total = sum(
            parameters[e.amplitude.name] * e.step(empty, x, v, a, 0.0, 1e-3, empty)
            for e in model.effects
        )
        expected = contact_force(name, parameters, x, v, a)
        if x > 0 or not model.in_contact_only:
            assert total == pytest.approx(expected)
