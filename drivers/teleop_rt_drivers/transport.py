"""Age of a sample and delay of a force, caused by bus, frames and order of a cycle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError, Timing
from teleop_rt_drivers.bus_load import (
    BITS_PER_SERIAL_BYTE,
    actuator_load,
    exchange_bits,
    frame_bits,
)
from teleop_rt_drivers.canopen import eds
from teleop_rt_drivers.canopen.pdo import PdoCodec
from teleop_rt_drivers.framed.binary import BinaryPacker
from teleop_rt_drivers.framed.format import BinaryFormat, load_format

if TYPE_CHECKING:
    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.actuators.config import ActuatorDeviceConfig
    from teleop_rt_drivers.canopen.config import CanopenDeviceConfig
    from teleop_rt_drivers.framed.config import SerialDeviceConfig

DEFAULT_BIT_RATE = 1_000_000
"""Bits a second of a CAN bus whose rig states none."""
AT_NEXT_SYNC = 240
"""Transmission types up to this one wait for a SYNC (CiA 301, table 71)."""


@dataclass(frozen=True, slots=True)
class TransportTimes:
    """Time from latching a sample to its answer, and from the answer to the drive, at worst.

    On a simulated clock frames take no time: `hidden_age_s` and `hidden_delay_s` are the shares
    that a simulated device must add itself.
    """

    sample_age_s: float
    force_delay_s: float
    hidden_age_s: float = 0.0
    hidden_delay_s: float = 0.0


def timing_of(transport: TransportTimes, rig: RigConfig) -> Timing:
    """Return the timing of an operator's device: the way of its frames, and its own latency."""
    body = rig.device
    if body is None:
        raise AxisError("device is missing: state the physical properties of the operator's device")
    lag_s = body.latency_s - 1e-3 * body.position_latency_ms
    return Timing(
        transport.sample_age_s + 1e-3 * body.position_latency_ms, transport.force_delay_s + lag_s
    )


def canopen_transport(axis: CanopenDeviceConfig, rig: RigConfig) -> TransportTimes:
    """Return the transport of a CANopen device. Raises AxisError for a bad mapping.

    A sample is latched by SYNC; it is answered in the next cycle, or in the same one within
    `answer_within_ms`. A force acts when its frame is received, or at the next SYNC.
    """
    period_s = rig.period_ns * 1e-9
    bit_rate = axis.bus.bitrate or DEFAULT_BIT_RATE
    same_tick = axis.answer_within_ms is not None
    age_s = 1e-3 * axis.answer_within_ms if axis.answer_within_ms is not None else period_s
    if axis.drive.rpdo.transmission_type <= AT_NEXT_SYNC:
        return TransportTimes(age_s, period_s - age_s if same_tick else period_s)
    wire_s = command_bits(axis) / bit_rate
    return TransportTimes(age_s, wire_s, hidden_delay_s=wire_s + (age_s if same_tick else 0.0))


def answer_bits(axis: CanopenDeviceConfig) -> int:
    """Return the bits on the wire from a SYNC until the answers to it are complete, at worst."""
    bits = 0
    for name, node in (("encoder", axis.encoder), ("drive", axis.drive)):
        dictionary = eds.load(node.eds, node.node_id)
        bits += frame_bits(PdoCodec(node.tpdo, dictionary, name, receive=False).struct.size)
    return bits


def question_bits(axis: ActuatorDeviceConfig, rig: RigConfig) -> float:
    """Return the bits on the wire from a question to a drive until its answer is complete."""
    if axis.asked is None:
        return 0.0
    bit_rate = axis.bus.bitrate or DEFAULT_BIT_RATE
    return sum(exchange_bits(axis.asked.codec(rig).question(), axis.drive, bit_rate))


def command_bits(axis: CanopenDeviceConfig) -> int:
    """Return the bits of a command frame on the wire, at worst."""
    dictionary = eds.load(axis.drive.eds, axis.drive.node_id)
    return frame_bits(PdoCodec(axis.drive.rpdo, dictionary, "drive", receive=True).struct.size)


def serial_transport(axis: SerialDeviceConfig, rig: RigConfig) -> TransportTimes:
    """Return the transport of a serial device that sends once a period, on a grid of its own.

    Just before a new frame is complete the one before it is a period and a frame old.
    """
    position, drive = axis.ports[axis.position.source], axis.ports[axis.drive.command]
    frame = load_format(position.format)
    if not isinstance(frame, BinaryFormat):
        raise AxisError(
            f"ports.{axis.position.source}: a text format has no fixed length, "
            "and so no known latency: take a binary one"
        )
    age_s = rig.period_ns * 1e-9 + BITS_PER_SERIAL_BYTE * frame.size / position.baud
    command = load_format(drive.command_format or "")
    if not isinstance(command, BinaryFormat):
        raise AxisError(
            f"ports.{axis.drive.command}: a text command has no fixed length, "
            "and so no known latency: take a binary one"
        )
    size = len(BinaryPacker(command).pack([0.0] * len(command.fields)))
    delay_s = BITS_PER_SERIAL_BYTE * size / drive.baud
    return TransportTimes(age_s, delay_s, hidden_age_s=age_s, hidden_delay_s=delay_s)


def actuator_transport(axis: ActuatorDeviceConfig, rig: RigConfig) -> TransportTimes:
    """Return the transport of a drive with a protocol of its maker, its frames one after another.

    A drive that is asked answers within `answer_within_ms`, and takes the force in the same cycle.
    One that answers commands alone reports, a cycle later, its position at the last command; a
    drive that sends by itself does so once a period, on its own time grid.
    """
    bit_rate = axis.bus.bitrate or DEFAULT_BIT_RATE
    if axis.asked is not None and axis.answer_within_ms is not None:
        (command,) = axis.asked.codec(rig).push(0.0)
        age_s = 1e-3 * axis.answer_within_ms
        command_s = exchange_bits(command, axis.drive, bit_rate)[0] / bit_rate
        return TransportTimes(age_s, command_s, hidden_delay_s=age_s + command_s)
    wire_s = actuator_load(axis.drive, rig, bit_rate).per_cycle / bit_rate
    age_s = rig.period_ns * 1e-9
    if axis.drive.codec(rig).asks:
        return TransportTimes(age_s, wire_s, hidden_delay_s=wire_s)
    return TransportTimes(
        age_s + wire_s, wire_s, hidden_age_s=age_s + wire_s, hidden_delay_s=wire_s
    )
