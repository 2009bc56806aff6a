"""Drives with protocols of their makers: trial, faults, watchdog, alike for all."""

from __future__ import annotations

import textwrap

import pytest
from armed_actuators import DRIVES, ON_LINES, armed, at_1_khz, cycle, until
from framed_bench import RIGS, FramedBench, load
from rig_bench import MS, plant_config
from test_trial_on_every_rig import TRIAL, kelvin_voigt, open_bench

from teleop_rt.axis import AxisError, AxisFault
from teleop_rt.config.loader import load_rig, load_trial
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_drivers import registry
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.doctor import examine_axis
from teleop_rt_drivers.findings import worst
from teleop_rt_drivers.simulated.reference import environment_force


# One that sends by itself, one with a loop of its own, one on a line; the campaign runs all.
@pytest.mark.parametrize("kind", ["odrive", "damiao", "dynamixel"])
def test_the_default_trial_finds_the_cube_by_the_drive_s_own_position(kind, tmp_path):
    rig = f"rig=../rigs/simulated_{kind}.yaml"
    trial = load_trial(TRIAL, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, [rig, "duration_s=2"])
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, TRIAL, open_bench, tmp_path, lambda _: None)
    summary = summarise(tmp_path, trial, outcome, environment_force)
    k, b = kelvin_voigt(summary)
    assert k == pytest.approx(3600, rel=0.02)
    assert b == pytest.approx(20, abs=1.0)
    assert summary["contact"]["surface_found"] == pytest.approx(0.0137, abs=0.2e-3)
    assert summary["safety"]["fault"]["name"] == "none"
    assert summary["safety"]["samples_rejected"] == 0


@pytest.mark.parametrize("kind", DRIVES)
def test_check_accepts_the_preset_and_counts_its_bus(kind):
    found = check_rig(load(kind))
    assert not [one for one in found if one.severity == "error"]
    on_bus = {"axis.parts.drive.bus", "axis.parts.drive.baud"}
    assert len([one for one in found if one.where in on_bus]) == 1


@pytest.mark.parametrize("kind", DRIVES)
def test_the_drive_follows_and_its_position_is_the_plant_s(kind):
    bench = armed(kind)
    for k in range(150):
        sample = cycle(bench, 4e-5 * k)
        assert sample.valid
        assert sample.position == pytest.approx(bench.simulated.plant.position, abs=1e-4)
    assert bench.simulated.plant.position == pytest.approx(4e-5 * 149, abs=5e-4)


@pytest.mark.parametrize("kind", DRIVES)
def test_an_over_temperature_stops_within_two_heartbeats_and_is_said(kind):
    bench = armed(kind)
    bench.simulated.inject("over_temperature", "drive")
    until(bench, lambda sample: sample.fault is AxisFault.DRIVE_FAULT, 25)
    assert "over" in bench.sample.complaint
    assert "temp" in bench.sample.complaint
    assert not bench.sample.enabled
    with pytest.raises(AxisError, match="DRIVE_FAULT"):
        bench.axis.arm()


def test_an_odrive_without_heartbeat_is_lost_though_its_position_goes_on():
    bench = armed("odrive")
    daemon_end = bench.ends.bus_pair("drive")[0]
    deliver = daemon_end.deliver
    heartbeat = 3 << 5 | 1
    daemon_end.deliver = lambda m: None if m.arbitration_id == heartbeat else deliver(m)
    until(bench, lambda sample: sample.fault is AxisFault.DEVICE_LOST, 60 + 60 + 12)
    assert bench.axis.counters["drive.stale_state"] > 50


def test_an_odrive_that_waits_longer_than_its_watchdog_can_still_be_armed():
    bench = FramedBench(at_1_khz("odrive"), plant=plant_config(start=0.0))
    bench.silence(500)  # power came on long before the daemon
    bench.axis.configure()
    for _ in range(500):
        assert cycle(bench).fault is AxisFault.NONE
    bench.axis.arm()
    until(bench, lambda sample: sample.enabled, 60)
    bench.silence(70)
    until(bench, lambda sample: sample.fault is AxisFault.DRIVE_FAULT, 40)
    assert "watchdog timer expired" in bench.sample.complaint


class LateBench(FramedBench):
    """An ODrive whose frames arrive some time after they were sent."""

    def __init__(self, on_its_way_ms: int) -> None:
        super().__init__(at_1_khz("odrive"), plant=plant_config(start=0.0))
        self.silence(3)
        self.axis.configure()
        daemon_end = self.ends.bus_pair("drive")[0]
        self._deliver, self._held = daemon_end.deliver, []
        self._way_ns = on_its_way_ms * MS
        daemon_end.deliver = lambda frame: self._held.append((self.now, frame))

    def cycle(self, position: float = 0.0):
        while self._held and self._held[0][0] + self._way_ns <= self.now:
            self._deliver(self._held.pop(0)[1])
        return super().cycle(position)


@pytest.mark.parametrize("on_its_way_ms", [0, 4, 9])
def test_an_odrive_is_armed_at_any_time_after_its_watchdog_expired(on_its_way_ms):
    for waited in range(40, 72):  # around the watchdog's 50 ms, over the heartbeat's 10
        bench = LateBench(on_its_way_ms)
        bench.silence(waited)  # the daemon compiles, say
        bench.cycles(12)
        bench.axis.arm()
        for _ in range(60):
            assert cycle(bench).fault is AxisFault.NONE, f"armed after {waited} ms"
        assert bench.sample.enabled


def test_an_odrive_without_power_is_kept_awake_while_the_daemon_runs():
    bench = FramedBench(at_1_khz("odrive"), plant=plant_config(start=0.0))
    bench.axis.configure()
    daemon_end, errors = bench.ends.bus_pair("drive")[0], []
    deliver = daemon_end.deliver

    def noted(frame) -> None:
        if frame.arbitration_id == 3 << 5 | 1:  # a heartbeat
            errors.append(bytes(frame.data[:4]))
        deliver(frame)

    daemon_end.deliver = noted
    for _ in range(500):
        cycle(bench)
    assert len(errors) >= 49
    assert set(errors) == {bytes(4)}


# A VESC does not say whether it has power; that it does not follow is a row of the fault table.
@pytest.mark.parametrize("kind", [kind for kind in DRIVES if kind != "vesc"])
def test_a_drive_that_refuses_power_is_never_enabled(kind):
    bench = FramedBench(load(kind))
    bench.axis.configure()
    bench.simulated.inject("refuse_enable", "drive")
    bench.axis.arm()
    for _ in range(100):
        assert not cycle(bench).enabled
    assert not bench.simulated.drive.powered


@pytest.mark.parametrize(
    ("kind", "given", "changed", "message"),
    [
        # The host's id has bits 15 to 8 of a request's, and a CyberGear's torque ends at 12 Nm.
        ("robstride", "host_id: 0xFD", "host_id: 0x1FD", "host_id must be at most 255"),
        ("robstride", "torque_max_Nm: 17", "torque_max_Nm: 18", "torque_max_Nm up to 17"),
        ("robstride", "motor: robstride02", "motor: cybergear", "torque_max_Nm up to 12"),
        ("damiao", "host_id: 0x11", "host_id: 0x01", "must not be motor_id"),
    ],
)
def test_what_a_motor_in_mit_mode_cannot_take_is_refused(kind, given, changed, message, tmp_path):
    text = (RIGS / f"simulated_{kind}.yaml").read_text()
    assert given in text
    (tmp_path / "rig.yaml").write_text(text.replace(given, changed))
    with pytest.raises(ConfigError, match=message):
        load_rig(tmp_path / "rig.yaml", registry.AXIS_SCHEMAS)


@pytest.mark.parametrize("kind", DRIVES)
def test_doctor_finds_a_healthy_drive_healthy_and_a_silent_one_not(kind):
    def findings(*faults):
        bench = FramedBench(at_1_khz(kind))
        bench.axis.configure()
        for fault in faults:
            bench.simulated.inject(fault, "drive")

        def wait():
            bench.now += MS

        return examine_axis(bench.axis, wait, 150, configure=False)

    healthy = findings()
    assert worst(healthy) == "ok"
    assert any(one.where == "drive" and "of 150 frames are bad" in one.what for one in healthy)
    assert any("DEVICE_LOST" in one.what for one in findings("mute"))
    # Of a packet on a line its length and checksum say that a byte is missing.
    refused = "bad checksum" if kind in ON_LINES else "wrong length"
    assert any(refused in one.what for one in findings("wrong_length"))


def drive_alone(folder, force="  force: from drive\n"):
    """The file of an ODrive that is the whole rig: its encoder and its torque alone."""
    text = (RIGS / "simulated_odrive.yaml").read_text()
    drive = text[text.index("      driver: odrive") : text.index("    sensor:")]
    file = folder / "rig.yaml"
    head = text[: text.index("axis:\n")].replace(
        "[position_comparison]", "[position_comparison, force_comparison]"
    )
    lines = textwrap.indent(textwrap.dedent(drive), "  ")
    file.write_text(f"{head}axis:\n{lines}{force}")
    return load_rig(file, registry.AXIS_SCHEMAS)


def test_without_a_force_sensor_the_motor_s_torque_is_the_force(tmp_path):
    rig = drive_alone(tmp_path)
    bench = FramedBench(rig, plant=plant_config(environment={"surface": 0.002}))
    bench.axis.configure()
    bench.axis.arm()
    for _ in range(60):
        bench.cycle(0.0)
    for k in range(400):
        sample = bench.cycle(min(5e-5 * k, 0.008))
    assert sample.valid
    assert sample.force == pytest.approx(bench.simulated.plant.force, abs=0.1)
    assert sample.force > 20.0
    assert sample.drive_force is None, "nothing is compared with itself"
    assert set(rig.axis.unsafe()) == {"position_comparison", "force_comparison"}


def test_a_drive_alone_without_a_force_is_refused(tmp_path):
    rig = drive_alone(tmp_path, force="")
    (found,) = (one for one in check_rig(rig) if one.severity == "error")
    assert "alone needs `position: from drive` and `force: from drive`" in found.what
