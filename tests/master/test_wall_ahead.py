"""The wall of a model is made ahead of the tick that takes it, where a loop has time for it."""

from __future__ import annotations

import numpy as np
import pytest
from master_world import World

from teleop_rt.config.operator import ProfileOperator
from teleop_rt.contact.effect import MOST_SHAPES
from teleop_rt.contact.effects import LIBRARY, find
from teleop_rt.contact.fitted import code_of
from teleop_rt.link.messages import ModelEffect, ModelMessage
from teleop_rt.master.operators import Profile

PROFILE = ProfileOperator(
    kind="profile", approach_speed=0.04, mean=0.008, amplitude=0.005, frequency_hz=2.0,
    felt_force=0.5, lift_off_every_s=2.0, lift_off_height=0.004,
)  # fmt: skip
EFFECT = ModelEffect(
    code_of(find("nonlinear_stiffening", "")), 3e5, (2.0, *(MOST_SHAPES - 1) * (0.0,))
)


class Pressed:
    """A hand on a wall, and how often models were screened."""

    def __init__(self) -> None:
        self.world = World(Profile(PROFILE), library=LIBRARY)
        self.world.run(2000)
        self.master, self.screened = self.world.master, 0
        self._check = self.master.screening.check
        self.master.screening.check = self._counted

    def _counted(self, model: ModelMessage) -> ModelMessage | None:
        self.screened += 1
        return self._check(model)

    def model(self, k: float, effects: tuple[ModelEffect, ...] = ()) -> ModelMessage:
        """Return a model of the slave that is news, and keep its other ones away."""
        slave = self.world.slave
        assert slave.model is not None
        model, slave.model = slave.model._replace(k=k, effects=effects), None
        return model

    def come(self, model: ModelMessage, *, ahead: bool) -> None:
        """Let a model come before the next tick, which is taken in ahead or in it."""
        endpoint = self.master.endpoint
        if ahead:
            endpoint.take_ahead = lambda: endpoint.hold_model(model)
            self.master.take_ahead()
        else:
            endpoint.hold_model(model)


@pytest.mark.parametrize("k", [2500.0, -1.0, 3e6])
def test_a_model_taken_ahead_is_rendered_as_one_taken_in_the_tick(k: float) -> None:
    rows, refused = [], []
    for ahead in (True, False):
        pressed = Pressed()
        pressed.come(pressed.model(k), ahead=ahead)
        rows.append(pressed.world.run(300))
        refused.append(pressed.master.screening.refused)
        assert pressed.screened == 1
    np.testing.assert_array_equal(*rows)
    assert refused[0] == refused[1]


def test_the_tick_itself_screens_no_model_that_was_taken_ahead() -> None:
    pressed = Pressed()
    pressed.come(pressed.model(2500.0), ahead=True)
    assert pressed.screened == 1
    pressed.master.take_ahead()
    pressed.world.run(10)
    assert pressed.screened == 1
    assert pressed.master.adoption.newest.k == 2500.0
    pressed.master.intake.render_anew(pressed.master.hand, 0.0)
    assert pressed.screened == 2, "a wall that is rendered again is screened again"


def test_effects_wait_for_the_tick_from_which_their_memories_follow_the_hand() -> None:
    pressed = Pressed()
    pressed.come(pressed.model(3600.0, (EFFECT,)), ahead=True)
    assert pressed.screened == 0
    pressed.world.run(1)
    assert pressed.screened == 1
    assert pressed.master.adoption.newest.terms


def test_a_wall_made_ahead_is_forgotten_with_the_session() -> None:
    pressed = Pressed()
    model = pressed.model(2500.0)
    pressed.come(model, ahead=True)
    pressed.master.intake.forget()
    pressed.come(model, ahead=True)
    assert pressed.screened == 2


def test_nothing_is_screened_ahead_before_the_hand_leads() -> None:
    world = World(Profile(PROFILE))
    model = ModelMessage("kelvin-voigt", 1, 1, 0.0, k=-1.0)
    world.master.endpoint.take_ahead = lambda: world.master.endpoint.hold_model(model)
    world.master.take_ahead()
    assert world.master.screening.refused == {}
