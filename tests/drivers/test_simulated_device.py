from __future__ import annotations

import struct

import can
import pytest
from rig_bench import MS, START_NS, canopen_rig, plant_config

from teleop_rt_drivers.opening import open_rig
from teleop_rt_drivers.simulated.device import Nmt
from teleop_rt_drivers.simulated.synchronous_bus import synchronous_pair

ENCODER, FORCE, DRIVE = 0x10, 0x20, 0x30
DECELERATION = 60.0  # m/s2, the default of 6085h in the drive's EDS


class Wire:
    """The devices seen as bytes: no axis, no canopen client."""

    def __init__(self, **plant) -> None:
        self.now = START_NS
        self.end, devices = synchronous_pair()
        self.rig = open_rig(canopen_rig(), plant_config(**plant), lambda: self.now, 1, bus=devices)
        devices.on_arrival = self.rig.process
        self.rig.power_on()

    def heard(self) -> list[tuple[int, bytes]]:
        frames = []
        while (message := self.end.recv(0)) is not None:
            frames.append((message.arbitration_id, bytes(message.data)))
        return frames

    def send(self, cob_id: int, data: bytes) -> list[tuple[int, bytes]]:
        self.heard()
        self.end.send(can.Message(arbitration_id=cob_id, is_extended_id=False, data=data))
        return self.heard()

    def write(self, node: int, index: int, sub: int, value: int, size: int) -> bytes:
        command = 0x23 | (4 - size) << 2
        request = struct.pack("<BHBi", command, index, sub, value) if value < 2**31 else b""
        request = request or struct.pack("<BHBI", command, index, sub, value)
        return self.send(0x600 + node, request)[-1][1]

    def read(self, node: int, index: int, sub: int = 0) -> int:
        answer = self.send(0x600 + node, struct.pack("<BHB4x", 0x40, index, sub))[-1][1]
        assert answer[0] & 0xE0 == 0x40
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little")

    def start(self, node: int) -> None:
        self.send(0x000, bytes((0x01, node)))

    def sync(self) -> list[tuple[int, bytes]]:
        return self.send(0x080, b"")

    def wait(self, milliseconds: int) -> list[tuple[int, bytes]]:
        self.heard()
        for _ in range(milliseconds):
            self.now += MS
            self.rig.process()
        return self.heard()


def test_power_on_is_reported_by_a_boot_up_message_of_each_node():
    assert Wire().heard() == [(0x710, b"\0"), (0x720, b"\0"), (0x730, b"\0")]


def test_identity_is_read_by_sdo():
    wire = Wire()
    assert wire.read(ENCODER, 0x1018, 1) == 0x543
    assert wire.read(DRIVE, 0x1018, 2) == 0x402


def test_a_name_longer_than_four_bytes_is_read_in_segments():
    wire = Wire()
    first = wire.send(0x600 + FORCE, struct.pack("<BHB4x", 0x40, 0x1008, 0))[-1][1]
    assert struct.unpack("<I", first[4:]) == (12,)
    parts = [
        wire.send(0x600 + FORCE, bytes((toggle,)) + bytes(7))[-1][1] for toggle in (0x60, 0x70)
    ]
    assert (parts[0][1:] + parts[1][1:])[:12] == b"Force sensor"


@pytest.mark.parametrize(
    ("index", "sub", "size", "code"),
    [
        (0x5555, 0, 4, 0x06020000),
        (0x1018, 9, 4, 0x06020000),
        (0x6004, 0, 4, 0x06010002),
        (0x1017, 0, 4, 0x06070010),
    ],
)
def test_a_wrong_write_is_aborted_with_the_standards_code(index, sub, size, code):
    answer = Wire().write(ENCODER, index, sub, 1, size)
    assert answer[0] == 0x80
    assert struct.unpack("<I", answer[4:]) == (code,)


def test_a_mapping_in_use_cannot_be_changed():
    answer = Wire().write(ENCODER, 0x1A01, 0, 0, 1)
    assert struct.unpack("<I", answer[4:]) == (0x08000022,)


def remap(wire: Wire, words: list[int], node: int = ENCODER) -> bytes:
    wire.write(node, 0x1801, 1, 0x80000290, 4)
    wire.write(node, 0x1A01, 0, 0, 1)
    answers = [wire.write(node, 0x1A01, k, word, 4) for k, word in enumerate(words, start=1)]
    answers.append(wire.write(node, 0x1A01, 0, len(words), 1))
    wire.write(node, 0x1801, 1, 0x290, 4)
    return next((answer for answer in answers if answer[0] == 0x80), b"")


def test_a_new_mapping_is_honoured():
    wire = Wire(start=0.001)
    assert remap(wire, [0x65030010, 0x60040020]) == b""
    wire.start(ENCODER)
    assert (0x290, struct.pack("<Hi", 0, 200)) in wire.sync()


def test_an_object_that_cannot_be_mapped_is_refused():
    assert struct.unpack("<I", remap(Wire(), [0x60020020])[4:]) == (0x06040041,)


def test_a_mapping_longer_than_a_frame_is_refused():
    answer = remap(Wire(), [0x60040020, 0x60040020, 0x65030010])
    assert struct.unpack("<I", answer[4:]) == (0x06040042,)


def test_process_data_is_sent_only_in_operational_and_only_at_sync():
    wire = Wire()
    assert wire.sync() == []
    wire.start(ENCODER)
    assert [cob for cob, _ in wire.sync()] == [0x290]
    assert wire.wait(10) == []
    wire.send(0x000, bytes((0x80, ENCODER)))
    assert wire.sync() == []


def test_a_transmission_type_of_three_answers_every_third_sync():
    wire = Wire()
    wire.write(ENCODER, 0x1801, 2, 3, 1)
    wire.start(ENCODER)
    assert [len(wire.sync()) for _ in range(6)] == [0, 0, 1, 0, 0, 1]


def test_nmt_to_node_zero_is_for_all():
    wire = Wire()
    wire.start(0)
    assert {device.state for device in wire.rig.devices.values()} == {Nmt.OPERATIONAL}


def test_a_stopped_node_answers_no_sdo():
    wire = Wire()
    wire.send(0x000, bytes((0x02, ENCODER)))
    assert wire.send(0x600 + ENCODER, struct.pack("<BHB4x", 0x40, 0x1018, 1)) == []


def test_a_reset_forgets_what_was_written_and_boots():
    wire = Wire()
    wire.write(ENCODER, 0x1017, 0, 20, 2)
    assert wire.send(0x000, bytes((0x81, ENCODER))) == [(0x710, b"\0")]
    assert wire.read(ENCODER, 0x1017) == 0


def test_the_heartbeat_comes_at_its_period_and_contains_the_state():
    wire = Wire()
    wire.write(FORCE, 0x1017, 0, 20, 2)
    assert wire.wait(60) == [(0x720, b"\x7f")] * 3
    wire.start(FORCE)
    assert set(wire.wait(60)) == {(0x720, b"\x05")}


def test_the_force_is_in_thousandths_and_the_position_in_steps():
    wire = Wire(
        start=0.02, sensors={"force_noise": 0.0, "force_lag_ms": 0.0, "force_lag_jitter_us": 0.0}
    )
    wire.start(0)
    frames = dict(wire.sync())
    assert struct.unpack("<iB", frames[0x1A0]) == (36_000, 0)
    assert struct.unpack("<ihH", frames[0x290]) == (4000, 0, 0)
    assert struct.unpack("<Hhi", frames[0x1B0])[2] == 20_000


def command(wire: Wire, control: int, target: int = 0) -> int:
    """Send the command frame and a SYNC; return the statusword."""
    wire.send(0x230, struct.pack("<Hhi", control, 0, target))
    frames = dict(wire.sync())
    wire.now += MS
    return int(struct.unpack("<Hhi", frames[0x1B0])[0])


def enabled(**plant) -> Wire:
    wire = Wire(**plant)
    wire.write(DRIVE, 0x6060, 0, 8, 1)
    wire.start(DRIVE)
    for control in (0x06, 0x07, 0x0F):
        command(wire, control)
    assert wire.rig.drive.enabled
    return wire


def test_the_drive_walks_its_states_by_controlword():
    wire = Wire()
    wire.start(DRIVE)
    words = [
        command(wire, control) & 0x6F for control in (0x00, 0x06, 0x07, 0x0F, 0x07, 0x06, 0x00)
    ]
    assert words == [0x40, 0x21, 0x23, 0x27, 0x23, 0x21, 0x40]


def test_the_drive_cannot_be_enabled_in_one_step():
    wire = Wire()
    wire.start(DRIVE)
    assert command(wire, 0x0F) & 0x6F == 0x40


def test_a_fault_is_left_only_by_a_rising_reset_bit():
    wire = enabled()
    wire.rig.drive.fail(0x8611)
    assert command(wire, 0x0F) & 0x4F == 0x08
    assert not wire.rig.drive.powered
    assert command(wire, 0x80) & 0x4F == 0x40
    wire.rig.drive.fail(0x8611)
    assert command(wire, 0x80) & 0x4F == 0x08


def test_quick_stop_slows_down_on_the_ramp_and_then_takes_the_power_away():
    wire = enabled(environment={"surface": 1.0})
    for k in range(50):
        command(wire, 0x0F, 500 * k)
    speed = wire.rig.plant.velocity
    assert speed == pytest.approx(0.5, rel=0.05)
    assert command(wire, 0x02) & 0x6F == 0x07
    assert wire.rig.drive.powered
    start = wire.rig.plant.reference
    wire.wait(60)
    assert not wire.rig.drive.powered
    assert wire.rig.plant.velocity == pytest.approx(0.0, abs=1e-3)
    assert wire.rig.plant.position - start == pytest.approx(speed**2 / (2 * DECELERATION), rel=0.1)


def test_targets_beyond_the_software_limits_are_not_followed():
    wire = enabled()
    wire.write(DRIVE, 0x607D, 2, 1000, 4)
    for k in range(60):
        command(wire, 0x0F, 100 * k)
    assert wire.rig.plant.reference == pytest.approx(0.001)


def test_a_jump_of_the_target_is_slowed_to_the_profile_velocity():
    wire = enabled()
    wire.write(DRIVE, 0x607F, 0, 200_000, 4)
    for _ in range(10):
        command(wire, 0x0F, 50_000)
    assert wire.rig.plant.reference == pytest.approx(0.2 * 0.009, rel=1e-6)


@pytest.mark.parametrize(
    ("option", "powered", "emergency"), [(0, True, False), (1, False, True), (2, False, False)]
)
def test_a_lost_daemon_stops_the_drive_as_6007h_says(option, powered, emergency):
    wire = enabled()
    wire.write(DRIVE, 0x6007, 0, option, 2)
    wire.write(DRIVE, 0x1016, 1, 127 << 16 | 60, 4)
    wire.write(DRIVE, 0x1029, 1, 1, 1)
    assert wire.wait(200) == []
    wire.send(0x77F, b"\x05")
    assert wire.wait(60) == []
    frames = wire.wait(5)
    codes = [struct.unpack_from("<H", data)[0] for cob, data in frames if cob == 0xB0]
    assert codes == [0x8130] * (2 if emergency else 1)
    assert wire.rig.drive.powered is powered


def test_a_short_command_frame_is_an_emergency_and_moves_nothing():
    wire = enabled()
    frames = wire.send(0x230, b"\x0f\x00\x00")
    assert frames[0][0] == 0xB0
    assert struct.unpack_from("<H", frames[0][1]) == (0x8210,)
    assert wire.rig.plant.reference == 0.0


def test_emergencies_are_kept_newest_first():
    wire = Wire()
    device = wire.rig.devices["encoder"]
    for code in (0x5000, 0x8130):
        device.emergency(code)
    assert [wire.read(ENCODER, 0x1003, sub) for sub in range(3)] == [2, 0x8130, 0x5000]
