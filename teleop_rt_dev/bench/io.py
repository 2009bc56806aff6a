"""Reading and decoding one cycle: our path against canopen's objects and pyserial's `read`."""

from __future__ import annotations

import os
import select
import struct
import termios
import tty
from functools import partial
from typing import Any

import canopen
import numpy as np
import serial

from teleop_rt.config.loader import load_rig
from teleop_rt_dev.bench.drive_cycles import DRIVES, actuator_cycle
from teleop_rt_dev.bench.measure import Row, interleave, ratios, row, seconds
from teleop_rt_dev.paths import RIGS
from teleop_rt_drivers.can_frames import FRAME, WIDE
from teleop_rt_drivers.canopen import intake
from teleop_rt_drivers.canopen.axis import CanopenAxis
from teleop_rt_drivers.canopen.eds import load
from teleop_rt_drivers.canopen.pdo import PdoCodec
from teleop_rt_drivers.framed.binary import BinaryParser, binary_fields
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.framed.format import BinaryFormat, load_format
from teleop_rt_drivers.framed.source import Source
from teleop_rt_drivers.framed.stream import SerialStream
from teleop_rt_drivers.registry import AXIS_SCHEMAS
from teleop_rt_drivers.simulated.frame_devices import crc16_x25
from teleop_rt_drivers.simulated.synchronous_bus import synchronous_pair

RIG = RIGS / "simulated_canopen.yaml"
CYCLES = 2000  # of a CAN bus per time taken: 2 s at 1 kHz
FRAMES = {
    0x290: struct.pack("<ihH", 2400, 10, 0),
    0x1A0: struct.pack("<iB", 15000, 0),
    0x1B0: struct.pack("<Hhi", 0x1637, 20, 12000),
}


def our_canopen(cycles: int) -> float:
    """Decode and check a cycle's three frames, match them to the SYNC, settle the values."""
    rig: Any = load_rig(RIG, AXIS_SCHEMAS)
    axis: Any = CanopenAxis(rig.axis, rig, synchronous_pair()[0], lambda: 0)
    # The path of a frame; recv and send of the bus are not timed.
    encoder, force, drive = axis._parts
    sources, words = axis._receiver._sources, axis.counters.words
    lives, readings = axis._receiver._heartbeats.lives, axis._receiver._readings
    arrays = sources, words, lives, readings, axis._receiver._sample.stored
    slots = np.zeros((len(FRAMES), WIDE.size), np.uint8)
    for place, (can_id, data) in enumerate(FRAMES.items()):
        FRAME.pack_into(slots[place], 0, can_id, len(data), data, 0)

    def work() -> None:
        for _ in range(cycles):
            intake.take_cycle(*arrays, slots, 0, len(FRAMES), 0, 0, True)  # noqa: FBT003
            drive.settle()

    spent = seconds(work) / cycles
    assert abs(encoder.value - 0.012) < 1e-9
    assert abs(force.value - 15.0) < 1e-9
    return spent


def our_decoding(cycles: int) -> float:
    """Decode a cycle's three frames to the same values as canopen's objects give, unchecked."""
    axis: Any = load_rig(RIG, AXIS_SCHEMAS).axis
    nodes = {"encoder": axis.encoder, "force sensor": axis.force, "drive": axis.drive}
    codecs = [
        PdoCodec(node.tpdo, load(node.eds, node.node_id), name, receive=False)
        for name, node in nodes.items()
    ]
    unpack = {codec.cob_id: codec.struct.unpack for codec in codecs}
    frames = [(cob_id, bytearray(data)) for cob_id, data in FRAMES.items()]

    def work() -> list[int]:
        for _ in range(cycles):
            values: list[int] = []
            for cob_id, data in frames:
                values += unpack[cob_id](data)
        return values

    spent = seconds(work) / cycles
    assert work() == [2400, 10, 0, 15000, 0, 0x1637, 20, 12000]
    return spent


def dictionary_canopen(cycles: int) -> float:
    """Notify canopen's network of the three frames, and read the same values from its objects."""
    axis: Any = load_rig(RIG, AXIS_SCHEMAS).axis
    network = canopen.Network(synchronous_pair()[0])
    variables = []
    for node, number in ((axis.encoder, 2), (axis.force, 1), (axis.drive, 1)):
        remote = canopen.RemoteNode(node.node_id, load(node.eds, node.node_id))
        network.add_node(remote)
        pdo = remote.tpdo[number]
        pdo.clear()
        for entry in node.tpdo.objects:
            index, _, sub = entry.partition(":")
            variables.append(pdo.add_variable(int(index, 16), int(sub or 0)))
        pdo.cob_id, pdo.enabled = {0x10: 0x290, 0x20: 0x1A0, 0x30: 0x1B0}[node.node_id], True
        pdo.subscribe()
    frames = [(cob_id, bytearray(data)) for cob_id, data in FRAMES.items()]

    def work() -> list[int]:
        for _ in range(cycles):
            for cob_id, data in frames:
                network.notify(cob_id, data, 0.0)
            values = [variable.raw for variable in variables]
        return values

    spent = seconds(work) / cycles
    assert work() == [2400, 10, 0, 15000, 0, 0x1637, 20, 12000]
    return spent


def wrench_frame() -> bytes:
    body = struct.pack("<H6fIf", 0, 0, 0, 7.5, 0, 0, 0, 1, 20.0)
    return b"\xaa" + body + struct.pack("<H", crc16_x25(body))


class Terminal:
    """A pseudo-terminal that carries one frame a cycle."""

    def __init__(self) -> None:
        self.device, self._daemon = os.openpty()
        tty.setraw(self._daemon, termios.TCSANOW)
        self.path = os.ttyname(self._daemon)

    def close(self) -> None:
        os.close(self.device)
        os.close(self._daemon)


def our_serial(cycles: int, *, decode: bool) -> float:
    """Read a frame from the descriptor; with `decode` also find, check and unpack it."""
    terminal = Terminal()
    stream = SerialStream(terminal.path, 460_800)
    frame = load_format("wrench_crc16")
    assert isinstance(frame, BinaryFormat)
    source = Source("wrench", binary_fields(frame))
    heard: list[float] = []
    source.listen(lambda values, _: heard.append(values[3]))
    parser = BinaryParser(frame, source, FramedCounters())
    parser.reset()
    data = wrench_frame()
    got: list[bytes] = []

    def one() -> None:
        got.append(stream.read())
        if decode:
            parser.feed(got[-1], 0)

    spent = 0.0
    for _ in range(cycles):
        os.write(terminal.device, data)
        stream.wait(1.0)
        spent += seconds(one)
    assert got == [data] * cycles
    assert heard == [7.5] * (cycles if decode else 0)
    stream.close()
    terminal.close()
    return spent / cycles


def pyserial_read(cycles: int) -> float:
    """Read a frame's bytes by pyserial's `read`, without decoding them."""
    terminal = Terminal()
    port = serial.Serial(terminal.path, 460_800, timeout=0)
    data = wrench_frame()
    got = []

    def one() -> None:
        got.append(port.read(len(data)))

    spent = 0.0
    for _ in range(cycles):
        os.write(terminal.device, data)
        select.select([port.fileno()], [], [], 1.0)
        spent += seconds(one)
    assert got == [data] * cycles
    port.close()
    terminal.close()
    return spent / cycles


def run(rounds: int) -> list[Row]:
    """Return the rows of this bench: times in microseconds, and the ratios with their bars."""
    can_times = interleave(
        rounds,
        [
            lambda: our_decoding(CYCLES),
            lambda: our_canopen(CYCLES),
            lambda: dictionary_canopen(CYCLES),
        ],
    )
    serial_times = interleave(
        rounds,
        [
            lambda: our_serial(CYCLES, decode=False),
            lambda: our_serial(CYCLES, decode=True),
            lambda: pyserial_read(CYCLES),
        ],
    )
    names: tuple[tuple[str, list[list[float]], int], ...] = (
        ("CANopen cycle, ours, decoded", can_times, 0),
        ("CANopen cycle, ours, decoded, checked, matched to SYNC", can_times, 1),
        ("CANopen cycle, object dictionary of canopen", can_times, 2),
        ("37-byte serial frame, ours, read", serial_times, 0),
        ("37-byte serial frame, ours, read, checked, decoded", serial_times, 1),
        ("37-byte serial frame, pyserial's read", serial_times, 2),
    )
    works = [partial(actuator_cycle(name), CYCLES) for name in DRIVES]
    drive_times = interleave(rounds, works)
    names += tuple(
        (f"cycle with {name}: answers read, target sent, processor time", drive_times, place)
        for place, name in enumerate(DRIVES)
    )
    rows = [row(name, "us", [1e6 * one[side] for one in times]) for name, times, side in names]
    decoding, checked = ratios(can_times, 2, 0), ratios(can_times, 2, 1)
    rows.append(row("decoding: canopen / ours", "ratio", decoding, ">= 20"))
    rows.append(row("canopen's decoding / ours with all checks", "ratio", checked))
    reading, decoded = ratios(serial_times, 2, 0), ratios(serial_times, 2, 1)
    rows.append(row("reading: pyserial / ours", "ratio", reading, ">= 2"))
    rows.append(row("pyserial's reading / ours with checks and decoding", "ratio", decoded))
    return rows
