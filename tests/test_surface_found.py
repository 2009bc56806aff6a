"""The surface has one definition and two finders: on line in one approach, off line over all.

It is the position from which the force on the way in is no longer that of free air. On line it is
found at once, from one approach, with the noise that the rig declares; where a recording's air is
quiet, the diagnosis takes the same onset. It looks first at corners of all approaches, because a
recording's air may drift, rub and swing with the tool, and its noise is not declared.
"""

import numpy as np
import pytest

from teleop_rt.diagnosis.samples.onset import onset
from teleop_rt.diagnosis.samples.surface import surface_of
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for
from teleop_rt.estimation.settings import PipelineSettings
from teleop_rt.recordings.recording import from_arrays
from teleop_rt.recordings.rows import force_noise
from teleop_rt_dev.estimation.plant import Press, hunt_crossley, kelvin_voigt, record

NOISE_N, DT_S = 0.05, 1e-3
PRESS = Press(duration=6.5)
SETTINGS = PipelineSettings(
    period_s=DT_S, position_resolution=5e-6, force_noise=NOISE_N, onset_force=0.5,
    release_force=0.3, force_lag_s=1e-3,
)  # fmt: skip


def layered(x, v):
    return kelvin_voigt(x, v) + 2500.0 * np.maximum(x - 0.009, 0.0)


def stiffening(x, v):
    """Nine times as stiff at full depth as at the surface: two lines meet deep inside."""
    depth = np.maximum(x, 0.0)
    return np.where(x > 0, 3600.0 * x * (0.3 + 3.0 * (depth / 0.012) ** 2) + 20.0 * v, 0.0)


def on_line(position, force):
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), SETTINGS)
    first = slice(0, 900)  # the first approach, and no lift-off after which the surface is refined
    pipeline.run(position[first], force[first], np.ones(900, dtype=bool))
    assert pipeline.contact.contact_id == 1
    return pipeline.contact.surface


@pytest.mark.parametrize(
    ("law", "at_once_m", "off_line_m"),
    [
        (kelvin_voigt, 1e-4, 1e-4),
        (layered, 1e-4, 1e-4),
        (hunt_crossley, 4e-4, 8e-4),
        (stiffening, 1e-4, 2.5e-3),
    ],
)
def test_both_finders_agree_with_the_plant_within_what_they_state(law, at_once_m, off_line_m):
    for seed in range(3):
        position, force, _ = record(PRESS, law, seed=seed, noise=NOISE_N)
        assert on_line(position, force) == pytest.approx(PRESS.surface, abs=at_once_m)
        found = surface_of(from_arrays("press", DT_S * np.arange(force.size), position, force))
        assert found.clear
        assert found.position == pytest.approx(PRESS.surface, abs=off_line_m)
        assert abs(found.position - PRESS.surface) < found.within


def test_the_noise_that_one_declares_is_what_the_other_estimates():
    for seed in range(3):
        assert force_noise(record(PRESS, kelvin_voigt, seed=seed, noise=NOISE_N)[1]) == (
            pytest.approx(NOISE_N, rel=0.05)
        )


@pytest.mark.parametrize(
    ("law", "swing_hz", "share"), [(stiffening, 2.3, 0.07), (kelvin_voigt, 7.0, 0.1)]
)
def test_an_onset_as_on_line_is_not_taken_where_the_air_swings(law, swing_hz, share):
    """Each contact then seems to begin elsewhere."""
    position, force, _ = record(PRESS, law, noise=NOISE_N)
    swings = np.sin(2 * np.pi * swing_hz * DT_S * np.arange(force.size))
    found = onset(position, force + share * np.max(force) * swings, DT_S)
    assert found is not None
    assert not found.clear
