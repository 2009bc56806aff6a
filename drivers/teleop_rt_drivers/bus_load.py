"""Worst-case load of a bus: every frame of a cycle at its longest, heartbeats included."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from teleop_rt_drivers.canopen.pdo import PdoCodec
from teleop_rt_drivers.framed.binary import BinaryPacker
from teleop_rt_drivers.framed.dbc import load_dbc
from teleop_rt_drivers.framed.format import BinaryFormat, load_format

if TYPE_CHECKING:
    from canopen.objectdictionary import ObjectDictionary

    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.actuators.codec import Frame
    from teleop_rt_drivers.actuators.config import ActuatorDeviceConfig
    from teleop_rt_drivers.actuators.part import CanActuatorPart, LineActuatorPart
    from teleop_rt_drivers.canopen.config import CanopenPart
    from teleop_rt_drivers.framed.config import RawCanPart, SerialPart

FULLEST_BUS = 0.8
"""Above this share there is no room for repeated frames, SDO and emergencies."""
FULLEST_LINE = 0.95
"""A serial line belongs to one device, which repeats nothing."""
BITS_PER_SERIAL_BYTE = 10
"""Start bit, eight data bits, stop bit."""


def frame_bits(data_bytes: int, *, extended: bool = False) -> int:
    """Return the longest a CAN frame can get on the wire, intermission included [bit].

    47 + 8n + floor((33 + 8n) / 4) with an 11-bit id: every fourth bit stuffed (Davis et al., 2007).
    """
    header, stuffed = (67, 53) if extended else (47, 33)
    return header + 8 * data_bytes + (stuffed + 8 * data_bytes) // 4


def fd_frame_bits(data_bytes: int, share: float) -> float:
    """Return the longest a CAN FD frame with a 29-bit id takes, in bits of the slow rate.

    `share` is the slow rate over the fast one: DLC, data and CRC go at the fast rate, every fourth
    bit stuffed (ISO 11898-1: CRC of 21 bits with 7 fixed stuff bits and its count above 16 bytes).
    """
    slow = 36 + 36 // 4 + 13
    fast = (5 + 8 * data_bytes) * 5 // 4 + 4 + (21 + 7 if data_bytes > 16 else 17 + 6)
    return slow + share * fast


@dataclass(frozen=True, slots=True)
class Load:
    """Bits that are sent every cycle, and bits per second that do not depend on the rate."""

    per_cycle: float
    per_second: float
    bit_rate: int
    fullest: float = FULLEST_BUS

    def share(self, rate_hz: float) -> float:
        """Return the share of the bus that is used at a rate."""
        return (self.per_cycle * rate_hz + self.per_second) / self.bit_rate

    @property
    def fitting_rate_hz(self) -> int:
        """Return the highest rate that leaves the bus its reserve."""
        return math.floor((self.fullest * self.bit_rate - self.per_second) / self.per_cycle)


def canopen_load(
    config: CanopenPart, dictionaries: dict[str, ObjectDictionary], bit_rate: int
) -> Load:
    """Return the load of SYNC, process data and heartbeats. Raises AxisError for a bad mapping."""
    per_cycle = float(frame_bits(config.daemon.sync_bytes))
    for name, tpdo in config.tpdos:
        size = PdoCodec(tpdo, dictionaries[name], name, receive=False).struct.size
        per_cycle += frame_bits(size) / tpdo.transmission_type
    if (drive := config.drive) is not None:
        # The drive's command is sent every cycle, whatever its transmission type.
        size = PdoCodec(drive.rpdo, dictionaries["drive"], "drive", receive=True).struct.size
        per_cycle += frame_bits(size)
    per_second = frame_bits(1) * 1000 / config.daemon.heartbeat_ms
    for node in config.nodes.values():
        if node.guarding is None:
            per_second += frame_bits(1) * 1000 / node.heartbeat_ms
        else:
            per_second += (frame_bits(0) + frame_bits(1)) * 1000 / node.guarding.period_ms
    return Load(per_cycle, per_second, bit_rate)


def raw_can_load(config: RawCanPart, bit_rate: int) -> Load:
    """Return the load of the messages used: once a cycle, or as often as the DBC says."""
    messages = load_dbc(config.dbc)
    commands = {config.drive.command} if config.drive else set()
    used = {signal.source for signal in config.signals.values()} | commands
    used |= {config.drive.answer} if config.drive else set()
    per_cycle = per_second = 0.0
    for name in sorted(used):
        message = messages[name]
        bits = frame_bits(message.length, extended=message.is_extended_frame)
        if name not in commands and message.cycle_time:
            per_second += bits * 1000 / message.cycle_time
        else:
            per_cycle += bits
    return Load(per_cycle, per_second, bit_rate)


def actuator_load(config: CanActuatorPart, rig: RigConfig, bit_rate: int) -> Load:
    """Return the load of a command every cycle, and of the drive's frames each cycle."""
    frames = config.codec(rig).follow(0.0, 0.0)
    bits = sum(sum(exchange_bits(frame, config, bit_rate)) for frame in frames)
    return Load(bits, 0.0, bit_rate)


def asked_load(config: ActuatorDeviceConfig, rig: RigConfig, bit_rate: int) -> Load:
    """Return the load of an operator's device; where it is asked each cycle, of that as well."""
    load = actuator_load(config.drive, rig, bit_rate)
    if config.asked is None:
        return load
    question = config.asked.codec(rig).question()
    bits = sum(exchange_bits(question, config.drive, bit_rate))
    return Load(load.per_cycle + bits, 0.0, bit_rate)


def exchange_bits(frame: Frame, config: CanActuatorPart, bit_rate: int) -> tuple[float, float]:
    """Return the longest a frame and the drive's answer to it take, in bits of the slow rate."""
    share = bit_rate / (config.bus.data_bitrate or bit_rate)

    def bits(size: int) -> float:
        wide, long = frame.fd, frame.extended
        return fd_frame_bits(size, share) if wide else frame_bits(size, extended=long)

    return bits(len(frame.data)), sum(bits(size) for size in config.answer_bytes)


def line_turn_s(config: LineActuatorPart, rig: RigConfig) -> float:
    """Return the time from an order on a half-duplex line until its answer is read, at worst."""
    codec = config.codec(rig)
    sent = sum(len(frame.data) for frame in codec.follow(0.0, 0.0))
    wire_s = BITS_PER_SERIAL_BYTE * (sent + codec.answer_bytes) / config.baud
    return wire_s + 1e-6 * config.return_delay_us + 1e-3 * config.usb_latency_ms


def serial_loads(config: SerialPart) -> dict[str, Load]:
    """Return the load of each direction of each port, by a frame every cycle."""
    loads = {}
    for name, port in config.ports.items():
        frame = load_format(port.format)
        if isinstance(frame, BinaryFormat):
            bits = float(BITS_PER_SERIAL_BYTE * frame.size)
            loads[f"{name}, received"] = Load(bits, 0.0, port.baud, FULLEST_LINE)
        if port.command_format is not None:
            command = load_format(port.command_format)
            if isinstance(command, BinaryFormat):
                size = len(BinaryPacker(command).pack([0.0] * len(command.fields)))
                bits = float(BITS_PER_SERIAL_BYTE * size)
                loads[f"{name}, sent"] = Load(bits, 0.0, port.baud, FULLEST_LINE)
    return loads
