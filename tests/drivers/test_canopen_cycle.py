from __future__ import annotations

import hashlib
import struct

import can
import numpy as np
import pytest
from rig_bench import MS, START_NS, Bench, canopen_rig, changed, path, plant_config

from teleop_rt.axis import AxisError, AxisFault
from teleop_rt.signals import TRUTH, columns
from teleop_rt_drivers.canopen.sdo import BOOT_UP as HEARTBEAT
from teleop_rt_drivers.canopen.setup import PRE_OPERATIONAL, STOP_NODE
from teleop_rt_drivers.simulated.synchronous_bus import as_sent

COLUMN = columns(TRUTH)
FORCE_SENSOR = 0x20
"""Its node."""
DEVICES = ("encoder", "force sensor", "drive")


def follow(bench: Bench, count: int):
    """Follow the path; return stamps, samples, and the truth at each SYNC."""
    samples, truths = [], {}
    for k in range(count):
        sample = bench.cycle(path(k))
        truths[int(bench.simulated.truth_row[COLUMN["stamp_ns"]])] = (
            bench.simulated.truth_row.copy()
        )
        samples.append((sample.valid, sample.stamp_ns, sample.position, sample.force))
    return samples, truths


def test_each_sample_is_the_truth_at_its_sync_within_quantisation():
    bench = Bench(plant=plant_config(sensors={"force_noise": 0.0, "force_lag_jitter_us": 0.0}))
    samples, truths = follow(bench.armed(), 700)
    positions = [abs(p - truths[stamp][COLUMN["position"]]) for v, stamp, p, _ in samples[2:] if v]
    forces = [abs(f - truths[stamp - MS][COLUMN["force"]]) for v, stamp, _, f in samples[2:] if v]
    assert len(positions) == 698
    assert max(positions) <= 2.5e-6 + 1e-12
    assert max(forces) <= 0.5e-3 + 1e-9
    assert max(f for _, _, _, f in samples) > 30.0


def test_a_sample_is_one_cycle_old_and_stamped_with_its_sync():
    bench = Bench()
    bench.axis.configure()
    bench.cycle()
    sent = bench.now
    bench.cycle()
    assert not bench.sample.valid or bench.sample.stamp_ns == START_NS
    bench.cycle()
    assert bench.sample.valid
    assert bench.sample.stamp_ns == bench.sample.position_stamp_ns == sent


def test_a_command_acts_at_the_next_sync():
    bench = Bench().armed()
    bench.axis.write(0.001)
    before = bench.simulated.plant.reference
    assert before == pytest.approx(0.0)
    bench.cycle(0.001)
    bench.cycle(0.001)
    assert bench.simulated.plant.reference == pytest.approx(0.001)


def test_enabling_does_not_jump_whatever_is_commanded():
    bench = Bench(plant=plant_config(start=0.004))
    bench.axis.configure()
    bench.axis.arm()
    while not bench.cycle(0.05).enabled:
        assert abs(bench.simulated.plant.position - 0.004) < 2e-6
        assert abs(bench.simulated.plant.reference - 0.004) < 2e-6


def test_the_sign_and_offset_of_the_rig_reach_sample_and_command():
    rig = changed(
        canopen_rig(),
        encoder={"sign": -1, "offset": 0.002},
        drive={"sign": -1, "offset": 0.002},
        force={"sign": -1},
    )
    bench = Bench(axis_rig=rig, plant=plant_config(sensors={"force_noise": 0.0}))
    bench.axis.configure()
    bench.axis.arm()
    bench.cycles(12, 0.002)
    for k in range(200):
        bench.cycle(0.002 - k * 1e-4)
    bench.cycles(50, -0.018)
    assert bench.sample.position == pytest.approx(-0.018, abs=3e-4)
    assert bench.simulated.plant.position == pytest.approx(0.02, abs=3e-4)
    assert bench.sample.force == pytest.approx(-36.0, abs=1.0)


def frames_hash(seed: int) -> str:
    bench = Bench(seed=seed)
    digest = hashlib.sha256()

    def tap(end, direction):
        deliver = end.deliver

        def heard(message):
            can_id, data = as_sent(message)
            digest.update(struct.pack("<BQHB", direction, bench.now, can_id, len(data)))
            digest.update(data)
            deliver(message)

        end.deliver = heard

    tap(bench.daemon_end, 0)
    tap(bench.device_end, 1)
    bench.armed()
    follow(bench, 300)
    bench.axis.close()
    return digest.hexdigest()


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others():
    assert frames_hash(7) == frames_hash(7)
    assert frames_hash(7) != frames_hash(8)


def test_a_muted_device_counts_up_missing_and_is_lost_after_its_heartbeat_timeout():
    bench = Bench().armed()
    last = bench.cycle().position
    bench.simulated.inject("mute", "force sensor")
    bench.cycle()
    missing = []
    for _ in range(85):
        sample = bench.cycle()
        missing.append(sample.missing)
        if sample.fault is not AxisFault.NONE:
            break
    assert missing == list(range(1, len(missing) + 1))
    assert not sample.valid
    assert sample.position == last
    assert sample.fault is AxisFault.DEVICE_LOST
    assert 40 <= len(missing) <= 62


@pytest.mark.parametrize("data", [b"", b"\x05\x05", b"\x05" * 8])
def test_a_heartbeat_of_a_wrong_length_is_counted_and_is_no_sign_of_life(data):
    muted, answered = Bench().armed(), Bench().armed()
    lost = []
    for bench in (muted, answered):
        bench.simulated.inject("mute", "force sensor")
        cycles = 0
        while bench.cycle().fault is AxisFault.NONE and cycles < 85:
            cycles += 1
            if bench is answered:
                bench.daemon_end.deliver(frame(HEARTBEAT + FORCE_SENSOR, data))
        lost.append((cycles, bench.sample.fault))
    assert lost[0] == lost[1]
    assert lost[1][1] is AxisFault.DEVICE_LOST
    assert answered.axis.counters["wrong_length"] == lost[1][0]
    assert muted.axis.counters["wrong_length"] == 0


def test_a_heartbeat_of_the_right_length_is_a_sign_of_life():
    bench = Bench().armed()
    bench.simulated.inject("mute", "force sensor")
    for _ in range(85):
        bench.daemon_end.deliver(frame(HEARTBEAT + FORCE_SENSOR, b"\x05"))
        assert bench.cycle().fault is AxisFault.NONE
    assert bench.axis.counters["wrong_length"] == 0


def test_a_device_that_comes_back_is_valid_again_within_four_cycles():
    bench = Bench().armed()
    bench.simulated.inject("mute", "encoder")
    bench.cycles(6)
    bench.simulated.heal("encoder")
    bench.cycles(4)
    assert bench.sample.valid
    assert bench.sample.missing == 0


def test_a_wrong_length_is_counted_and_the_value_kept():
    bench = Bench().armed()
    position = bench.cycle().position
    bench.simulated.inject("wrong_length", "encoder")
    bench.cycles(5)
    assert bench.axis.counters["wrong_length"] == 4
    assert bench.sample.rejected == 4
    assert bench.sample.position == position
    assert not bench.sample.valid


def faulty(name, device="force sensor") -> Bench:
    bench = Bench().armed()
    bench.simulated.inject(name, device)
    bench.cycles(6)
    return bench


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("reset", AxisFault.DEVICE_LOST),
        ("emergency", AxisFault.EMERGENCY),
        ("bus_off", AxisFault.BUS_OFF),
        ("duplicate", AxisFault.DUPLICATE_NODE),
    ],
)
@pytest.mark.parametrize("device", DEVICES)
def test_a_fault_is_named_within_a_few_cycles(name, fault, device):
    assert faulty(name, device).sample.fault is fault


@pytest.mark.parametrize("cob_id", [0x000, 0x080, 0x77F, 0x230])
def test_frames_of_another_master_are_a_fault(cob_id):
    bench = Bench().armed()
    bench.daemon_end.deliver(can.Message(arbitration_id=cob_id, is_extended_id=False, data=b""))
    assert bench.cycle().fault is AxisFault.FOREIGN_MASTER


def test_an_error_passive_controller_is_a_fault_and_a_warning_is_not():
    bench = Bench().armed()
    for status, fault in ((0x0C, AxisFault.NONE), (0x10, AxisFault.ERROR_PASSIVE)):
        frame = can.Message(
            arbitration_id=0x004,
            is_extended_id=False,
            is_error_frame=True,
            data=bytes((0, status, 0, 0, 0, 0, 0, 0)),
        )
        bench.daemon_end.deliver(frame)
        assert bench.cycle().fault is fault
    assert bench.axis.counters["error_frame"] == 2


def test_a_drive_that_reports_fault_is_a_drive_fault_and_not_enabled():
    bench = Bench().armed()
    bench.simulated.inject("mute", "drive")
    bench.cycle()
    bench.daemon_end.deliver(frame(0x1B0, struct.pack("<Hhi", 0x0208, 0, 0)))
    sample = bench.cycle()
    assert sample.fault is AxisFault.DRIVE_FAULT
    assert not sample.enabled


def test_a_drive_that_goes_off_by_itself_is_a_fault_and_stays_off():
    bench = Bench().armed()
    bench.simulated.drive._enter_power(type(bench.simulated.drive._power).SWITCH_ON_DISABLED)
    bench.cycles(30)
    assert bench.sample.fault is AxisFault.DRIVE_FAULT
    assert not bench.simulated.drive.powered


def test_a_fault_is_latched_and_forbids_arming_until_configured_again():
    bench = faulty("emergency")
    bench.axis.stop()
    bench.cycles(100)
    with pytest.raises(AxisError, match="EMERGENCY"):
        bench.axis.arm()
    bench.axis.configure()
    bench.axis.arm()
    assert bench.cycles(12).enabled


def frame(cob_id: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=cob_id, is_extended_id=False, data=data)


def instead_of_the_encoder(data: bytes) -> Bench:
    """The encoder's next answer is replaced by these bytes."""
    bench = Bench().armed()
    bench.simulated.inject("mute", "encoder")
    bench.cycle()
    bench.daemon_end.deliver(frame(0x290, data))
    bench.cycle()
    return bench


def test_a_plausible_frame_in_the_encoders_place_is_taken():
    bench = instead_of_the_encoder(struct.pack("<ihH", 100, 0, 0))
    assert bench.sample.position == pytest.approx(100 * 5e-6)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (struct.pack("<ihH", 2000, 0, 0), "impossible_jump"),
        (struct.pack("<ihH", 2**31 - 1, 0, 0), "out_of_range"),
        (struct.pack("<ihH", 0, 0, 1), "bad_status"),
        (struct.pack("<ih", 0, 0), "wrong_length"),
    ],
)
def test_a_frame_that_cannot_be_true_is_rejected_by_reason(data, reason):
    bench = instead_of_the_encoder(data)
    assert bench.axis.counters[reason] == 1
    assert not bench.sample.valid
    assert bench.sample.position == 0.0


def test_a_force_that_is_not_a_number_is_rejected():
    rig = canopen_rig()
    tpdo = rig.axis.force.tpdo.model_copy(update={"objects": ("0x6130:1", "0x6150:1")})
    bench = Bench(axis_rig=changed(rig, force={"tpdo": tpdo, "force": "0x6130:1", "scale": 1.0}))
    bench.armed()
    assert bench.cycle().valid
    force = bench.sample.force
    bench.simulated.inject("mute", "force sensor")
    bench.cycle()
    bench.daemon_end.deliver(frame(0x1A0, struct.pack("<fB", np.nan, 0)))
    force = bench.sample.force
    bench.cycle()
    assert bench.axis.counters["not_a_number"] == 1
    assert bench.sample.force == force


def test_a_flood_of_foreign_frames_is_bounded_per_cycle_and_counted():
    bench = Bench().armed()
    for _ in range(1000):
        bench.daemon_end.deliver(frame(0x555, b"abc"))
    bench.cycle()
    assert bench.axis.counters["flood"] == 1
    assert bench.axis.counters["unexpected_id"] <= 256
    bench.cycles(6)
    assert bench.axis.counters["unexpected_id"] == 1000
    assert bench.cycles(3).valid


def test_the_drive_stops_by_itself_when_the_daemon_falls_silent():
    bench = Bench().armed()
    follow(bench, 80)
    assert abs(bench.simulated.plant.velocity) > 0.1
    bench.silence(45)
    assert bench.simulated.drive.enabled
    bench.silence(20)
    assert not bench.simulated.drive.enabled
    bench.silence(60)
    assert not bench.simulated.drive.powered
    assert abs(bench.simulated.plant.velocity) < 1e-3


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    "fault",
    [
        "mute",
        "freeze",
        "wrong_length",
        "corrupt",
        "duplicate",
        "delay",
        "reset",
        "emergency",
        "bus_off",
    ],
)
def test_after_any_fault_and_stop_the_drive_is_not_enabled(fault, device):
    bench = Bench().armed()
    follow(bench, 60)
    bench.simulated.inject(fault, device)
    bench.cycles(5, path(64))
    bench.axis.stop()
    bench.silence(200)
    assert not bench.simulated.drive.enabled
    assert not bench.simulated.drive.powered


def test_stop_acts_at_once_without_waiting_for_a_cycle():
    bench = Bench().armed()
    follow(bench, 60)
    bench.axis.stop()
    assert not bench.simulated.drive.enabled


def test_a_stopped_drive_ignores_commands_until_it_is_armed_again():
    bench = Bench().armed()
    bench.axis.stop()
    bench.cycles(100, 0.01)
    assert not bench.simulated.drive.powered
    assert bench.simulated.plant.position == pytest.approx(0.0, abs=1e-6)
    bench.axis.arm()
    assert bench.cycles(12, 0.0).enabled


def test_stop_and_close_never_raise_on_a_dead_bus():
    bench = Bench().armed()

    def broken(*_):
        raise can.CanOperationError("no buffer space")

    bench.daemon_end.transmit = broken
    bench.axis.stop()
    bench.cycles(5)
    assert bench.sample.fault is AxisFault.UNPLUGGED
    assert bench.axis.counters["send_failed"] > 3
    bench.axis.close()


def test_close_takes_the_nodes_out_of_operation():
    bench = Bench().armed()
    result = []
    drive = bench.simulated.devices["drive"]
    obey = drive.receive_nmt
    drive.receive_nmt = lambda command: (result.append(command), obey(command))
    bench.axis.close()
    assert result == [STOP_NODE, PRE_OPERATIONAL]
    states = {device.state.name for device in bench.simulated.devices.values()}
    assert states == {"PRE_OPERATIONAL"}
    assert not bench.simulated.drive.enabled


def test_a_speed_beyond_the_encoders_range_is_counted_not_used():
    bench = Bench().armed()
    follow(bench, 120)
    assert bench.axis.counters["speed_saturated"] == 0
    for k in range(40):
        bench.cycle(path(120) - 5e-4 * k)
    assert bench.axis.counters["speed_saturated"] > 5
