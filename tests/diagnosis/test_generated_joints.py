"""The generators' joints: a spring in front of a body gives way under all of its force."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt_dev.diagnosis.foreign_rigs import Rig
from teleop_rt_dev.diagnosis.plants import SyntheticPlant

H = 1e-4
SLOW_M = 2e-3 * np.sin(0.4 * np.pi * H * np.arange(50_000))


def test_a_stiffening_body_behind_a_soft_tool_balances_it_at_its_own_depth() -> None:
    rig = Rig(np.random.default_rng(1), H * np.arange(SLOW_M.size), SLOW_M, "kelvin-voigt",
              k=1500.0, b=1e-9, n=1.0, m=0.0)  # fmt: skip
    rig.material.append((lambda x, g: g * np.maximum(x, 0.0) ** 3, 4e8))
    rig.soft = 1.0 / 6000.0
    force = rig.force()
    depth = np.maximum(SLOW_M - rig.soft * force, 0.0)
    assert force == pytest.approx(1500.0 * depth + 4e8 * depth**3, abs=1e-3 * np.max(force))


def test_the_spring_in_front_of_a_plant_carries_the_effects_of_its_material() -> None:
    plant = SyntheticPlant(np.random.default_rng(3), "silicone", "rich", seconds=5.0)
    plant.apply("nonlinear_stiffening", 0.5)
    plant.apply("series_compliance", 0.3)
    [(_, stiffness)] = plant.channel
    force = plant.true_force()
    depth = plant.tip - force / stiffness
    body = plant.k * depth + plant.b * np.gradient(depth, H) + plant.body
    inside = (plant.tip > 0.1 * plant.depth) & (np.gradient(plant.tip) > 0.0)
    error = np.abs(force - body)[inside]
    assert np.max(error) < 0.01 * np.max(force)
