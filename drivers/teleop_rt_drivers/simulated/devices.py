"""The three devices of the rig: the meaning of their objects in terms of the plant."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt_drivers.simulated.answer import FORCES, INT16, INT32, PLACES, SPEEDS
from teleop_rt_drivers.simulated.device import Node
from teleop_rt_drivers.simulated.senses import clamped

if TYPE_CHECKING:
    from teleop_rt_drivers.canopen.node_config import NodeConfig
    from teleop_rt_drivers.simulated.device import Send
    from teleop_rt_drivers.simulated.plant import Plant

SPEED_STEP = 1e-5
"""Speed step of the encoder [rig unit/s]: 0.01 mm/s on a linear rig."""
POSITION_STEP_UNIT = 1e-9
"""Unit of object 6005h:1 [rig unit]: 0.001 um on a linear rig."""


class Encoder(Node):
    """CiA 406 linear encoder: position and speed."""

    def __init__(self, node: NodeConfig, send: Send, plant: Plant) -> None:
        sensors = plant.config.sensors
        resolution = sensors.encoder_resolution
        super().__init__(
            "encoder",
            node.node_id,
            node.eds,
            send,
            {
                (0x6004, 0): lambda: clamped(plant.encoder_counts, INT32),
                (0x6030, 1): lambda: clamped(plant.velocity / SPEED_STEP, INT16),
                (0x6503, 0): lambda: 0,
                (0x6005, 1): lambda: round(resolution / POSITION_STEP_UNIT),
            },
        )
        self.measured[0x6004, 0] = PLACES, sensors.encoder_zero, resolution
        self.measured[0x6030, 1] = SPEEDS, 0.0, SPEED_STEP


class ForceSensor(Node):
    """CiA 404 measuring device: one force, as an integer with the EDS's decimal digits."""

    def __init__(self, node: NodeConfig, send: Send, plant: Plant) -> None:
        super().__init__(
            "force sensor",
            node.node_id,
            node.eds,
            send,
            {
                (0x6130, 1): plant.measured_force,
                (0x9130, 1): lambda: clamped(plant.measured_force() * self._per_unit, INT32),
                (0x6150, 1): lambda: 0,
            },
        )
        self._per_unit = 10 ** self.value(0x6132, 1)
        self.measured[0x6130, 1] = None
        self.measured[0x9130, 1] = FORCES, 0.0, self._per_unit
