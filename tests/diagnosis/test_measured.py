"""Recordings of real machines: expectations come from physics, not from tuning."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from cases import cases
from schema_checks import violations

from teleop_rt.cli.schema import SchemaName
from teleop_rt.contact.effects import LIBRARY, NAMES
from teleop_rt.diagnosis.diagnose import diagnose, predicted_on
from teleop_rt.recordings.layout import Layout
from teleop_rt.recordings.recording import load

DATA = os.environ.get("TELEOP_RT_DATA", "")
pytestmark = pytest.mark.skipif(not DATA, reason="TELEOP_RT_DATA is not set: no measured data")


def test_friction_is_found_in_the_emps_drive_and_holds_on_its_test_file() -> None:
    columns = {"time": "t", "position": "qm", "force": "vir", "reference": "qg"}
    layout = Layout(columns, {"force": "35.15065188"})
    folder = Path(DATA) / "emps"
    found = diagnose(load(folder / "DATA_EMPS.mat", layout), "mass-damper")
    answer = found.answer
    assert answer["effects"][0]["name"] == "coulomb_friction"
    # The published reference model (Janot, Gautier, Brunot 2019): 95.1 kg, 203.5 N s/m, 20.39 N.
    assert answer["base"]["parameters"]["m"]["value"] == pytest.approx(95.1, rel=0.01)
    assert answer["base"]["parameters"]["c"]["value"] == pytest.approx(203.5, rel=0.02)
    friction = answer["effects"][0]["parameters"]["friction_force"]["value"]
    assert friction == pytest.approx(20.39, rel=0.02)
    smooth = answer["error"]["std_normalised_low_passed"]
    assert smooth["before"] > 0.15
    assert smooth["after"] <= 0.045
    fresh = predicted_on(found, load(folder / "DATA_EMPS_PULSES.mat", layout)).errors
    assert fresh["std_normalised_low_passed"]["after"] <= 0.06
    assert fresh["std_normalised"]["after"] > fresh["std_normalised_low_passed"]["after"]
    by_instruments = answer["instruments"]["parameters"]["m"]
    assert by_instruments["value"] != by_instruments["least_squares"]
    assert by_instruments["value"] == pytest.approx(95.1, rel=0.01)
    printed = {key: value for key, value in answer.items() if key != "seconds"}
    assert violations(SchemaName.ANSWER, printed) == []


def test_friction_or_hysteresis_is_found_in_the_damper_without_current() -> None:
    layout = Layout({"position": "x_F[0]", "force": "x_F[2]"}, {"position": "mm"}, rate_hz=100.0)
    record = load(Path(DATA) / "mr_damper" / "data_simulation_4.1_MRdamper.mat", layout)
    found = diagnose(record, "spring,viscous,bias").answer
    families = {e["family"] for e in found["effects"]} | {found["family"]}
    assert families & {"friction", "hysteresis"}
    # Greedy least squares of four terms leaves 0.104, friction alone 0.167.
    assert found["error"]["std_normalised"]["after"] < 0.13


def test_bias_and_inertia_appear_in_the_torque_of_a_lever_that_meets_nothing() -> None:
    columns = {"time": "t_s", "position": "xs_rad", "force": "Fe_Nm"}
    layout = Layout(columns, {"position": "rad"})
    record = load(Path(DATA) / "tue_teleop" / "run_a_free_motion.csv", layout)
    found = diagnose(record, "mass").answer
    inertia = found["base"]["parameters"]["m"]
    # Gravity, friction and a lag predict best: the deviation beside the bias alone counts them.
    assert inertia["value"] > 5.0 * inertia["std"]
    assert inertia["value"] == pytest.approx(2.3e-4, rel=0.05)
    # A bias of the sensor and the lever's own weight differ little over a third of a radian.
    assert found["effects"][0]["family"] == "bias"
    assert found["error"]["after"] < 0.035 * found["error"]["before"]


@pytest.mark.parametrize(
    "names", cases(["force_bias", "force_drift", "stress_relaxation"], list(NAMES))
)
def test_a_bias_of_a_lever_is_no_drift_that_settles_at_once(names: list[str]) -> None:
    """Both were named, the drift first, whose model another recording of the lever withdrew."""
    columns = {"time": "t_s", "position": "xs_rad", "force": "Fe_Nm"}
    layout = Layout(columns, {"position": "rad", "force": "Nm"})
    record = load(Path(DATA) / "tue_teleop" / "run_a_spring.csv", layout)
    effects = tuple(effect for effect in LIBRARY if effect.name in names)
    found = diagnose(record, effects=effects).answer
    assert found["class"] == [["force_bias"]]
