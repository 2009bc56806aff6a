from __future__ import annotations

import can
import numpy as np
import pytest
from framed_bench import KINDS, QUIET, FramedBench, edited, load
from rig_bench import MS, path, plant_config

from teleop_rt.axis import AxisError, AxisFault
from teleop_rt.signals import TRUTH, columns
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.framed.first_frames import nothing_good

COLUMN = columns(TRUTH)
FRAMED = ("serial", "raw_can")


@pytest.mark.parametrize("kind", KINDS)
def test_each_sample_is_the_truth_at_its_stamp(kind):
    bench = FramedBench(load(kind), plant=plant_config(sensors=QUIET)).armed()
    errors, truths, most = [], {}, 0.0
    for k in range(500):
        sample = bench.cycle(path(k))
        row = bench.simulated.truth_row
        truths[int(row[COLUMN["stamp_ns"]])] = row.copy()
        if k < 2:
            continue
        assert sample.valid
        position = truths[sample.position_stamp_ns][COLUMN["position"]]
        force = truths[sample.force_stamp_ns][COLUMN["force"]]
        errors.append((abs(sample.position - position), abs(sample.force - force)))
        most = max(most, sample.force)
    worst_position, worst_force = np.max(errors, axis=0)
    assert worst_position <= 2.5e-6 + 1e-12
    assert worst_force <= 0.5e-3 + 1e-5
    assert most > 30.0


@pytest.mark.parametrize("kind", KINDS)
def test_sign_and_offset_of_force_and_position_reach_the_sample(kind, tmp_path):
    changes = {
        "serial": (
            ("field: fz  ", "sign: -1\n    offset_N: 1.5\n    field: fz  "),
            ("field: count", "sign: -1\n    offset_m: 0.002\n    field: count"),
        ),
        "raw_can": (
            ("field: FORCE,", "field: FORCE, sign: -1, offset_N: 1.5,"),
            ("field: POSITION", "field: POSITION, sign: -1, offset_m: 0.002"),
        ),
        "mixed": (
            ("field: fz", "sign: -1\n        offset_N: 1.5\n        field: fz"),
            ('alarms: "0x6503"', 'alarms: "0x6503"\n        sign: -1\n        offset_m: 0.002'),
        ),
    }[kind]
    plant = plant_config(sensors=QUIET, start=0.012)
    bench = FramedBench(edited(kind, tmp_path, *changes), plant=plant)
    bench.axis.configure()
    sample = bench.cycles(4)
    assert sample.position == pytest.approx(0.002 - bench.simulated.plant.position, abs=2e-5)
    assert bench.simulated.plant.force > 5.0
    assert sample.force == pytest.approx(1.5 - bench.simulated.plant.force, abs=0.05)


@pytest.mark.parametrize("kind", KINDS)
def test_enabling_does_not_jump_whatever_is_commanded(kind):
    bench = FramedBench(load(kind), plant=plant_config(start=0.004))
    bench.axis.configure()
    bench.axis.arm()
    for _ in range(30):
        if bench.cycle(0.05).enabled:
            break
        assert abs(bench.simulated.plant.reference - 0.004) < 2e-6
    assert bench.sample.enabled


@pytest.mark.parametrize("kind", KINDS)
def test_stop_acts_at_once_and_lasts_until_armed_again(kind):
    bench = FramedBench(load(kind)).armed()
    for k in range(60):
        bench.cycle(path(k))
    bench.axis.stop()
    assert not bench.simulated.drive.enabled
    bench.cycles(200, 0.01)
    assert not bench.simulated.drive.powered
    bench.axis.arm()
    assert bench.cycles(20).enabled


@pytest.mark.parametrize("kind", KINDS)
def test_the_drive_stops_by_itself_when_the_daemon_falls_silent(kind):
    bench = FramedBench(load(kind)).armed()
    for k in range(80):
        bench.cycle(path(k))
    bench.silence(45)
    assert bench.simulated.drive.enabled
    bench.silence(100)
    assert not bench.simulated.drive.powered


SPOILED = {
    "mute": AxisFault.DEVICE_LOST,
    "freeze": AxisFault.DEVICE_LOST,
    "wrong_length": AxisFault.DEVICE_LOST,
    "corrupt": AxisFault.DEVICE_LOST,
}


@pytest.mark.parametrize("kind", FRAMED)
@pytest.mark.parametrize("device", ["encoder", "force sensor", "drive"])
@pytest.mark.parametrize("fault", SPOILED)
def test_a_device_without_good_frames_is_missing_at_once_and_lost_after_its_timeout(
    kind, device, fault
):
    bench = FramedBench(load(kind)).armed()
    position = bench.sample.position
    bench.simulated.inject(fault, device)
    sample = bench.cycles(20)
    if device != "drive":
        assert sample.missing in (19, 20)
        assert not sample.valid
    assert sample.fault is AxisFault.NONE
    assert sample.position == pytest.approx(position, abs=1e-5)
    assert bench.cycles(60).fault is SPOILED[fault]
    bench.axis.stop()
    bench.silence(200)
    assert not bench.simulated.drive.powered


@pytest.mark.parametrize(
    ("kind", "fault", "reason"),
    [
        ("serial", "corrupt", "bad_checksum"),
        ("raw_can", "corrupt", "bad_checksum"),
        ("raw_can", "wrong_length", "wrong_length"),
        ("raw_can", "freeze", "repeated"),
        ("serial", "duplicate", "repeated"),
        ("raw_can", "duplicate", "repeated"),
        ("serial", "garbage", "skipped_bytes"),
        ("raw_can", "garbage", "wrong_length"),
    ],
)
def test_bad_frames_are_counted_by_reason(kind, fault, reason):
    bench = FramedBench(load(kind)).armed()
    assert bench.axis.counters[reason] == 0
    bench.simulated.inject(fault, "encoder")
    bench.cycles(12)
    assert bench.axis.counters[reason] >= 8


@pytest.mark.parametrize("kind", FRAMED)
@pytest.mark.parametrize("fault", ["garbage", "duplicate"])
def test_good_frames_between_bad_ones_are_used(kind, fault):
    bench = FramedBench(load(kind)).armed()
    bench.simulated.inject(fault, "encoder")
    valid = [bench.cycle(path(k)).valid for k in range(50)]
    assert sum(valid) >= 45
    assert bench.sample.position == pytest.approx(bench.simulated.plant.position, abs=5e-6)


@pytest.mark.parametrize("kind", ["serial", "mixed"])
def test_a_pulled_cable_is_named_within_a_cycle_and_never_raises(kind):
    bench = FramedBench(load(kind)).armed()
    bench.simulated.inject("unplug", "force sensor")
    assert bench.cycle().fault is AxisFault.UNPLUGGED
    bench.cycles(10)
    assert not bench.sample.valid
    bench.axis.stop()
    with pytest.raises(AxisError, match="UNPLUGGED"):
        bench.axis.arm()
    bench.axis.close()


def test_raw_can_frames_that_nobody_acknowledges_are_dropped_and_move_nothing_later():
    bench = FramedBench(load("raw_can")).armed()
    bench.simulated.inject("no_acknowledge", "drive")
    bench.cycles(20, 0.01)
    assert bench.sample.fault is AxisFault.NOT_ACKNOWLEDGED
    heard = []
    devices = bench.ends.bus_pair("")[1]
    hear = devices.deliver
    devices.deliver = lambda message: (heard.append(message), hear(message))
    bench.simulated.heal("drive")
    bench.axis.write(0.01)
    assert heard == []
    assert bench.simulated.plant.reference == pytest.approx(0.0, abs=1e-6)


def test_bus_off_and_a_foreign_commander_are_faults_of_raw_can():
    bench = FramedBench(load("raw_can")).armed()
    bench.simulated.inject("bus_off")
    assert bench.cycle().fault is AxisFault.BUS_OFF
    bench = FramedBench(load("raw_can")).armed()
    bench.ends.bus_pair("")[0].deliver(
        can.Message(arbitration_id=0x103, is_extended_id=False, data=bytes(8))
    )
    assert bench.cycle().fault is AxisFault.FOREIGN_MASTER


@pytest.mark.parametrize("kind", FRAMED)
def test_a_drive_that_resets_or_fails_is_a_drive_fault_and_stays_off(kind):
    bench = FramedBench(load(kind)).armed()
    bench.simulated.inject("reset", "drive")
    bench.cycles(3)
    assert bench.sample.fault is AxisFault.DRIVE_FAULT
    bench.cycles(50)
    assert not bench.simulated.drive.powered
    bench = FramedBench(load(kind)).armed()
    bench.simulated.drive.servo.fail()
    bench.cycles(3)
    assert bench.sample.fault is AxisFault.DRIVE_FAULT


def test_a_reset_drive_of_a_mixed_rig_is_found_by_its_canopen_part():
    bench = FramedBench(load("mixed")).armed()
    bench.simulated.inject("reset", "drive")
    assert bench.cycles(6).fault is AxisFault.DEVICE_LOST


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_samples_and_another_seed_others(kind):
    def run(seed):
        bench = FramedBench(load(kind), seed=seed).armed()
        return [(bench.cycle(path(k)).position, bench.sample.force) for k in range(200)]

    first = run(3)
    assert first == run(3)
    assert first != run(4)


def test_the_devices_time_is_mapped_on_ours():
    bench = FramedBench(load("serial")).armed()
    bench.cycles(1500)
    assert abs(bench.sample.device_stamp_ns - bench.sample.stamp_ns) < 20_000
    clock = bench.axis._position._clock  # a sample has the mapped time, and not the drift
    assert clock.drift_ppm == pytest.approx(-40.0, abs=2.0)


def test_frames_that_are_wrong_are_counted_in_words_with_their_likely_cause():
    counted = FramedCounters()
    assert nothing_good(["cell"], 500, counted) == (
        "no good frame of cell within 500 ms, but not a byte; check power, wiring and the device's"
        " own settings, and the device that the rig names"
    )
    counted["skipped_bytes"] = 40
    assert "40 bytes in which no frame was found; check baud" in nothing_good(["cell"], 9, counted)
    counted["bad_checksum"], counted["bad_end"] = 471, 2
    said = nothing_good(["zorg", "zorg", "drive"], 500, counted)
    assert "of zorg and drive within 500 ms, but 471 with a wrong checksum, 2 with other" in said
    assert "check the checksum's kind and span" in said
    counted["out_of_range"] = 500
    assert "a force beyond 3 times limits.force_max" in nothing_good(["cell"], 9, counted)


@pytest.mark.parametrize("kind", FRAMED)
def test_silent_devices_are_named_when_configuring(kind):
    bench = FramedBench(load(kind))
    bench.simulated.inject("mute", "force sensor")
    with pytest.raises(AxisError, match=r"no good frame of (wrench|FORCE) within"):
        bench.axis.configure()


@pytest.mark.parametrize(
    ("kind", "change", "said"),
    [
        ("serial", ("field: fz", "field: fq"), "wrench has no field 'fq'; it has: status, fx"),
        ("serial", ("format: wrench_crc16", "format: wrench"), "one of: wrench_crc16, counts"),
        (
            "serial",
            ("    scale_m_per_unit: 5.0e-6", "    timeout_ms: 60"),
            "field count is in 'count', the rig in 'm': write position.scale_m_per_unit",
        ),
        ("raw_can", ("dbc: simulated_rig.dbc", "dbc: none.dbc"), "'none.dbc' is neither a file"),
        ("raw_can", ("source: FORCE,", "source: FORCES,"), "has no message 'FORCES'; it has:"),
        ("raw_can", ("field: STATUS", "field: STATE"), "FORCE has no field 'STATE'"),
        ("raw_can", ("signal: CHECK,", "signal: COUNTER,"), "must be one whole byte"),
    ],
)
def test_a_description_that_does_not_fit_is_refused_before_arming(kind, change, said, tmp_path):
    with pytest.raises(AxisError, match=said):
        FramedBench(edited(kind, tmp_path, change))


def test_each_sensor_format_gives_the_true_force(tmp_path):
    plant = plant_config(sensors=QUIET, start=0.012)
    for name, field, extra, tolerance in (
        ("counts_55aa", "fz", "", 0.006),
        ("converter_24bit", "force", "", 0.002),
        ("load_cell_text", "mass", "scale_N_per_unit: 9.80665", 0.0006),
    ):
        rig = edited(
            "serial",
            tmp_path,
            ("format: wrench_crc16", f"format: {name}"),
            ("field: fz  ", f"field: {field}\n    {extra}\n    #"),
            ("    status: {field: status, good: 0}\n    clock: {field: stamp, tick_s: 1.0e-6}", ""),
        )
        bench = FramedBench(rig, plant=plant)
        bench.axis.configure()
        sample = bench.cycle()
        assert sample.valid
        assert bench.simulated.plant.force > 5.0
        assert sample.force == pytest.approx(bench.simulated.plant.force, abs=tolerance)


def test_a_mass_needs_its_conversion_to_be_written_down(tmp_path):
    rig = edited(
        "serial",
        tmp_path,
        ("format: wrench_crc16", "format: load_cell_text"),
        ("field: fz  ", "field: mass\n    #"),
        ("    status: {field: status, good: 0}\n    clock: {field: stamp, tick_s: 1.0e-6}", ""),
    )
    with pytest.raises(AxisError, match=r"in 'kg', the rig in 'N': .*9.80665 N per kg"):
        FramedBench(rig)


def test_samples_are_one_cycle_apart_in_a_mixed_rig():
    bench = FramedBench(load("mixed")).armed()
    sample = bench.cycle()
    assert sample.force_stamp_ns - sample.position_stamp_ns == MS
    assert sample.stamp_ns == sample.position_stamp_ns


@pytest.mark.parametrize("kind", FRAMED)
def test_every_command_before_the_drive_follows_is_its_own_position(kind):
    bench = FramedBench(load(kind), plant=plant_config(start=0.004))
    servo = bench.simulated.drive.servo
    heard = []
    obey = servo.obey

    def tap(control, target, now_ns):
        heard.append((servo.enabled, control, target))
        obey(control, target, now_ns)

    servo.obey = tap
    bench.axis.configure()
    bench.cycles(20, 0.05)
    bench.axis.arm()
    bench.cycles(20, 0.05)
    before = [(control, target) for enabled, control, target in heard[1:] if not enabled]
    assert len(before) >= 20
    assert {control for control, _ in before} == {0, 1}
    assert all(abs(target - 4000) <= 1 for _, target in before)
