"""From config and EDS to the parts of the axis."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt_drivers.canopen.channel import Channel, Plausible, Scale
from teleop_rt_drivers.canopen.drive import Drive
from teleop_rt_drivers.canopen.pdo import PdoCodec
from teleop_rt_drivers.canopen.sdo import ConfigurationBus, SdoNode

if TYPE_CHECKING:
    from canopen.objectdictionary import ObjectDictionary

    from teleop_rt.config import RigConfig
    from teleop_rt_drivers.canopen.config import (
        CanopenConfig,
        DriveConfig,
        EncoderConfig,
        ForceConfig,
    )

SPEED_MARGIN = 2.0
"""A position that moves faster than this times the rig's velocity limit is no position."""
FORCE_MARGIN = 3.0
"""A force beyond this times the rig's force limit is no force."""
JUMP_SLACK = 10.0
"""Encoder steps that a position may always change by."""


def encoder_channel(
    config: EncoderConfig, rig: RigConfig, dictionary: ObjectDictionary, counters: dict[str, int]
) -> Channel:
    """Return the channel of the position, bounded by the rig's limits."""
    codec = PdoCodec(config.tpdo, dictionary, "encoder", receive=False)
    limits = rig.limits
    travel = limits.position_max - limits.position_min
    return Channel(
        codec,
        codec.slot(config.position),
        None if config.alarms is None else codec.slot(config.alarms),
        Scale(config.scale, config.sign, config.offset),
        Plausible(
            lower=limits.position_min - travel,
            upper=limits.position_max + travel,
            rate=SPEED_MARGIN * limits.velocity_max,
            slack=JUMP_SLACK * rig.sensors.position_resolution,
        ),
        counters,
    )


def force_channel(
    config: ForceConfig, rig: RigConfig, dictionary: ObjectDictionary, counters: dict[str, int]
) -> Channel:
    """Return the channel of the force: it may jump, but not out of range."""
    codec = PdoCodec(config.tpdo, dictionary, "force sensor", receive=False)
    most = FORCE_MARGIN * rig.limits.force_max
    return Channel(
        codec,
        codec.slot(config.force),
        None if config.status is None else codec.slot(config.status),
        Scale(config.scale, config.sign, config.offset),
        Plausible(lower=-most, upper=most, rate=0.0, slack=math.inf),
        counters,
    )


def drive_scale(config: DriveConfig) -> Scale:
    """Return the scale of the drive's own positions."""
    return Scale(config.scale, config.sign, config.offset)


def drive_link(
    config: DriveConfig, dictionary: ObjectDictionary, counters: dict[str, int]
) -> Drive:
    """Return the drive as the cycle sees it."""
    return Drive(
        PdoCodec(config.tpdo, dictionary, "drive", receive=False),
        PdoCodec(config.rpdo, dictionary, "drive", receive=True),
        drive_scale(config),
        counters,
    )


def sdo_nodes(
    config: CanopenConfig, dictionaries: dict[str, ObjectDictionary], bus: ConfigurationBus
) -> dict[str, SdoNode]:
    """Return an SDO client for each device, by its name."""
    timeout_s = config.daemon.answer_timeout_ms / 1000
    return {
        name: SdoNode(name, node.node_id, dictionaries[name], bus, str(config.bus), timeout_s)
        for name, node in config.nodes.items()
    }
