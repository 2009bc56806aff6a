"""From config and EDS to the parts of the axis."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.canopen import cia402
from teleop_rt_drivers.canopen.channel import Channel
from teleop_rt_drivers.canopen.drive import Drive, Torque
from teleop_rt_drivers.canopen.pdo import PdoCodec
from teleop_rt_drivers.canopen.position_loop import PositionLoop
from teleop_rt_drivers.canopen.sdo import ConfigurationBus, SdoNode
from teleop_rt_drivers.quantity import FROM_DRIVE, Scale, plausible_force, plausible_position

if TYPE_CHECKING:
    from canopen.objectdictionary import ObjectDictionary

    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.canopen.config import CanopenPart
    from teleop_rt_drivers.canopen.counters import Counters
    from teleop_rt_drivers.canopen.drive_config import DriveConfig, ForceInputConfig, TorqueConfig
    from teleop_rt_drivers.canopen.node_config import EncoderConfig, ForceConfig, ForceReading
    from teleop_rt_drivers.quantity import Plausible

    Parts = tuple[Channel | None, Channel | None, Drive | None]

SPEED_SATURATED = 2**15 - 1  # raw: a speed of 16 bits shows no more than this


def encoder_channel(config: EncoderConfig, rig: RigConfig, dictionary: ObjectDictionary) -> Channel:
    """Return the channel of the position, bounded by the rig's limits."""
    codec = PdoCodec(config.tpdo, dictionary, "encoder", receive=False)
    channel = Channel(
        codec,
        codec.slot(config.position),
        None if config.alarms is None else codec.slot(config.alarms),
        Scale(config.scale, config.sign, config.offset),
        plausible_position(rig),
    )
    if config.speed is not None:
        channel.watch_speed(codec.slot(config.speed), SPEED_SATURATED)
    return channel


def drive_channel(config: DriveConfig, rig: RigConfig, dictionary: ObjectDictionary) -> Channel:
    """Return the channel of the position that the drive measures itself."""
    codec = PdoCodec(config.tpdo, dictionary, "drive", receive=False)
    slot = codec.slot(cia402.ACTUAL_POSITION)
    return Channel(codec, slot, None, drive_scale(config), plausible_position(rig))


def torque_channel(config: DriveConfig, rig: RigConfig, dictionary: ObjectDictionary) -> Channel:
    """Return the channel of the force that the motor's torque makes. Raises AxisError."""
    codec = PdoCodec(config.tpdo, dictionary, "drive", receive=False)
    slot = codec.slot(cia402.ACTUAL_TORQUE)
    scale = Scale(force_per_count(config), config.sign, 0.0)
    return Channel(codec, slot, None, scale, plausible_force(rig))


def force_per_count(config: DriveConfig) -> float:
    """Return the force of one count of 6077h. Raises AxisError where it is not known."""
    if config.rated is None:
        raise AxisError(
            "drive.rated_force is missing: 6077h counts in thousandths of it"
            ": take it from the data sheet or 6076h"
        )
    return config.rated / cia402.PER_RATED


def force_channel(config: ForceConfig, rig: RigConfig, dictionary: ObjectDictionary) -> Channel:
    """Return the channel of the force: it may jump, but not out of range."""
    codec = PdoCodec(config.tpdo, dictionary, "force sensor", receive=False)
    return _force(config, codec, plausible_force(rig))


def input_channel(
    config: ForceInputConfig, rig: RigConfig, dictionary: ObjectDictionary
) -> Channel:
    """Return the channel of a force sensor at the drive: a reading out of its range is none."""
    codec = PdoCodec(config.tpdo, dictionary, "drive input", receive=False)
    plausible, scale = plausible_force(rig), _scale(config)
    lower, upper = sorted((scale.value(config.lowest), scale.value(config.highest)))
    measured = replace(
        plausible, lower=max(lower, plausible.lower), upper=min(upper, plausible.upper)
    )
    return _force(config, codec, measured)


def _force(config: ForceReading, codec: PdoCodec, plausible: Plausible) -> Channel:
    status = None if config.status is None else codec.slot(config.status)
    return Channel(codec, codec.slot(config.force), status, _scale(config), plausible)


def _scale(config: ForceReading) -> Scale:
    return Scale(config.scale, config.sign, config.offset)


def axis_parts(
    config: CanopenPart,
    rig: RigConfig,
    dictionaries: dict[str, ObjectDictionary],
    counters: Counters,
) -> Parts:
    """Return encoder, force sensor and drive as the cycle sees them, None where there is none."""
    encoder, force, drive = config.encoder, config.force_sensor, config.drive
    made_encoder = made_force = made_drive = None
    if encoder is not None:
        made_encoder = encoder_channel(encoder, rig, dictionaries["encoder"])
    elif config.position is not None and drive is not None:
        made_encoder = drive_channel(drive, rig, dictionaries["drive"])
    if force is not None:
        made_force = force_channel(force, rig, dictionaries["force sensor"])
    elif drive is not None and drive.force_input is not None:
        made_force = input_channel(drive.force_input, rig, dictionaries["drive"])
    elif config.force is not None and drive is not None:
        made_force = torque_channel(drive, rig, dictionaries["drive"])
    if drive is not None:
        torque = None if drive.torque is None else torque_of(drive, drive.torque, made_encoder, rig)
        compared = drive.measures_force and config.force != FROM_DRIVE
        made_drive = drive_link(
            drive, dictionaries["drive"], counters, torque, force_is_compared=compared
        )
    return made_encoder, made_force, made_drive


def drive_scale(config: DriveConfig) -> Scale:
    """Return the scale of the drive's own positions."""
    return Scale(config.scale, config.sign, config.offset)


def torque_of(
    drive: DriveConfig, config: TorqueConfig, encoder: Channel | None, rig: RigConfig
) -> Torque:
    """Return the position loop of a drive that takes forces. Raises AxisError."""
    if encoder is None:
        raise AxisError(
            "drive.torque: the loop needs the encoder on the drive's bus: describe it there"
        )
    loop = PositionLoop(config, encoder, rig.period_ns * 1e-9, rig.limits.force_max)
    return Torque(loop, config.rated_force, drive.sign)


def drive_link(
    config: DriveConfig,
    dictionary: ObjectDictionary,
    counters: Counters,
    torque: Torque | None = None,
    *,
    force_is_compared: bool = False,
) -> Drive:
    """Return the drive as the cycle sees it."""
    return Drive(
        PdoCodec(config.tpdo, dictionary, "drive", receive=False),
        PdoCodec(config.rpdo, dictionary, "drive", receive=True),
        drive_scale(config),
        counters,
        config.zero,
        torque,
        config.sign * force_per_count(config) if force_is_compared else None,
    )


def switch_codec(
    config: DriveConfig | None, dictionary: ObjectDictionary | None
) -> PdoCodec | None:
    """Return the process data object that carries the home switch, if there is one."""
    if config is None or config.switch is None or dictionary is None:
        return None
    codec = PdoCodec(config.switch.tpdo, dictionary, "drive", receive=False)
    codec.slot(config.switch.entry)
    return codec


def sdo_nodes(
    config: CanopenPart, dictionaries: dict[str, ObjectDictionary], bus: ConfigurationBus
) -> dict[str, SdoNode]:
    """Return an SDO client for each device, by its name."""
    timeout_s = config.daemon.answer_timeout_ms / 1000
    return {
        name: SdoNode(name, node.node_id, dictionaries[name], bus, str(config.bus), timeout_s)
        for name, node in config.nodes.items()
    }
