"""The depth at which a model reaches a force, whatever the estimator made of it."""

import math
from types import SimpleNamespace

import pytest

from teleop_rt.config_link import LinkConfig
from teleop_rt.estimation.streamed import Wall
from teleop_rt.slave.model_sender import ModelSender


def depth(model, force=10.0, **parameters):
    sender = ModelSender(
        SimpleNamespace(streaming=None), SimpleNamespace(), 0.05, 90.0, LinkConfig(), lambda: 0
    )
    numbers = {"k": 0.0, "b": 0.0, "n": 1.0} | parameters
    sender._sent_wall = Wall(model, 0.0, **numbers, offset=0.0, amplitudes=())
    return sender.depth_of(force, 0.0)


def test_a_spring_gives_force_over_stiffness_and_a_power_law_its_root():
    assert depth("kelvin-voigt", k=1000.0, b=0.0) == pytest.approx(0.01)
    assert depth("hunt-crossley", k=1000.0, b=0.0, n=2.0) == pytest.approx(0.1)


@pytest.mark.parametrize("n", [-2.0, 0.0, 0.05])
def test_an_exponent_that_no_contact_has_has_no_depth_and_stops_no_loop(n):
    assert depth("hunt-crossley", force=0.0, k=1000.0, b=0.0, n=n) == math.inf
