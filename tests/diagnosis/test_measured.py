"""Recordings of real machines: what is expected comes from physics, not from tuning."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.recording import Layout, load

DATA = os.environ.get("TELEOP_RT_DATA", "")
pytestmark = pytest.mark.skipif(not DATA, reason="TELEOP_RT_DATA is not set: no measured data")


def test_friction_is_found_in_the_emps_drive_and_holds_on_its_test_file() -> None:
    layout = Layout({"time": "t", "position": "qm", "force": "vir"}, {"force": "35.15065188"})
    folder = Path(DATA) / "emps"
    record = load(folder / "DATA_EMPS.mat", layout)
    fresh = load(folder / "DATA_EMPS_PULSES.mat", layout)
    found = diagnose(record, "mass-damper", test=fresh).answer
    assert found["effects"][0]["name"] == "coulomb_friction"
    assert found["base"]["parameters"]["m"]["value"] == pytest.approx(95.1, rel=0.02)
    smooth = found["error"]["std_normalised_low_passed"]
    assert smooth["before"] > 0.15
    assert smooth["after"] < 0.06


def test_friction_or_hysteresis_is_found_in_the_damper_without_current() -> None:
    layout = Layout({"position": "x_F[0]", "force": "x_F[2]"}, {"position": "mm"}, rate_hz=100.0)
    record = load(Path(DATA) / "mr_damper" / "data_simulation_4.1_MRdamper.mat", layout)
    found = diagnose(record, "spring,viscous,bias").answer
    families = {e["family"] for e in found["effects"]} | {found["family"]}
    assert families & {"friction", "hysteresis"}
