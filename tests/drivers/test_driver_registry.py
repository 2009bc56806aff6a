from __future__ import annotations

from pathlib import Path

import pytest
from rig_bench import START_NS, canopen_rig, plant_config

from teleop_rt.axis import AxisError, Sample
from teleop_rt.config.loader import load_rig
from teleop_rt.config.trial import PlantConfig
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt_drivers.opening import open_lock_step, open_rig
from teleop_rt_drivers.registry import AXIS_SCHEMAS, PLANT_SCHEMAS
from teleop_rt_drivers.simulated.config import SimulatedPlantConfig

RIGS = Path(__file__).parents[2] / "config" / "rigs"
TEXT = (RIGS / "simulated_canopen.yaml").read_text()


@pytest.mark.parametrize("file", sorted(RIGS.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_rig_that_is_shipped_loads(file):
    rig = load_rig(file, AXIS_SCHEMAS)
    assert type(rig.axis) is AXIS_SCHEMAS[rig.axis.driver]


def test_lock_step_gives_an_axis_on_running_devices():
    now = START_NS
    axis, simulated = open_lock_step(canopen_rig(), plant_config(), lambda: now, 1)
    axis.configure()
    sample = Sample()
    for _ in range(3):
        axis.read_into(sample)
        axis.write(0.0)
    assert sample.valid
    assert simulated.truth()["units"] == {"position": "m", "force": "N"}


def test_only_rigs_with_simulated_devices_have_a_plant():
    assert PLANT_SCHEMAS["canopen"] is SimulatedPlantConfig
    assert "recording" not in PLANT_SCHEMAS
    assert set(PLANT_SCHEMAS) <= set(AXIS_SCHEMAS)
    with pytest.raises(AxisError, match="no simulated devices"):
        open_rig(load_rig(RIGS / "measured_spring.yaml", AXIS_SCHEMAS), PlantConfig(), lambda: 0, 1)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("scale_m_per_count: 5.0e-6", "scale_m_per_count: -5.0e-6", "greater than 0"),
        ("scale_m_per_count: 5.0e-6", "scale: 5.0e-6", "write scale_m_per_count"),
        ("node_id: 0x20", "node_id: 0x10", "node ids must differ"),
        ("node_id: 0x20", "node_id: 200", "less than or equal to 127"),
        ('position: "0x6004"', "position: 6004", "position"),
        ("heartbeat_timeout_ms: 60", "heartbeat_timeout_ms: 20", "must be above heartbeat_ms"),
        ("daemon_timeout_ms: 60", "daemon_timeout_ms: 10", "must be above daemon.heartbeat_ms"),
        ("    channel: rig", "    chanel: rig", "did you mean 'channel'"),
        ("{vendor: 0x543, product: 0x404}", "{vendor: 0x543}", "product"),
        (
            "driver: canopen",
            "driver: canopn",
            "one of: actuator_device, canopen, canopen_device",
        ),
    ],
)
def test_a_wrong_rig_is_refused_with_the_key(tmp_path, old, new, said):
    assert old in TEXT
    file = tmp_path / "rig.yaml"
    file.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(ConfigError, match=said):
        load_rig(file, AXIS_SCHEMAS)
