from __future__ import annotations

import json
import math

import numpy as np
import pytest
from cases import cases
from master_world import CONFIG, PERIOD_NS, World

from teleop_rt.config.operator import HandOperator, ProfileOperator
from teleop_rt.link.impairment import Impairment
from teleop_rt.link.messages import StateMessage
from teleop_rt.master.hand import Hand
from teleop_rt.master.operators import Profile
from teleop_rt.master.outcome import outcome
from teleop_rt.master.passivity import CALM_SHARE, STIFFEST_SHARE
from teleop_rt.signals import MASTER, columns

COLUMN = columns(MASTER)
PROFILE = ProfileOperator(
    kind="profile",
    approach_speed=0.04,
    mean=0.012,
    amplitude=0.008,
    frequency_hz=3.0,
    felt_force=0.5,
    lift_off_height=0.005,
)


def true_force(world: World, rows: np.ndarray) -> np.ndarray:
    """The wall's force at the master's own motion, written here from (2.1)."""
    x = rows[:, COLUMN["target"]] - world.slave.surface
    v = rows[:, COLUMN["velocity"]]
    return np.where(x > 0, np.maximum(0.0, world.slave.k * x + world.slave.b * v), 0.0)


@pytest.mark.parametrize("round_trip_ms", [0, 150, 1000])
@pytest.mark.parametrize("model_after", [0, 20])
def test_rendered_force_is_the_walls_force_at_the_hands_own_motion(
    round_trip_ms: int, model_after: int
) -> None:
    delay = Impairment(delay_ns=round_trip_ms * PERIOD_NS // 2)
    world = World(Profile(PROFILE), there=delay, model_after=model_after)
    world.run(4 * round_trip_ms + 1500)
    rows = world.run(3000)
    expected = true_force(world, rows)
    assert expected.max() > 50.0
    np.testing.assert_allclose(rows[:, COLUMN["rendered_force"]], expected, atol=1e-9)


@pytest.mark.parametrize("rate_hz", [2000, 4000])
def test_a_master_faster_than_the_slave_renders_at_every_tick_of_its_own(rate_hz: int) -> None:
    delay = Impairment(delay_ns=75 * PERIOD_NS)
    world = World(Profile(PROFILE), there=delay, rate_hz=rate_hz)
    world.run(3 * rate_hz)
    cycled = world.slave.tick
    rows = world.run(3 * rate_hz)
    assert world.slave.tick - cycled == 3000
    expected = true_force(world, rows)
    assert expected.max() > 50.0
    assert np.count_nonzero(np.diff(expected[expected > 0])) > rate_hz, "the motion is not held"
    np.testing.assert_allclose(rows[:, COLUMN["rendered_force"]], expected, atol=1e-9)


BAD = Impairment(100 * PERIOD_NS, 25 * PERIOD_NS, loss=0.3, duplicate=0.05, reorder=0.1, burst=3.0)


@pytest.mark.parametrize("seed", [0, 1, *cases(2, *range(3, 10))])
def test_adoption_never_steps_the_force_on_a_bad_network(seed: int) -> None:
    """The environment changes in every contact; a change by the blend's own law is no step.

    The law is asked at the hand's place before the tick's change of offset: the hand feels both.
    """
    world = World(Profile(PROFILE), there=BAD, back=BAD, seed=seed, model_after=seed % 3 * 10)
    rng = np.random.default_rng(seed)
    adopted = 0
    for tick in range(4000):
        if tick % 100 == 0:
            world.slave.k = 3600 * rng.uniform(0.3, 2.0)
            world.slave.surface = 0.0137 + rng.uniform(-2e-4, 2e-4)
            world.slave.ticks_in_contact = 0
        laws = world.master.adoption
        old, new, weight = laws.old, laws.new, laws.weight
        offset = world.master.registration.offset
        world.step()
        x, v = world.master.hand - offset, world.master.velocity
        unblended = (1 - weight) * min(100.0, old.force(x, v)) + weight * min(
            100.0, new.force(x, v)
        )
        adopted += new is not laws.new
        assert abs(world.master.force - unblended) <= CONFIG.force_step + 1e-9
    assert adopted > 15
    assert world.master.adoption.largest_step <= CONFIG.force_step + 1e-9
    assert world.master.observer.lowest_J > -world.master.observer.epsilon_J
    assert world.master.observer.injected_J == 0.0


def test_the_same_seed_gives_the_same_run() -> None:
    first, again, other = (
        World(Profile(PROFILE), there=BAD, back=BAD, seed=seed).run(3000) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_a_reset_master_starts_from_the_beginning() -> None:
    world = World(Profile(PROFILE))
    world.run(3000)
    assert world.master.force > 0
    world.master.reset()
    assert world.master.force == world.master.position == 0.0
    assert world.master.adoption.new.energy(1.0) == 0.0
    assert np.isnan(world.master.row).all()


@pytest.mark.parametrize(("rate_hz", "rendered"), [(1000, 750.0), (2000, 1500.0), (4000, 3000.0)])
def test_a_wall_beyond_the_device_is_rendered_reduced_and_both_values_are_kept(
    rate_hz: int, rendered: float
) -> None:
    weak = CONFIG.model_copy(update={"device_damping": 0.375})
    world = World(Profile(PROFILE), config=weak, rate_hz=rate_hz)
    world.run(2 * rate_hz)
    bound = world.master.limiter.rendered_bound
    assert bound.reduced
    assert bound.true_stiffness == 3600.0
    rendered *= STIFFEST_SHARE
    assert world.master.adoption.new.k == bound.rendered_stiffness == pytest.approx(rendered)


@pytest.mark.parametrize(
    ("device", "stiffness", "damping"),
    [
        # b_device = 2 N s/m: K T/2 + B with K = 3600 leaves 0.2 of damping, a raw difference.
        ({"device_velocity": "difference"}, 3600.0, 0.2),
        # K (T/2 + delay) is 2 at K = 1000 for slow tones; motion within a period takes 1.5 % of it.
        (
            {"device_velocity": "difference", "device_delay_ms": 1.5},
            984.85 * CALM_SHARE,
            None,
        ),
    ],
)
def test_the_bound_is_that_of_the_configured_device(
    device: dict, stiffness: float, damping: float | None
) -> None:
    world = World(
        Profile(PROFILE), config=CONFIG.model_copy(update={"device_damping": 2.0} | device)
    )
    world.run(4000)
    bound = world.master.limiter.rendered_bound
    assert bound.rendered_stiffness == pytest.approx(stiffness, rel=1e-3)
    if damping is not None:
        assert bound.rendered_damping == pytest.approx(damping, abs=1e-3)


def test_a_wall_beyond_the_device_is_refused_if_so_configured() -> None:
    strict = CONFIG.model_copy(update={"device_damping": 1.0, "on_violation": "refuse"})
    world = World(Profile(PROFILE), config=strict, model_after=50)
    world.run(4000)
    assert world.master.intake.refused > 10
    assert world.master.adoption.new.k == pytest.approx(100 / 0.12)


def test_wild_models_on_the_wire_change_nothing_under_the_hand() -> None:
    world = World(Profile(PROFILE))
    world.run(3000)
    right = world.slave.model
    for k, b in ((-1.0, 20.0), (3600.0 * 150, 20.0), (1e-3, 0.0), (math.nan, 20.0)):
        world.slave.model = right._replace(k=k, b=b)
        rows = world.run(300)
        np.testing.assert_allclose(
            rows[:, COLUMN["rendered_force"]], true_force(world, rows), atol=1e-9
        )
    assert world.master.screening.refused["negative stiffness"] >= 5
    assert world.master.screening.refused["jump"] >= 10


@pytest.mark.parametrize("place", [1e3, -1e300])
def test_a_slave_that_claims_an_impossible_place_is_not_believed(place: float) -> None:
    world = World(Profile(PROFILE))
    world.run(3000)
    world.slave.model = world.slave.model._replace(model="hunt-crossley", k=50_000.0, n=1.5)
    send = world.slave.endpoint.send
    world.slave.endpoint.send = lambda message: send(
        message._replace(position=place) if isinstance(message, StateMessage) else message
    )
    rows = world.run(300)
    assert np.isfinite(rows[:, COLUMN["rendered_force"]]).all()
    assert world.master.screening.refused["position"] == 300
    assert world.master.intake.withdrawn == 0


HAND = HandOperator(
    kind="hand",
    intention=PROFILE,
    mass=0.3,
    stiffness=600.0,
    damping=12.0,
    tremor=0.2,
    grip_change=0.3,
)


@pytest.mark.parametrize("round_trip_ms", [0, 700])
def test_a_hand_that_pushes_against_what_it_feels_stays_calm_at_any_delay(
    round_trip_ms: int,
) -> None:
    delay = Impairment(delay_ns=round_trip_ms * PERIOD_NS // 2)
    world = World(Hand(HAND, 1e-3, np.random.default_rng(1)), there=delay)
    world.run(5000)
    rows = world.run(3000)
    force = rows[:, COLUMN["rendered_force"]]
    np.testing.assert_allclose(force, true_force(world, rows), atol=1e-9)
    assert 5.0 < force.max() < 25.0
    assert world.master.observer.lowest_J > -world.master.observer.epsilon_J


def test_the_hand_moves_and_feels_by_the_stated_scales() -> None:
    scaled = CONFIG.model_copy(update={"position_scale": 0.5, "force_scale": 0.25})
    fast = PROFILE.model_copy(update={"approach_speed": 0.08, "felt_force": 0.1})
    world = World(Profile(fast), config=scaled, there=Impairment(50 * PERIOD_NS))
    world.run(2500)
    rows = world.run(3000)
    x = 0.5 * rows[:, COLUMN["position"]] - rows[:, COLUMN["offset"]]
    v = 0.5 * rows[:, COLUMN["velocity"]]
    np.testing.assert_allclose(rows[:, COLUMN["target"]], x, atol=1e-12)
    depth = x - world.slave.surface
    wall = np.where(depth > 0, np.maximum(0.0, 3600 * depth + 20 * v), 0.0)
    assert wall.max() > 20
    np.testing.assert_allclose(rows[:, COLUMN["rendered_force"]], 0.25 * wall, atol=1e-9)


def test_the_outcome_reports_what_acted_and_is_json() -> None:
    weak = CONFIG.model_copy(update={"device_damping": 1.0, "force_scale": 2.0})
    world = World(Profile(PROFILE), config=weak, model_after=20, k=400.0)
    world.run(1500)
    world.slave.k, world.slave.ticks_in_contact = 3600.0, 0
    world.run(2500)
    result = json.loads(json.dumps(outcome(world.master), allow_nan=False))
    assert result["state"] == "ENGAGED"
    assert result["passivity"]["stiffness"] == {"true": 3600.0, "rendered": pytest.approx(999.0)}
    assert result["passivity"]["energy_min_J"] >= -result["passivity"]["epsilon_J"]
    assert 0 < result["adoption"]["largest_force_step"] <= CONFIG.force_step + 1e-9
    assert result["adoption"]["energy_J"] > 0
    reason = "the operator's device measures no acceleration"
    assert result["mass"] == {"estimated": 0.0, "rendered": 0.0, "reason": reason}
