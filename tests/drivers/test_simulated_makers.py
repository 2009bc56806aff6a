"""Simulated drives against bytes of their makers' documents: no codec of ours writes or reads one.

Examples of a document are copied as printed; the others were computed by hand from its tables.
"""

from __future__ import annotations

import struct

import pytest
from framed_bench import load
from rig_bench import MS

from teleop_rt_drivers.simulated.actuator_network import SIMULATED
from teleop_rt_drivers.simulated.line_actuators import SIMULATED as ON_LINES

PERIOD_NS = 1_000_000
EXTENDED, WIDE = 0x8000_0000, 0x4000_0000
LATE_NS = 10**12


class Table:
    """A plant that stands where it is put, and notes a drive's commands to it."""

    def __init__(self, position=0.0, velocity=0.0, force=0.0):
        self.position = self.reported_position = position
        self.velocity, self.servo_force = velocity, force
        self.done = []

    def mean_servo_force(self, span_ns):
        return self.servo_force

    def __getattr__(self, name):
        return lambda *given: self.done.append((name, *given))


class Bench:
    """A simulated drive of a preset, or of a rig, on a table; `said` holds its frames."""

    def __init__(self, rig, **state):
        part = (load(rig) if isinstance(rig, str) else rig).axis.parts["drive"]
        self.config = part.model_dump()
        self.table = Table(**state)
        self.said = []
        made = (SIMULATED | ON_LINES)[part.driver]
        self.drive = made(part, self.table, lambda whom, data: self.said.append((whom, data)),
                          PERIOD_NS)  # fmt: skip
        self.drive.restart()
        self.table.done.clear()

    def hears(self, can_id, data, now_ns=LATE_NS):
        """Give it a frame, in hex; return its answer of the same instant."""
        self.said.clear()
        self.drive.receive(can_id, bytes.fromhex(data.replace(" ", "")), now_ns)
        return list(self.said)

    def asked(self, data, now_ns=LATE_NS):
        """Give it a packet on a line; return its answers as they are on the line."""
        self.said.clear()
        self.drive.receive(bytes.fromhex(data.replace(" ", "")), now_ns)
        return [self.drive.packed(whom, content).hex() for whom, content in self.said]


def packed(text):
    """The hex digits without the spaces between fields."""
    return text.replace(" ", "")


# moteus, docs/protocol/can.md, section "Example": command and answer.
def test_a_moteus_answers_the_example_of_its_document_byte_by_byte():
    lead, torque = 0.01, 0.01 / 6.283185307179586
    bench = Bench("moteus", position=80e-4 * lead, velocity=0.064 * lead, force=-1.44 / torque)
    assert bench.config["servo_id"] == 1
    ((whom, answer),) = bench.hears(0x8001, "01000a07206000200150ff140400130d")
    assert whom & 0x1FFF_FFFF == 0x100
    assert answer.hex() == "2404000a005000000170ff230d181400"
    name, position, _ = bench.table.done[-1]
    assert name == "follow"
    assert position == pytest.approx(96e-4 * lead)
    assert bench.hears(0x0001, "01000a140400") == [], "bit 15 of the id asks for an answer"
    assert bench.hears(0x8002, "01000a140400") == [], "another servo"


# registers.md: 0x027, and "Mappings"; "This is internally limited to be no more than the kp scale."
@pytest.mark.parametrize(
    ("written", "lives_ms"),
    [
        ("01000a 0d27 cdcc4c3d", 50),  # a float of 0.05 s
        ("01000a 0127 05", 50),  # 5 counts of 0.01 s
        ("01000a 0527 3200", 50),  # 50 counts of 0.001 s
        ("01000a 0927 50c30000", 50),  # 50 000 counts of 1 us
        ("01000a 0d27 00000000", 100),  # 0: the default of its config
        ("01000a", 100),
    ],
)
def test_a_moteus_times_out_when_a_command_is_valid_no_longer(written, lives_ms):
    bench = Bench("moteus")
    bench.hears(0x8001, written)
    bench.drive.run(LATE_NS + (lives_ms - 1) * MS)
    assert bench.drive.enabled
    bench.drive.run(LATE_NS + (lives_ms + 1) * MS)
    ((_, answer),) = bench.hears(0x8001, "1100")  # one int8 of mode
    assert answer.hex()[:6] == "21000b", "11: timeout"


@pytest.mark.parametrize("least", ["0d27 0000c07f", "0127 80", "0527 0080", "0927 00000080"])
def test_not_a_number_or_the_least_number_is_no_time_out_of_a_moteus(least):
    bench = Bench("moteus")
    bench.hears(0x8001, f"01000a {least}")
    bench.drive.run(LATE_NS + 10**13)
    assert bench.drive.enabled


def test_a_moteus_has_no_damping_without_stiffness_and_stands_at_no_position():
    bench = Bench("moteus")
    nan, one, zero = "0000c07f", "0000803f", "00000000"
    head = "01000a 0c05 20"  # position mode; five floats from 0x020 on
    bench.hears(0x8001, head + nan + zero + zero + zero + one)  # kp 0, kd 1
    assert bench.table.done[-1] == ("push", 0.0)
    bench.hears(0x8001, head + nan + zero + zero + one + one)
    assert bench.table.done[-1] == ("hold",)
    before = len(bench.table.done)
    bench.hears(0x8001, head + nan + zero + zero + one + one)
    assert len(bench.table.done) == before, "it stands where it began to stand"


# ODrive, tools/odrive-cansimple.dbc: axis << 5 | message, all little endian; firmware, AxisState.
def test_an_odrive_speaks_as_its_dbc_says():
    lead = 0.01
    newton = 0.05 / (lead / 6.283185307179586)  # of an ampere
    bench = Bench("odrive", position=1.5 * lead, velocity=-0.5 * lead, force=2.0 * newton)
    axis = bench.config["node_id"] << 5
    bench.hears(axis | 0x07, "08000000 00000000")
    assert bench.drive.enabled
    bench.drive.run(LATE_NS)
    sent = {can_id - axis: data.hex() for can_id, data in bench.said}
    assert sent[0x01][:10] == "0000000008"
    assert sent[0x09] == "0000c03f000000bf"  # 1.5 and -0.5
    current = struct.unpack("<2f", bytes.fromhex(sent[0x14]))
    assert current == pytest.approx((2.0, 2.0))
    bench.hears(axis | 0x0B, "03000000 01000000")
    bench.hears(axis | 0x0C, "000000bf e803 0cfe")  # -0.5 turns; speed and torque fed forward
    assert bench.table.done[-1] == ("follow", pytest.approx(-0.5 * lead), 1e-3)
    bench.hears(axis | 0x0B, "01000000 01000000")
    bench.hears(axis | 0x0E, "0000803e 00000000")  # 0.25 Nm
    assert bench.table.done[-1] == ("push", pytest.approx(0.25 * 6.283185307179586 / lead))
    bench.hears(axis + 32 | 0x07, "01000000 00000000")
    assert bench.drive.enabled, "another axis was meant"
    bench.drive.run(LATE_NS + 51 * MS)
    assert not bench.drive.enabled
    bench.said.clear()
    bench.drive.run(LATE_NS + 62 * MS)
    beats = [data.hex() for can_id, data in bench.said if can_id == axis | 0x01]
    assert beats[0][:10] == "0008000001", "watchdog timer expired, idle"


# Damiao, DM_CAN.py: `control`, `control_cmd` and `process_packet`; error codes of its manual.
def test_a_damiao_takes_and_gives_the_bits_of_its_maker_s_program():
    bench = Bench("damiao", position=12.5 * 0.01, velocity=-30.0 * 0.01, force=10.0 / 0.01)
    motor, host = bench.config["motor_id"], bench.config["host_id"]
    ((whom, answer),) = bench.hears(motor, "ffffffffffffff fc")
    assert whom == host
    assert answer.hex()[:12] == f"1{motor:x}ffff000fff"
    bench.hears(motor, "ffff 000 333 ccc 800")  # q, dq, kp, kd, tau: 16 and four times 12 bits
    name, x, v, kp, kd, _ = bench.table.done[-1]
    assert name == "impede"
    assert (x, v) == (pytest.approx(12.5 * 0.01), pytest.approx(-30.0 * 0.01))
    assert kp * 0.01**2 == pytest.approx(500 * 0x333 / 4095)
    assert kd * 0.01**2 == pytest.approx(5 * 0xCCC / 4095)
    bench.hears(motor, "8000 800 000 000 fff")
    assert bench.table.done[-1] == ("push", pytest.approx(10.0 / 0.01))
    ((_, answer),) = bench.hears(motor, "ffffffffffffff fd")
    assert answer.hex()[:2] == f"0{motor:x}"
    assert bench.hears(motor + 1, "ffffffffffffff fc") == []
    bench.hears(motor, "ffffffffffffff fc")
    bench.drive.run(LATE_NS + 51 * MS)
    ((_, answer),) = bench.hears(motor, "ffffffffffffff fc")
    assert answer.hex()[:2] == f"d{motor:x}", "communication lost"


# RobStride, kscalelabs/robstride src/protocol.rs: motor in bits 0 to 7, host (or torque) in 8 to
# 23, kind in 24 to 28; an answer has the host in 0 to 7, the motor in 8 to 15, faults in 16 to 21.
def test_a_robstride_takes_and_gives_the_fields_of_its_library():
    top = 12.566370614359172
    bench = Bench("robstride", position=top * 0.01, velocity=-44.0 * 0.01, force=17.0 / 0.01)
    motor, host = bench.config["motor_id"], bench.config["host_id"]
    ((whom, answer),) = bench.hears(0x03 << 24 | host << 8 | motor, "0000000000000000")
    assert whom == EXTENDED | 0x02 << 24 | 2 << 22 | motor << 8 | host
    assert answer.hex()[:12] == "ffff0000ffff"
    bench.hears(0x01 << 24 | 0xFFFF << 8 | motor, "ffff 0000 3333 cccc")
    name, x, v, kp, kd, _ = bench.table.done[-1]
    assert (name, x, v) == ("impede", pytest.approx(top * 0.01), pytest.approx(-44.0 * 0.01))
    assert (kp * 0.01**2, kd * 0.01**2) == (pytest.approx(100.0), pytest.approx(4.0))
    bench.hears(0x01 << 24 | 0xFFFF << 8 | motor, "8000 8000 0000 0000")
    assert bench.table.done[-1] == ("push", pytest.approx(17.0 / 0.01))
    bench.drive.run(LATE_NS + 10**12)
    assert bench.drive.enabled, "there is no time-out unless it is written"
    bench.hears(0x12 << 24 | host << 8 | motor, "2870 0000 e8030000")  # 1000 counts of 50 us
    bench.drive.run(LATE_NS + 51 * MS)
    ((whom, _),) = bench.hears(0x12 << 24 | host << 8 | motor, "2870 0000 e8030000")
    assert whom >> 22 & 3 == 0, "reset mode"


# VESC, documentation/comm_can.md: the example of SET_CURRENT, and the tables of status messages.
def test_a_vesc_takes_the_example_of_its_document_and_sends_its_tables():
    per_turn, ampere = 0.2, 0.06 * 4.0 * 6.283185307179586 / 0.2
    bench = Bench("vesc", position=0.25 * per_turn, velocity=0.1 * per_turn, force=-3.2 * ampere)
    vesc = bench.config["controller_id"]
    bench.hears(0x0100 | vesc, "0000c738")  # 51 A
    assert bench.table.done[-1] == ("push", pytest.approx(51.0 * ampere))
    bench.drive.run(LATE_NS)
    sent = {can_id - EXTENDED >> 8: data.hex() for can_id, data in bench.said}
    assert all(can_id & 0xFF == vesc for can_id, _ in bench.said)
    assert sent[9][:12] == "000000a8ffe0"  # 0.1 x 4 turns, 7 pole pairs, per minute; -3.2 A
    assert sent[16][-4:] == f"{270 * 50:04x}"
    bench.hears(0x0400 | vesc, "05f5e100")  # 100 degrees
    assert bench.table.done[-1] == ("follow", pytest.approx((100 - 180) / 360 * per_turn), 1e-3)
    bench.drive.run(LATE_NS + 51 * MS)
    assert not bench.drive.enabled


# ROBOTIS, emanual docs/en/dxl/protocol2.md: packets as printed for ping, read and sync read.
def test_a_dynamixel_obeys_the_packets_that_its_manual_prints():
    bench = Bench("dynamixel", position=166 / 4096 * 0.1)
    assert bench.config["servo_id"] == 1
    # Model 1060, firmware 2Ah in the manual's example; ours is 1030 (0406h), 48 (30h).
    (ping,) = bench.asked("FFFFFD00 01 0300 01 194E")
    assert ping[:22] == "fffffd0001070055000604"
    # Read 84h (present position), 4 bytes: 166 in the manual's answer.
    assert bench.asked("FFFFFD00 01 0700 02 84000400 1D15") == [
        packed("fffffd00 01 0800 55 00 a6000000 8cc0")
    ]  # fmt: skip
    assert bench.asked("FFFFFD00 01 0700 02 84000400 1D16") == [], "its CRC is wrong"
    assert bench.asked("FFFFFD00 FE 0900 82 840004000102 CEFA") == [
        packed("fffffd00 01 0800 55 00 a6000000 8cc0")
    ]  # fmt: skip


# Feetech, manual of the protocol: "read two bytes from 38h of servo 1", answered with 0818h.
def test_a_feetech_answers_the_packet_that_its_manual_prints():
    bench = Bench("feetech", position=0x0818 / 4096 * 0.1)
    assert bench.config["servo_id"] == 1
    assert bench.asked("FFFF 01 04 02 38 02 BE") == ["ffff0104001808da"]
    assert bench.asked("FFFF 01 04 02 38 02 BF") == [], "its sum is wrong"
    assert bench.asked("FFFF 02 04 02 38 02 BD") == [], "another servo"
