"""A wall that is rendered softer than it is: the tool presses harder than the hand feels."""

import numpy as np
import pytest

from teleop_rt.config.section import Units
from teleop_rt.trial.softened import most_unfelt, softened
from teleop_rt_dev.trial.files import silicone

UNITS = Units(position="m", force="N")
UNFELT = {"pressed": 71.4, "felt": 10.0, "share": 0.14, "at_s": 7.6}


def master(rendered, unfelt=UNFELT):
    stiffness = {"true": 50_087.0, "rendered": rendered}
    return {"rendering": {"passivity": {"stiffness": stiffness}}, "unfelt": unfelt}


def test_a_softened_wall_is_said_with_the_force_that_was_not_felt():
    assert softened(master(6517.0), UNITS) == (
        "14% at 7.6 s: the tool pressed with 71.4 N and the hand felt 10; "
        "at most 6520 N/m is passive on this device; with its damping the wall has 50100"
    )
    assert softened(master(6517.0, None), UNITS).startswith("at most 6520 N/m")


@pytest.mark.parametrize("rendered", [0.0, 50_087.0])
def test_of_a_wall_rendered_whole_or_not_at_all_nothing_is_said(rendered):
    assert softened(master(rendered), UNITS) is None
    assert softened({"rendering": None}, UNITS) is None


def test_a_force_that_comes_back_a_round_trip_late_is_compared_with_the_one_felt_before():
    """150 ms late, the slave's peaks meet the hand's troughs."""
    trial, ticks = silicone(), np.arange(9000)
    wave = 20.0 + 15.0 * np.sin(ticks / 50.0)
    columns = {
        "stamp_ns": 1e6 * ticks,
        "contact_id": (ticks > 500).astype(float),
        "rendered_force": wave,
        "reflected_force": np.roll(wave, 150),
    }
    assert (found := most_unfelt(trial, columns)) is not None
    assert found["pressed"] - found["felt"] <= 0.0
    columns["rendered_force"] = wave.copy()
    columns["rendered_force"][6000:6500] = 5.0
    assert (found := most_unfelt(trial, columns)) is not None
    assert found["felt"] == 5.0
    assert found["pressed"] == pytest.approx(35.0, abs=0.1)
    assert found["share"] == pytest.approx(5.0 / 35.0, rel=0.01)
    assert 6.2 <= found["at_s"] < 6.65
    assert most_unfelt(trial, {key: values[:400] for key, values in columns.items()}) is None
    assert most_unfelt(trial, columns | {"reflected_force": 0.0 * wave}) is None
