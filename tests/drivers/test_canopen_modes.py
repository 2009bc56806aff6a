"""Features of some devices: torque mode, node guarding; and a bus without acknowledgement."""

from __future__ import annotations

import re
from importlib import resources

import numpy as np
import pytest
from framed_bench import RIGS, FramedBench
from rig_bench import Bench, canopen_rig, changed, path, plant_config

from teleop_rt.axis import AxisError, AxisFault
from teleop_rt.config.loader import load_rig
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt_drivers import registry
from teleop_rt_drivers.bus_load import canopen_load
from teleop_rt_drivers.canopen import eds
from teleop_rt_drivers.canopen.drive_config import TorqueConfig
from teleop_rt_drivers.canopen.node_config import GuardingConfig
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.simulated.synchronous_bus import as_sent

TORQUE = TorqueConfig(rated_force=200.0, stiffness=31.6e3, damping=503.0)


def torque_bench(**drive):
    rig = changed(canopen_rig(), drive={"torque": TORQUE, **drive})
    plant = plant_config(drive={"mass": 2.0}, sensors={"force_noise": 0.0})
    return Bench(axis_rig=rig, device_rig=canopen_rig(), plant=plant)


def test_in_torque_mode_the_loop_is_closed_by_the_daemon_and_follows():
    bench = torque_bench().armed()
    drive = bench.simulated.drive
    assert drive.value(0x6060) == 10
    assert drive.value(0x6072) == 600  # 120 N of 200 N
    errors, forces = [], []
    for k in range(700):
        bench.cycle(path(k))
        forces.append(bench.simulated.plant.force)
        errors.append(abs(bench.simulated.plant.position - path(k)))
    assert max(errors) < 3e-3  # the body's 43 N against 31.6 N/mm, and the loop's lag
    assert max(forces) > 25.0
    bench.axis.stop()
    bench.silence(200)
    assert not drive.powered


def test_enabling_in_torque_mode_pushes_nothing():
    bench = torque_bench()
    bench.axis.configure()
    bench.axis.arm()
    while not bench.cycle(0.0).enabled:
        assert bench.simulated.plant.servo_force == 0.0
    bench.cycles(5, 0.0)
    assert abs(bench.simulated.plant.servo_force) < 0.5
    assert abs(bench.simulated.plant.position) < 1e-5


def test_the_force_is_within_the_drives_limit_and_ends_with_the_measurement():
    bench = torque_bench().armed()
    bench.cycles(3, 0.05)
    assert bench.simulated.plant.servo_force == pytest.approx(120.0)
    bench.simulated.inject("mute", "encoder")
    bench.cycles(8, 0.05)
    assert bench.simulated.plant.servo_force == 0.0


def test_a_drive_of_another_rated_torque_is_refused_with_both_values():
    bench = torque_bench(torque=TORQUE.model_copy(update={"rated_force": 150.0}))
    with pytest.raises(AxisError, match=r"6076h\) is 200, the rig's config says 150"):
        bench.axis.configure()


def test_a_drive_without_the_mode_is_refused(tmp_path):
    text = (resources.files("teleop_rt_drivers") / "eds" / "drive_cia402.eds").read_text()
    file = tmp_path / "position_only.eds"
    file.write_text(text.replace("0x00000280", "0x00000080"))
    rig = changed(canopen_rig(), drive={"torque": TORQUE, "eds": str(file)})
    with pytest.raises(AxisError, match="no cyclic synchronous torque mode"):
        Bench(axis_rig=rig, device_rig=rig).axis.configure()


def guarded_eds(tmp_path):
    """The force sensor without heartbeat, with node guarding."""
    text = (resources.files("teleop_rt_drivers") / "eds" / "force_cia404.eds").read_text()
    text = text.replace("=0x1017\n", "=0x100C\n")
    section = re.search(r"\[1017\].*?\n\n", text, re.DOTALL).group()
    guard = section.replace("[1017]", "[100C]").replace("Producer heartbeat time", "Guard time")
    life = guard.replace("[100C]", "[100D]").replace("DataType=0x0006", "DataType=0x0005")
    text = text.replace(section, guard + life)
    count = int(re.search(r"\[OptionalObjects\]\nSupportedObjects=(\d+)", text).group(1))
    text = text.replace(
        f"[OptionalObjects]\nSupportedObjects={count}\n",
        f"[OptionalObjects]\nSupportedObjects={count + 1}\n{count + 1}=0x100D\n",
    )
    file = tmp_path / "guarded.eds"
    file.write_text(text.replace("DefaultValue=20\n", "DefaultValue=0\n"))
    return str(file)


@pytest.fixture
def guarded(tmp_path):
    guarding = GuardingConfig(period_ms=10, life_factor=3)
    rig = changed(canopen_rig(), force={"eds": guarded_eds(tmp_path), "guarding": guarding})
    return Bench(axis_rig=rig, device_rig=rig)


def test_a_device_without_heartbeat_is_guarded_and_stays(guarded):
    guarded.armed()
    device = guarded.simulated.devices["force sensor"]
    assert (device.value(0x100C), device.value(0x100D)) == (10, 3)
    sample = guarded.cycles(200)
    assert sample.valid
    assert sample.fault is AxisFault.NONE
    assert guarded.axis.counters["bad_toggle"] == 0
    assert device.value(0x1003, 0) == 0


def test_a_guarded_device_that_does_not_answer_is_lost(guarded):
    guarded.armed()
    guarded.simulated.inject("mute", "force sensor")
    assert guarded.cycles(18).fault is AxisFault.NONE
    assert guarded.cycles(20).fault is AxisFault.DEVICE_LOST


def test_an_answer_with_the_wrong_toggle_bit_is_no_sign_of_life(guarded):
    guarded.armed()
    device = guarded.simulated.devices["force sensor"]
    answer = device.receive_guard

    def stuck(now_ns):
        device._toggle = 0
        answer(now_ns)

    device.receive_guard = stuck
    guarded.cycles(60)
    assert guarded.sample.fault is AxisFault.DEVICE_LOST
    assert guarded.axis.counters["bad_toggle"] > 1


def test_a_guarded_device_finds_that_the_daemon_is_gone(guarded):
    guarded.armed()
    guarded.silence(25)
    device = guarded.simulated.devices["force sensor"]
    assert device.value(0x1003, 0) == 0
    guarded.silence(20)
    assert device.value(0x1003, 1) == 0x8130


def test_a_device_without_heartbeat_needs_guarding(tmp_path):
    rig = changed(canopen_rig(), force={"eds": guarded_eds(tmp_path)})
    with pytest.raises(AxisError, match=r"no heartbeat \(1017h\): write `guarding"):
        Bench(axis_rig=rig, device_rig=rig).axis.configure()


def test_guarding_costs_two_frames_a_period(guarded):
    config = guarded.config
    plain = config.model_copy(
        update={"force": config.force.model_copy(update={"guarding": None, "heartbeat_ms": 10})}
    )
    dictionaries = {n: eds.load(node.eds, node.node_id) for n, node in config.nodes.items()}
    loads = [canopen_load(c, dictionaries, 1_000_000).per_second for c in (config, plain)]
    assert loads[0] - loads[1] == pytest.approx(55 * 100)


def test_without_acknowledgement_the_queue_is_purged_and_nothing_fires_when_power_returns():
    bench = Bench().armed()
    for k in range(60):
        bench.cycle(path(k))
    bench.simulated.inject("no_acknowledge", "drive")
    for k in range(60, 70):
        bench.cycle(path(k) + 0.01)
    assert bench.sample.fault is AxisFault.NOT_ACKNOWLEDGED
    arrived = []
    deliver = bench.device_end.deliver
    bench.device_end.deliver = lambda message: (arrived.append(as_sent(message)), deliver(message))
    bench.axis.stop()
    bench.simulated.heal("drive")
    assert not [data for can_id, data in arrived if can_id == 0x230 and data[0] == 0x0F]
    bench.cycles(20, 0.02)
    bench.silence(100)
    assert not bench.simulated.drive.powered
    assert arrived
    assert np.isfinite(bench.sample.position)
    bench.axis.configure()
    assert bench.cycles(5).valid


def without_encoder(folder):
    """The rig's file as of one whose only encoder is the drive's."""
    text = (RIGS / "simulated_canopen.yaml").read_text()
    begin, end = text.index("  encoder:\n"), text.index("  force:\n")
    text = text[:begin] + "  position: from drive\n" + text[end:]
    file = folder / "rig.yaml"
    file.write_text(text)
    return file


def test_a_rig_without_an_encoder_takes_the_drive_s_position(tmp_path):
    file = without_encoder(tmp_path)
    with pytest.raises(ConfigError, match=r"unsafe_i_know: .position_comparison"):
        load_rig(file, registry.AXIS_SCHEMAS)
    file.write_text(file.read_text() + "\nunsafe_i_know: [position_comparison]\n")
    rig = load_rig(file, registry.AXIS_SCHEMAS)
    assert not [found for found in check_rig(rig) if found.severity == "error"]
    bench = FramedBench(rig, plant=plant_config())
    bench.axis.configure()
    bench.axis.arm()
    for _ in range(15):
        bench.cycle(0.0)
    truths = {}
    for k in range(200):
        sample = bench.cycle(5e-5 * k)
        truths[bench.now] = bench.simulated.plant.position
        assert sample.valid
        if k > 5:
            assert sample.position == pytest.approx(truths[sample.position_stamp_ns], abs=1e-6)
    assert sample.position > 8e-3
    assert set(bench.simulated.devices) == {"force sensor", "drive"}
    bench.simulated.inject("mute_pdo", "drive")
    for _ in range(4):
        bench.cycle(0.01)
    assert bench.sample.stale == "drive: no new value"


def test_a_position_from_the_drive_beside_an_encoder_is_refused(tmp_path):
    text = (RIGS / "simulated_canopen.yaml").read_text()
    file = tmp_path / "rig.yaml"
    file.write_text(text.replace("  force:\n", "  position: from drive\n  force:\n", 1))
    with pytest.raises(ConfigError, match="no encoder beside it"):
        load_rig(file, registry.AXIS_SCHEMAS)
