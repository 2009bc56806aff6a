"""Every object and behaviour that the simulated CANopen rig is said to have, asked for in bytes."""

from __future__ import annotations

import struct

import pytest
from rig_bench import Bench
from test_simulated_device import DRIVE, ENCODER, FORCE, Wire

from teleop_rt_drivers.simulated.synchronous_bus import as_sent

COMMON = (
    "1000 1001 1003:0 1003:1 1005 1006 1008 1010:1 1011:1 1014 1016:1 1017 1018:1 1018:2 1018:3 "
    "1018:4 1019 1029:1"
)
ENCODERS = (
    "6000 6002 6003 6004 6005:1 6005:2 6030:1 6200 6500 6503 6504 6505 6506 1800:1 1800:2 1801:1 "
    "1801:2 1A00:0 1A01:0"
)
FORCES = "6110:1 6130:1 9130:1 6131:1 6132:1 6150:1 61A0:1 61A1:1 1800:1 1800:2 1A00:0"
DRIVES = (
    "603F 6007 605A 605E 6060 6061 6072 6076 607D:1 607D:2 607F 6085 60C2:1 60C2:2 6502 6040 6041 "
    "6071 6077 607A 6064 1400:1 1400:2 1600:0 1800:1 1800:2 1A00:0"
)
EMERGENCIES = {
    "8130": "daemon's heartbeat lost", "8140": "recovered from bus-off", "8210": "short PDO",
    "8220": "long PDO", "8250": "no PDO in time", "5000": "hardware", "FF01": "device",
}  # fmt: skip


@pytest.mark.parametrize(
    ("node", "entries"),
    [(n, COMMON) for n in (ENCODER, FORCE, DRIVE)]
    + [(ENCODER, ENCODERS), (FORCE, FORCES), (DRIVE, DRIVES)],
)
def test_every_object_answers_by_sdo(node, entries):
    wire = Wire()
    for entry in entries.split():
        index, _, sub = entry.partition(":")
        request = struct.pack("<BHB4x", 0x40, int(index, 16), int(sub or 0))
        answer = wire.send(0x600 + node, request)[-1][1]
        assert answer[0] & 0xE0 == 0x40, f"{entry} of node {node:#x}: {answer.hex()}"
        assert answer[1:4] == request[1:4]


def test_6125_takes_the_command_to_set_zero():
    answer = Wire().write(FORCE, 0x6125, 1, 0x6F72657A, 4)
    assert answer[0] == 0x60


def mapping(wire, node, index):
    count = wire.read(node, index)
    return [f"{wire.read(node, index, sub):08X}" for sub in range(1, count + 1)]


def test_ids_types_and_mappings_are_those_of_the_rig():
    wire = Wire()
    pdos = {
        (ENCODER, 0x1800): (0x190, 254),
        (ENCODER, 0x1801): (0x290, 1),
        (FORCE, 0x1800): (0x1A0, 1),
        (DRIVE, 0x1400): (0x230, 1),
        (DRIVE, 0x1800): (0x1B0, 1),
    }
    for (node, index), expected in pdos.items():
        found = (wire.read(node, index, 1) & 0x7FF, wire.read(node, index, 2))
        assert found == expected, f"{index:X}h of node {node:#x}"
    assert mapping(wire, ENCODER, 0x1A01) == ["60040020", "60300110", "65030010"]
    assert mapping(wire, FORCE, 0x1A00) == ["91300120", "61500108"]
    assert mapping(wire, DRIVE, 0x1600) == ["60400010", "60710010", "607A0020"]
    assert mapping(wire, DRIVE, 0x1A00) == ["60410010", "60770010", "60640020"]
    assert wire.read(ENCODER, 0x1005) == 0x80
    assert wire.read(DRIVE, 0x6502) == 1 << 7 | 1 << 9
    assert wire.read(ENCODER, 0x6005, 1) == 5000  # 5 um in 0.001 um
    assert struct.unpack("<f", struct.pack("<I", wire.read(FORCE, 0x6130, 1)))[0] < 0.5


def test_what_is_stored_outlives_a_reset_until_it_is_restored():
    wire = Wire()
    wire.write(ENCODER, 0x1017, 0, 33, 2)
    wire.write(ENCODER, 0x1010, 1, 0x65766173, 4)
    wire.send(0x000, bytes((0x81, ENCODER)))
    assert wire.read(ENCODER, 0x1017) == 33
    wire.write(ENCODER, 0x1011, 1, 0x64616F6C, 4)
    wire.send(0x000, bytes((0x81, ENCODER)))
    assert wire.read(ENCODER, 0x1017) == 0


def test_an_event_driven_pdo_comes_at_its_timer_and_only_in_operational():
    wire = Wire()
    wire.write(ENCODER, 0x1800, 5, 10, 2)
    assert not [cob for cob, _ in wire.wait(40) if cob == 0x190]
    wire.start(ENCODER)
    assert 4 <= [cob for cob, _ in wire.wait(50)].count(0x190) <= 6


def emergencies_of(wire, frames):
    return [
        f"{struct.unpack('<H', data[:2])[0]:04X}" for cob, data in frames if cob == 0x80 + DRIVE
    ]


def map_two_objects(wire):
    """Let the drive expect 6 bytes."""
    wire.write(DRIVE, 0x1400, 1, 0x80000230, 4)
    wire.write(DRIVE, 0x1600, 0, 0, 1)
    wire.write(DRIVE, 0x1600, 1, 0x60400010, 4)
    wire.write(DRIVE, 0x1600, 2, 0x607A0020, 4)
    wire.write(DRIVE, 0x1600, 0, 2, 1)
    wire.write(DRIVE, 0x1400, 1, 0x230, 4)


def provoke(code: str) -> list[str]:
    """Make the drive send an emergency, and return its frames."""
    wire = Wire()
    wire.write(DRIVE, 0x1016, 1, 127 << 16 | 60, 4)
    wire.write(DRIVE, 0x1400, 5, 20, 2)
    wire.start(DRIVE)
    command = struct.pack("<Hhi", 6, 0, 0)
    if code == "8130":
        wire.send(0x77F, b"\x05")
        return emergencies_of(wire, wire.wait(70))
    if code == "8250":
        wire.send(0x230, command)
        return emergencies_of(wire, wire.wait(30))
    if code == "8210":
        return emergencies_of(wire, wire.send(0x230, command[:5]))
    if code == "8220":
        map_two_objects(wire)
        return emergencies_of(wire, wire.send(0x230, command))
    if code == "8140":
        wire.rig.inject("bus_off", "drive")
        wire.heard()
        wire.rig.heal("drive")
    else:
        wire.heard()
        wire.rig.inject("emergency" if code == "5000" else "device_error", "drive")
    return emergencies_of(wire, wire.heard())


@pytest.mark.parametrize("code", EMERGENCIES)
def test_each_emergency_is_sent_for_its_cause(code):
    assert provoke(code) == [code]


def test_devices_beat_every_20_ms_and_the_daemon_every_10():
    bench = Bench().armed()
    assert [d.value(0x1017) for d in bench.simulated.devices.values()] == [20, 20, 20]
    heard = []
    deliver = bench.device_end.deliver
    bench.device_end.deliver = lambda message: (heard.append(as_sent(message)), deliver(message))
    bench.cycles(100)
    assert [can_id for can_id, _ in heard].count(0x77F) == 10


def test_a_device_specific_error_is_reported_in_words():
    bench = Bench().armed()
    bench.simulated.inject("device_error", "encoder")
    bench.cycles(2)
    assert "encoder: emergency FF01h, device specific: see its manual" in bench.axis.last_emergency
