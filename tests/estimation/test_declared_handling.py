"""The corrections treat each effect of the rig as its declaration states."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.contact.fitted import FittedEffect
from teleop_rt.estimation.corrections import Corrections

KINEMATIC = [e for e in LIBRARY if e.belongs_to == "rig" and e.stage == "kinematics"]
SCALES = {"travel": 0.016, "speed": 0.08, "duration": 4.0, "compliance": 1e-3, "force": 40.0}
DT = 1e-3


@pytest.mark.parametrize("effect", KINEMATIC, ids=lambda e: f"{e.name} {e.law}".strip())
def test_the_position_is_corrected_exactly_where_the_declaration_states_it(effect: Effect) -> None:
    eta = np.array([s.start * SCALES.get(s.relative_to, 1.0) for s in effect.shapes] or [0.0])
    corrections = Corrections([FittedEffect(effect, 1e-3, eta)], DT, 0.01, 0.0)
    way = 0.008 * (1.0 - np.cos(20.0 * DT * np.arange(500)))
    corrected = np.array([corrections.apply(x, 2000.0 * x, 0.0) for x in way])
    moved = bool(np.any(corrected != way))
    # A channel that is slow is paired with a position that is as slow.
    slowed = effect.acts == "filters_force"
    assert moved == (slowed or effect.compensation == "correct_position")
