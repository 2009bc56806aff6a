"""A passive hand on the rendered port, whatever models arrive."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from master_world import CONFIG, KEY, LIMITS, PERIOD_NS, SteppedClock

from teleop_rt.link.channel import Endpoint
from teleop_rt.link.codec import WIRE_CODES
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import ModelMessage, StateMessage
from teleop_rt.link.transport import MemoryTransport
from teleop_rt.master.master import Master

T = PERIOD_NS * 1e-9
SUBSTEPS = 20
CALM = CONFIG.model_copy(update={"device_damping": 3.0, "tank_capacity_mJ": 1.0})


class PassiveHand:
    """A mass on a spring and damper at rest where `goal` is; it never does work of its own."""

    mass, stiffness, damping, goal = 0.3, 300.0, 1.0, 0.01

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.x, self.v, self.t_s = 0.0, 0.0, 0.0

    def energy(self) -> float:
        return self.mass * self.v**2 / 2 + self.stiffness * (self.x - self.goal) ** 2 / 2

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        if t_s > self.t_s:
            self.t_s = t_s
            for _ in range(SUBSTEPS):
                force = self.stiffness * (self.goal - self.x) - felt_force
                force -= (self.damping + CALM.device_damping) * self.v
                self.v += force / self.mass * T / SUBSTEPS
                self.x += self.v * T / SUBSTEPS
        return self.x, self.v


FINITE = st.floats(allow_nan=False, allow_infinity=False)
WILD_MODELS = st.tuples(
    st.sampled_from(sorted(WIRE_CODES)),
    st.just(1),
    st.integers(0, 5),
    st.floats(-0.02, 0.02),
    st.booleans(),
    st.one_of(FINITE, st.floats(-1e6, 1e6), st.floats(0, 20_000)),
    st.one_of(FINITE, st.floats(-100, 1000)),
    st.one_of(FINITE, st.floats(0.5, 3.0)),
    FINITE,
    st.one_of(FINITE, st.floats(-2, 2)),
).map(lambda numbers: ModelMessage(*numbers))


class Stream:
    """A master in a passive hand, and a slave's end that streams models as they come."""

    def __init__(self) -> None:
        self.clock = SteppedClock()
        near, far = MemoryTransport.pair()
        end, self.far_end = (
            Endpoint(role, transport, shared_key(KEY), self.clock, rate_hz=1000)
            for role, transport in (("master", near), ("slave", far))
        )
        self.hand = PassiveHand()
        self.master = Master(CALM, LIMITS, PERIOD_NS, self.hand, end, self.clock)
        while not self.master.engagement.ever_engaged:
            self.step()

    def step(self) -> None:
        self.clock.now += PERIOD_NS
        self.far_end.poll()
        self.far_end.send(StateMessage(self.master.x, 0.0, 0, in_contact=False))
        self.master.cycle()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 60), WILD_MODELS), min_size=1, max_size=15))
def test_no_sequence_of_models_drives_a_passive_hand(
    stream: list[tuple[int, ModelMessage]],
) -> None:
    world = Stream()
    master = world.master
    spent_J, allowance_J = 1e-3 * CALM.tank_capacity_mJ, 1e-3 * CALM.tank_power_mW * T
    budget_J = world.hand.energy()
    for ticks, model in [*stream, (300, stream[-1][1])]:
        world.far_end.send(model)
        for _ in range(ticks):
            world.step()
            spent_J += allowance_J
            assert abs(master.force) <= CALM.force_max
            assert world.hand.energy() <= budget_J + spent_J + 1e-4
        assert master.intake.model == model


@pytest.mark.parametrize("k", [2000.0, 6000.0, 50_000.0])
def test_a_passive_hand_comes_to_rest_on_whatever_stiffness(k: float) -> None:
    world = Stream()
    motion = []
    for tick in range(6000):
        if tick % 50 == 10:
            world.far_end.send(ModelMessage("kelvin-voigt", tick, 1, 0.005, k=k, b=20.0))
        world.step()
        motion.append(world.hand.v)
    assert world.master.force > 1.0
    assert np.abs(motion[-1000:]).max() < 1e-3
