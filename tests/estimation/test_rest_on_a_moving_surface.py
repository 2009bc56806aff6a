"""A tool that rests in a touch while its surface moves: the streamed model can be rendered."""

import numpy as np
import pytest

from teleop_rt.contact.law import EXPONENT_LEAST, EXPONENT_MOST
from teleop_rt.estimation.layout import WARMING_UP
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for
from teleop_rt_dev.estimation.plant import Press, hunt_crossley

from .cube_rig import SETTINGS

DT = SETTINGS.period_s
PRESSES = Press(duration=8.0)
NEARER, REST_DEPTH = 4e-3, 1e-3
REST, WAY = 500, 300
"""Samples of the rest, and of the way to it and back."""


def presses_and_rest(velocity):
    """Return positions and surfaces: presses, a rest on the body, now 4 mm nearer, and presses.

    During the rest the surface moves at `velocity` [m/s].
    """
    presses = PRESSES.position(DT * np.arange(round(PRESSES.duration / DT)))
    met = PRESSES.surface - NEARER
    way = np.linspace(PRESSES.surface - 10e-3, met + REST_DEPTH, WAY)
    moved = met + velocity * DT * np.arange(REST)
    position = [presses, way, np.full(REST, way[-1]), way[::-1], presses]
    surface = [np.full(presses.size, PRESSES.surface), np.full(WAY, met), moved]
    surface.append(np.full(WAY + presses.size, moved[-1]))
    return np.concatenate(position), np.concatenate(surface)


@pytest.mark.parametrize("velocity", [-2e-3, 2e-3])
def test_a_power_law_is_not_streamed_while_its_exponent_is_of_no_wall(velocity):
    position, surface = presses_and_rest(velocity)
    rng = np.random.default_rng(1)
    force = hunt_crossley(position - surface, np.gradient(position, DT))
    force += SETTINGS.force_noise * rng.standard_normal(force.size)
    pipeline = Pipeline(rows_for(["kelvin-voigt", "hunt-crossley"], ["direct"], ["rls"]), SETTINGS)
    trace = pipeline.run(position, force, np.ones(force.size, dtype=bool))
    n, selected, other = trace.physical(1, "n"), trace.signals[:, 5], trace.status[:, 0]
    absurd = (n < EXPONENT_LEAST) | (n > EXPONENT_MOST)
    met, left = round(PRESSES.duration / DT), -round(PRESSES.duration / DT)
    assert selected[met] == 1, "the presses show the power law"
    assert absurd[met:left].sum() > 100, "the rest shows no exponent"
    assert not np.any(absurd & (selected == 1) & (other != WARMING_UP))
    assert selected[-1] == 1, "so do the presses after the rest"
