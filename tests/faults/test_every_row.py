"""Every row of the fault table, injected in contact; the campaign plays the other phases."""

from contextlib import closing

import pytest

from teleop_rt_dev.faults.actuator_rows import ACTUATOR_ROWS
from teleop_rt_dev.faults.rows import ROWS, Row, play
from teleop_rt_dev.faults.world import FaultWorld


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name.replace(" ", "-"))
def test_a_fault_in_contact_is_detected_in_time_and_ends_as_it_must(row, tmp_path):
    outcome = play(row, "contact", 1, tmp_path)
    assert outcome.problem == ""
    assert outcome.peak_force_N < 90


FEW = [
    row
    for row in ACTUATOR_ROWS
    if row.name
    in {
        "odrive answers under another id",
        "damiao too hot",
        "moteus silent",
        "robstride: daemon killed or frozen",
        "dynamixel: daemon killed or frozen",
        "feetech: cable pulled",
        "vesc lets go and does not say so",
        "damiao repeats its last answer",
        "feetech repeats its last answer",
    }
]
"""One of each drive; the campaign plays all of them, in every phase."""


@pytest.mark.parametrize("row", FEW, ids=lambda row: row.name.replace(" ", "-"))
def test_a_maker_s_drive_that_fails_in_contact_stops_the_axis_in_time(row, tmp_path):
    outcome = play(row, "contact", 1, tmp_path)
    assert outcome.problem == ""
    assert outcome.peak_force_N < (40 if "repeats" in row.name else 30)


AT_REST = [row for row in ACTUATOR_ROWS if row.before_arming and row.rig in {"canopen", "damiao"}]
SHOVED = [row for row in ACTUATOR_ROWS if row.name.startswith(("robstride stops", "mixed rig st"))]


@pytest.mark.parametrize(
    ("row", "phase"), [(row, "arming") for row in AT_REST] + [(row, "contact") for row in SHOVED]
)
def test_refused_power_and_too_much_force_end_without_power(row, phase, tmp_path):
    assert play(row, phase, 1, tmp_path).problem == ""


WHILE_ARMING = [row for row in ROWS if row.stops and "arming" in row.phases]


@pytest.mark.parametrize("row", WHILE_ARMING, ids=lambda row: row.name.replace(" ", "-"))
def test_a_fault_while_arming_stops_before_anything_moves(row, tmp_path):
    with closing(FaultWorld(tmp_path, row.rig, 2, *row.overrides)) as world:
        world.lead_to("arming")
        row.inject(world)
        world.until(lambda: False, row.bound_ms + 200)
    assert world.axis.last == "stop"
    assert abs(world.rig.plant.position) < 1e-5
    assert not world.rig.drive.powered


def test_without_a_fault_nothing_is_detected(tmp_path):
    quiet = Row("nothing", lambda world: None, lambda world: world.state.value >= 6, 300)
    outcome = play(quiet, "contact", 1, tmp_path)
    assert "never detected" in outcome.problem
    assert "the last command was write" in outcome.problem
