"""The position loop of a drive in torque mode, over a stall of the loop that closes it."""

from dataclasses import dataclass

import pytest

from teleop_rt_drivers.canopen.drive_config import TorqueConfig
from teleop_rt_drivers.canopen.position_loop import PositionLoop

PERIOD_NS = 1_000_000
CONFIG = TorqueConfig(rated_force=200.0, stiffness=0.001, damping=100.0)


@dataclass
class Encoder:
    """The encoder's channel as seen by the loop."""

    value: float = 0.0
    stamp_ns: int = 10**12

    def at(self, tick: int, velocity: float) -> None:
        self.stamp_ns = 10**12 + tick * PERIOD_NS
        self.value = velocity * tick * 1e-3


@pytest.mark.parametrize("stall", [0, 1, 8, 15])
def test_a_stall_makes_a_moving_tool_no_faster(stall):
    encoder = Encoder()
    loop = PositionLoop(CONFIG, encoder, PERIOD_NS * 1e-9, force_max=500.0)
    for tick in [*range(10), *range(10 + stall, 20 + stall)]:
        encoder.at(tick, velocity=0.2)
        force = loop.update(0.0)
        if tick >= 4:
            assert force == pytest.approx(-20.0, rel=0.01)
