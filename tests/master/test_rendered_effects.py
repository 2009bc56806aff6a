"""Effects of the environment beside a wall: felt at the hand's own motion, and passive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from master_world import CONFIG, World

from teleop_rt.config.operator import ProfileOperator
from teleop_rt.contact.effect import MOST_SHAPES
from teleop_rt.contact.effects import LIBRARY, find
from teleop_rt.contact.fitted import code_of
from teleop_rt.link.codec import decode, encode
from teleop_rt.link.messages import Kind, ModelEffect, ModelMessage
from teleop_rt.master.operators import Profile
from teleop_rt.master.parts import TOUCH_SHARE
from teleop_rt.master.passivity import Port
from teleop_rt.master.rendered_effects import RenderedEffects
from teleop_rt.master.wall_limiter import WallLimiter, largest_slopes
from teleop_rt.master.walls import wall_of
from teleop_rt.signals import MASTER, columns

COLUMN = columns(MASTER)
SURFACE, K, B, DT = 0.0137, 3600.0, 20.0, 1e-3
OPERATOR = ProfileOperator(
    kind="profile", approach_speed=0.04, mean=0.008, amplitude=0.005, frequency_hz=2.0,
    felt_force=0.5, lift_off_every_s=2.0, lift_off_height=0.004,
)  # fmt: skip


def streamed(name, amplitude, *shape, law=""):
    values = (*shape, *MOST_SHAPES * (0.0,))
    return ModelEffect(code_of(find(name, law)), amplitude, values[:MOST_SHAPES])


STIFFENING = streamed("nonlinear_stiffening", 3e5, 2.0)
ARM = streamed("stress_relaxation", 1500.0, 0.2)
ADHESION = streamed("adhesion", 2.0, 0.001, 1.0)
RECEDING = streamed("moving_surface", 0.0005)


def walls(*effects):
    """A wall with these effects, and the object that leads their memories."""
    rendered = RenderedEffects(LIBRARY, 0.1, 1.5)
    model = ModelMessage("kelvin-voigt", 1, 1, SURFACE, k=K, b=B, effects=effects)
    wall = wall_of(model, rendered.terms(effects, 0.0))
    assert wall is not None
    return wall, rendered


def felt(*effects, ticks=6000, rest=None):
    """Position in the wall's coordinates, velocity and force of a trial of the whole master."""
    world = World(Profile(OPERATOR), library=LIBRARY, effects=effects, **(rest or {}))
    rows = world.run(ticks)
    x = rows[:, COLUMN["position"]] - rows[:, COLUMN["offset"]] - SURFACE
    return world, x, rows[:, COLUMN["velocity"]], rows[:, COLUMN["rendered_force"]]


def test_the_operator_feels_the_stiffening_at_his_own_depth():
    world, x, v, force = felt(STIFFENING)
    settled = np.arange(x.size) > 1500
    expected = np.maximum(0.0, K * x + B * v + 3e5 * np.maximum(x, 0.0) ** 2) * (x > 0)
    assert np.abs(force - expected)[settled].max() < 1e-6
    assert world.master.screening.refused == {}
    assert world.master.observer.lowest_J >= -world.master.observer.epsilon_J


def test_a_relaxing_arm_is_followed_through_every_contact():
    _, x, v, force = felt(ARM)
    arm, expected = 0.0, []
    depth = np.maximum(x, 0.0)
    for before, now, speed in zip(depth, depth[1:], v[1:], strict=False):
        decay = math.exp(-DT / 0.2)
        arm = decay * arm + 0.2 / DT * (1 - decay) * (now - before)
        expected.append(max(0.0, K * now + B * speed + 1500 * arm) if now > 0 else 0.0)
    late = slice(4500, None)
    assert force[1:][late] == pytest.approx(np.array(expected)[late], abs=0.02)


def test_a_surface_that_sticks_pulls_after_contact_and_not_before():
    _, x, _, force = felt(ADHESION)
    outside = (x < 0) & (x > -0.0009)
    first = int(np.argmax(x > 0))
    assert np.all(force[:first] == 0.0)
    assert force[outside][np.arange(outside.sum()) > 20].min() < -1.0
    assert np.all(force[x < -0.0011] == 0.0)


def test_a_surface_that_recedes_is_felt_further_away_later():
    world, x, _, force = felt(RECEDING)
    inside = force > 0
    ticks = np.arange(x.size)
    early = x[inside & (ticks > 1500) & (ticks < 3000)].min()
    late = x[inside & (ticks > 4500)].min()
    assert late - early == pytest.approx(0.0005 * 2.5, abs=0.0006)
    assert world.master.adoption.newest.surface_now > SURFACE + 0.002


def test_an_effect_that_is_not_known_here_is_refused_with_its_wall():
    world, x, _, force = felt(ModelEffect(12345, 1.0), ticks=1500)
    assert world.master.screening.refused["unknown effect"] >= 1
    wall = world.master.adoption.newest
    assert (wall.b, wall.terms) == (0.0, ()), "a wall of the slave's states, not of the model"
    measured = np.maximum(K * np.maximum(x, 0.0), world.slave.forces[-x.size :])
    margin = TOUCH_SHARE * CONFIG.force_max
    assert np.all(force <= measured + margin), "no more than the tool has felt there"
    assert force.max() > 0.9 * measured.max()


def test_the_bound_counts_the_effects_and_reduces_them_before_the_model():
    wall, _ = walls(STIFFENING, ARM)
    stiffness, damping = largest_slopes(wall, CONFIG.force_max, 1.5)
    depth = wall.position_of(CONFIG.force_max) - SURFACE
    assert stiffness == pytest.approx(K + 2 * 3e5 * depth + 1500, rel=0.02)
    assert damping == B
    limiter = WallLimiter(Port(DT, 0.5 * 5.0), CONFIG.force_max, 1.5)
    soft = limiter.apply(wall)
    assert limiter.rendered_bound.reduced
    assert limiter.rendered_bound.true_stiffness == stiffness
    assert limiter.rendered_bound.rendered_stiffness <= 2 * 2.5 / DT + 1
    reached, _ = largest_slopes(soft, CONFIG.force_max, 1.5)
    assert reached <= 1.002 * 2 * 2.5 / DT
    assert soft.k == wall.k, "the model alone is within the bound"
    ratio = soft.terms[0].amplitude / wall.terms[0].amplitude
    assert 0.0 < ratio < 1.0
    assert [t.amplitude for t in soft.terms] == pytest.approx([3e5 * ratio, 1500 * ratio])
    weaker = WallLimiter(Port(DT, 0.5), CONFIG.force_max, 1.5).apply(wall)
    assert [t.amplitude for t in weaker.terms] == [0.0, 0.0]
    assert weaker.k == pytest.approx(2 * 0.5 / DT, rel=0.002)


def test_a_damper_beyond_the_bound_is_felt_as_it_is_by_a_slow_hand():
    size, room = 150.0, 0.5 * 90.0
    wall, rendered = walls(streamed("quadratic_damping", size))
    calm = WallLimiter(Port(DT, room), CONFIG.force_max, 1.5).apply(wall)
    _, damping = largest_slopes(calm, CONFIG.force_max, 1.5)
    assert B < damping < B + 2 * size * 1.5
    fastest = (damping - B) / (2 * size)
    inside = SURFACE + 0.005
    for speed, effective in ((0.5 * fastest, 0.5 * fastest), (3.0 * fastest, fastest)):
        rendered.advance(inside, SURFACE, speed, DT)
        expected = K * 0.005 + B * speed + size * effective**2
        assert calm.force(inside, speed) == pytest.approx(expected, rel=1e-3)
    assert (calm.k, calm.b) == (K, B)


def test_the_stored_energy_is_the_work_of_all_springs():
    wall, rendered = walls(STIFFENING, ARM)
    steps, reach, work = 2000, 0.01, 0.0
    for i in range(steps):
        x = SURFACE + reach * (i + 0.5) / steps
        rendered.advance(x, SURFACE, 1e9, 1e-9)
        work += wall.elastic_force(x) * reach / steps
    rendered.advance(SURFACE + reach, SURFACE, 1e9, 1e-9)
    assert wall.energy(SURFACE + reach) == pytest.approx(work, rel=0.01)


def test_the_position_of_a_force_is_where_all_springs_give_it():
    wall, rendered = walls(STIFFENING)
    position = wall.position_of(60.0)
    rendered.advance(position, SURFACE, 0.0, DT)
    assert wall.elastic_force(position) == pytest.approx(60.0, rel=1e-6)


def test_a_law_of_six_shapes_reads_all_of_them_from_the_bytes_of_its_message():
    shape = (1.2, 0.3, 2.2, 0.4, 0.5, 0.6)
    law = find("moving_surface", "beating")
    sent = ModelMessage(
        "kelvin-voigt",
        1,
        1,
        0.0,
        k=3600.0,
        effects=(streamed(law.name, 1e-3, *shape, law=law.law),),
    )
    received = decode(Kind.MODEL, encode(sent))
    terms = RenderedEffects(LIBRARY, 0.02, 0.1).terms(received.effects, 0.0)
    assert terms is not None
    assert terms[0].memory.eta[:6].tolist() == list(shape)


@pytest.mark.parametrize("effect", [e for e in LIBRARY if e.belongs_to == "environment"],
                         ids=lambda e: f"{e.name}-{e.law}")  # fmt: skip
def test_no_effect_of_the_library_gives_energy_or_a_wild_force(effect):
    scales = {"travel": 0.02, "speed": 0.1, "duration": 5.0, "": 1.0}
    shape = [s.start * scales.get(s.relative_to, 1.0) for s in effect.shapes]
    size = {"{f}": 3.0, "{f}/{x}": 800.0, "{x}": 0.001, "{x}/s": 0.0005, "1": 0.1}
    amplitude = size.get(effect.amplitude.unit, 50.0)
    streamed_effect = ModelEffect(
        code_of(effect), amplitude, (*shape, *MOST_SHAPES * (0.0,))[:MOST_SHAPES]
    )
    world, _, _, force = felt(streamed_effect, ticks=1800)
    assert world.master.screening.refused == {}
    assert np.all(np.isfinite(force))
    assert force.max() > 5.0
    assert world.master.observer.lowest_J >= -world.master.observer.epsilon_J
