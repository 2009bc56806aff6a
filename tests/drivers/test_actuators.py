"""Drives with protocols of their makers: trial, faults, watchdog, alike for all."""

from __future__ import annotations

import random
import textwrap

import can
import pytest
from framed_bench import RIGS, FramedBench, load
from rig_bench import MS, plant_config
from test_trial_on_every_rig import TRIAL, kelvin_voigt, open_bench

from teleop_rt.axis import AxisError, AxisFault
from teleop_rt.config_loader import load_rig, load_trial
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt.yaml_file import ConfigError
from teleop_rt_drivers import registry
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.doctor import examine_axis
from teleop_rt_drivers.findings import worst
from teleop_rt_drivers.quantity import plausible_position
from teleop_rt_drivers.simulated.reference import environment_force
from teleop_rt_drivers.simulated.synchronous_bus import as_sent

ON_CAN = ("odrive", "damiao", "robstride", "moteus", "vesc")
ON_LINES = ("dynamixel", "feetech")
DRIVES = ON_CAN + ON_LINES
WATCHDOG_MS = 50


def at_1_khz(kind: str):
    """The preset's rig, in cycles of a millisecond also where an adapter would not allow it."""
    return load(kind).model_copy(update={"rate_hz": 1000.0})


def armed(kind: str) -> FramedBench:
    bench = FramedBench(at_1_khz(kind), plant=plant_config(start=0.0))
    bench.axis.configure()
    bench.axis.arm()
    for _ in range(60):
        cycle(bench)
    assert bench.sample.enabled
    return bench


def cycle(bench: FramedBench, position: float = 0.0):
    return bench.cycle(position)


def until(bench: FramedBench, done, most: int) -> int:
    """Run cycles until something holds; return how many it took."""
    for count in range(1, most + 1):
        cycle(bench)
        if done(bench.sample):
            return count
    raise AssertionError(f"not within {most} ms: {bench.sample}")


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
def test_a_silent_drive_is_lost_and_named(kind):
    bench = armed(kind)
    bench.simulated.inject("mute", "drive")
    held = until(bench, lambda sample: not sample.valid, 5)
    assert held <= 3
    assert "position from drive" in bench.sample.stale
    took = until(bench, lambda sample: sample.fault is not AxisFault.NONE, 70)
    assert bench.sample.fault is AxisFault.DEVICE_LOST
    assert took + held <= 62
    assert "silent for more than 60 ms" in bench.sample.complaint


@pytest.mark.parametrize("fault", ["wrong_id", "wrong_length"])
@pytest.mark.parametrize("kind", DRIVES)
def test_frames_of_another_id_or_half_a_frame_are_counted_and_the_drive_is_lost(kind, fault):
    bench = armed(kind)
    bench.simulated.inject(fault, "drive")
    until(bench, lambda sample: sample.fault is not AxisFault.NONE, 70)
    assert bench.sample.fault in {AxisFault.DEVICE_LOST, AxisFault.DRIVE_FAULT}
    assert bench.sample.rejected > 0


@pytest.mark.parametrize("kind", DRIVES)
def test_swapped_bytes_are_no_position_that_moves_impossibly(kind):
    bench = armed(kind)
    for k in range(100):
        cycle(bench, 4e-5 * k)
    bench.simulated.inject("swapped_bytes", "drive")
    for _ in range(80):
        sample = cycle(bench, 4e-3)
        if sample.valid and sample.fault is AxisFault.NONE:
            assert sample.position == pytest.approx(bench.simulated.plant.position, abs=2e-3)


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


@pytest.mark.parametrize("kind", ON_CAN)
def test_bus_off_is_found_in_two_cycles(kind):
    bench = armed(kind)
    bench.simulated.inject("bus_off", "drive")
    until(bench, lambda sample: sample.fault is AxisFault.BUS_OFF, 2)


@pytest.mark.parametrize("kind", ON_LINES)
def test_a_pulled_cable_is_found_in_two_cycles(kind):
    bench = armed(kind)
    bench.simulated.inject("unplug", "drive")
    until(bench, lambda sample: sample.fault is AxisFault.UNPLUGGED, 2)


@pytest.mark.parametrize("kind", ON_CAN)
def test_without_the_daemon_the_motor_loses_its_voltage_within_the_watchdog(kind):
    bench = armed(kind)
    assert bench.simulated.drive.powered
    bench.silence(WATCHDOG_MS - 10)
    assert bench.simulated.drive.powered, "fed until now"
    bench.silence(20)
    assert not bench.simulated.drive.powered
    until(bench, lambda sample: sample.fault is not AxisFault.NONE, 40)
    assert bench.sample.fault in {AxisFault.DRIVE_FAULT, AxisFault.DEVICE_LOST}
    for _ in range(50):
        assert not cycle(bench).enabled
        assert not bench.simulated.drive.powered, "nobody gives it power again by himself"


@pytest.mark.parametrize("kind", DRIVES)
def test_a_stop_brings_a_moving_axis_to_rest_and_takes_the_voltage(kind):
    bench = armed(kind)
    for k in range(100):
        cycle(bench, 1e-4 * k)
    at = bench.simulated.plant.position
    bench.axis.stop()
    for _ in range(150):
        bench.now += MS
        bench.axis.read_into(bench.sample)
        bench.axis.stop()
    assert not bench.simulated.drive.powered
    assert bench.simulated.plant.position - at < 4e-3


@pytest.mark.parametrize("kind", DRIVES)
def test_an_axis_that_is_closed_while_it_moves_leaves_the_drive_without_voltage(kind):
    bench = armed(kind)
    for k in range(100):
        cycle(bench, 1e-4 * k)
    assert bench.simulated.drive.powered
    bench.axis.close()
    assert not bench.simulated.drive.powered


@pytest.mark.parametrize("kind", ON_CAN)
def test_a_second_master_is_found(kind):
    bench = armed(kind)
    sent: list[object] = []
    ours, drives = bench.ends.bus_pair("drive")
    deliver, drives.deliver = drives.deliver, sent.append
    cycle(bench)
    drives.deliver = deliver
    cycle(bench)
    ours.deliver(sent[-1])
    assert cycle(bench).fault is AxisFault.FOREIGN_MASTER


@pytest.mark.parametrize("kind", ON_CAN)
def test_mutated_frames_raise_nothing_and_every_valid_position_is_within_range_and_jump(kind):
    rng = random.Random(7)  # noqa: S311 - reproducible
    bounds = plausible_position(load(kind))
    compared = sum(attack(armed(kind), bounds, rng) for _ in range(10))
    assert compared > 60


def attack(bench, bounds, rng) -> int:
    """Send mutated frames until the axis is lost; return how many positions were compared."""
    daemon_end, seen = bench.ends.bus_pair("drive")[0], []
    deliver = daemon_end.deliver
    daemon_end.deliver = lambda frame: (seen.append(frame), deliver(frame))[1]
    cycle(bench)
    cycle(bench)
    last, stamp, compared = bench.sample.position, bench.sample.position_stamp_ns, 0
    for _ in range(200):
        deliver(mutated(rng.choice(seen[:20]), rng))
        sample = cycle(bench)
        if sample.position_stamp_ns > stamp:
            elapsed_s = (sample.position_stamp_ns - stamp) * 1e-9
            assert bounds.lower <= sample.position <= bounds.upper
            assert abs(sample.position - last) <= bounds.slack + bounds.rate * elapsed_s + 1e-12
            last, stamp, compared = sample.position, sample.position_stamp_ns, compared + 1
        if sample.fault is not AxisFault.NONE:
            break
    return compared


def mutated(frame: can.Message, rng: random.Random) -> can.Message:
    """The frame with bits of data or id flipped, or cut."""
    data, can_id = bytearray(frame.data), frame.arbitration_id
    for _ in range(rng.randint(1, 4)):
        if rng.random() < 0.2:
            can_id ^= 1 << rng.randrange(29 if frame.is_extended_id else 11)
        elif rng.random() < 0.2:
            data = data[: rng.randrange(len(data) + 1)]
        elif data:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    size = len(data)
    if frame.is_fd and size > 8:
        size = max(n for n in (8, 12, 16, 20, 24, 32, 48, 64) if n <= size)
    return can.Message(
        arbitration_id=can_id,
        is_extended_id=frame.is_extended_id,
        is_fd=frame.is_fd,
        data=bytes(data[:size]),
    )


@pytest.mark.parametrize("kind", DRIVES)
def test_a_stop_takes_the_voltage_in_time_though_the_drive_says_that_it_moves(kind):
    bench = armed(kind)
    for k in range(100):
        cycle(bench, 1e-4 * k)
    bench.simulated.inject("freeze", "drive")
    for _ in range(30):
        bench.now += MS
        bench.axis.read_into(bench.sample)
        bench.axis.stop()
    for _ in range(90):
        bench.now += MS
        bench.axis.read_into(bench.sample)
        bench.axis.stop()
    assert not bench.simulated.drive.powered


def test_a_drive_that_has_failed_is_not_asked_again_to_take_power():
    bench = FramedBench(load("odrive"))
    bench.axis.configure()
    bench.simulated.inject("refuse_enable", "drive")
    drives = bench.ends.bus_pair("drive")[1]
    asked, deliver = [], drives.deliver
    drives.deliver = lambda frame: (asked.append(as_sent(frame)[0]), deliver(frame))[1]
    bench.axis.arm()
    until(bench, lambda sample: sample.fault is AxisFault.DRIVE_FAULT, 40)
    asked.clear()
    for _ in range(100):
        cycle(bench)
    assert 3 << 5 | 0x0C not in asked, "no position is commanded either"
    assert 3 << 5 | 0x0B not in asked
    # An ODrive clears this error at the next request, such as that to be idle.
    assert bench.sample.fault is AxisFault.DRIVE_FAULT
    assert "invalid state asked for" in bench.sample.complaint


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
