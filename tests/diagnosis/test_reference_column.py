"""A column with the commanded motion checks the parameters by instruments."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.layout import Layout
from teleop_rt.recordings.recording import load

MASS_KG, DAMPING = 2.0, 30.0
COLUMNS = {"time": "t", "position": "moved", "force": "pushed"}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Write the recording of a position loop that moves a mass: commands in mm, a noisy force."""
    t = np.arange(0.0, 6.0, 1e-4)
    tones = ((0.7, 0.0), (1.9, 1.0), (4.3, 2.0))
    asked = sum(0.01 * np.sin(2 * np.pi * hz * t + phase) for hz, phase in tones)
    rates = np.gradient(asked, t)
    place, speed = 0.0, 0.0
    moved, pushed = np.empty(t.size), np.empty(t.size)
    for i, (wanted, rate) in enumerate(zip(asked, rates, strict=True)):
        force = 4000.0 * (wanted - place) + 100.0 * (rate - speed)
        moved[i], pushed[i] = place, force
        speed += 1e-4 * (force - DAMPING * speed) / MASS_KG
        place += 1e-4 * speed
    pushed += np.random.default_rng(7).normal(0.0, 0.1, t.size)
    path = tmp_path_factory.mktemp("loop") / "loop.csv"
    table = np.stack([t, moved, pushed, 1e3 * asked], axis=1)[::20]
    np.savetxt(path, table, delimiter=",", header="t,moved,pushed,asked", comments="")
    return path


def test_the_commanded_motion_gives_parameters_beside_those_of_least_squares(recorded):
    layout = Layout({**COLUMNS, "reference": "asked"}, {"reference": "mm"})
    found = diagnose(load(recorded, layout), "mass-damper").answer["instruments"]
    assert found["from"] == "reference"
    for name, true in (("m", MASS_KG), ("c", DAMPING)):
        one = found["parameters"][name]
        assert one["value"] == pytest.approx(true, rel=0.01)
        assert one["value"] != one["least_squares"]
        assert 0.0 < one["std"] < 0.01 * true


def test_without_that_column_no_parameter_is_checked(recorded):
    answer = diagnose(load(recorded, Layout(COLUMNS, {})), "mass-damper").answer
    assert answer.get("instruments") is None
