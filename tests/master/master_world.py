"""A lock-step world around the master: a stepped clock, a bad network and an ideal slave."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from teleop_rt.config.master import MasterConfig
from teleop_rt.config.rig import Limits
from teleop_rt.contact.effect import Effect
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.impairment import ImpairedTransport, Impairment
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import ModelEffect, ModelMessage, StateMessage
from teleop_rt.link.transport import MemoryTransport
from teleop_rt.master.master import Master
from teleop_rt.master.operators import Operator

KEY = bytes(range(32))
PERIOD_NS = 1_000_000
HOLD_AFTER_NS = 100_000_000
LIMITS = Limits(
    position_min=-0.06,
    position_max=0.06,
    velocity_max=1.5,
    acceleration_max=60.0,
    force_max=120.0,
)
CONFIG = MasterConfig(
    force_max=100.0, force_step=0.5, device_damping=30.0, offset_speed=0.02, tank_power_mW=5.0
)
PERFECT = Impairment()


class SteppedClock:
    def __init__(self) -> None:
        self.now = 1_000_000_000

    def __call__(self) -> int:
        return self.now


@dataclass
class IdealSlave:
    """Follows the target exactly, measures without noise and knows the law of its wall.

    The model goes out `model_after` ticks after a contact began, and every 50 ms from then on.
    """

    endpoint: Endpoint
    now_ns: Callable[[], int]
    surface: float = 0.0137
    k: float = 3600.0
    b: float = 20.0
    model_after: int = 0
    muted: bool = False
    position: float = 0.0
    velocity: float = 0.0
    contact_id: int = 0
    in_contact: bool = False
    ticks_in_contact: int = 0
    known_surface: float = math.nan
    verified_free: float = -0.06
    model: ModelMessage | None = None
    tick: int = 0
    forces: list[float] = field(default_factory=list)
    effects: tuple[ModelEffect, ...] = ()
    hold_at: float = math.inf

    def force(self) -> float:
        x = self.position - self.surface
        return max(0.0, self.k * x + self.b * self.velocity) if x > 0 else 0.0

    def cycle(self) -> None:
        self.tick += 1
        self.endpoint.poll()
        motion = self.endpoint.motion
        target = self.position
        silence_ns = self.endpoint.silence_ns(self.now_ns())
        following = motion is not None and motion.engaged and silence_ns < HOLD_AFTER_NS
        if following:
            target = motion.target
            acknowledged = motion.contact_id >= self.contact_id
            expected = motion.wall and abs(motion.surface - self.surface) < 1e-3
            if self.in_contact and not acknowledged and not expected:
                target = min(target, self.position)
            target = min(target, self.hold_at)
        self.velocity = (target - self.position) / (PERIOD_NS * 1e-9)
        self.position = target
        self._touch()
        if self.muted:
            return
        self.forces.append(self.force())
        self.endpoint.send(
            StateMessage(
                self.position,
                self.force(),
                self.contact_id,
                self.in_contact,
                following=following,
                verified_free=self.verified_free,
            )
        )
        self._stream()

    def _touch(self) -> None:
        touching = self.position > self.surface
        self.contact_id += touching and not self.in_contact
        self.ticks_in_contact = self.ticks_in_contact + 1 if touching else 0
        self.in_contact = touching
        if not touching:
            self.verified_free = max(self.verified_free, self.position)

    def _stream(self) -> None:
        due = self.ticks_in_contact == self.model_after + 1
        if due:
            self.model = ModelMessage(
                "kelvin-voigt", self.contact_id, self.contact_id, self.surface, k=self.k, b=self.b,
                effects=self.effects,
            )  # fmt: skip
        if self.model is not None and (due or self.tick % 50 == 0):
            self.endpoint.send(self.model)


class World:
    """Master and ideal slave at 1 kHz, stepped together; the master's rate is a multiple of it."""

    def __init__(
        self,
        operator: Operator,
        *,
        config: MasterConfig = CONFIG,
        there: Impairment = PERFECT,
        back: Impairment | None = None,
        seed: int = 0,
        library: Sequence[Effect] = (),
        rate_hz: int = 1000,
        slave_key: bytes = KEY,
        **slave: Any,
    ) -> None:
        self.clock = SteppedClock()
        self.period_ns = 1_000_000_000 // rate_hz
        rng = np.random.default_rng(seed)
        near, far = MemoryTransport.pair()
        to_slave = ImpairedTransport(near, there, self.clock, rng)
        to_master = ImpairedTransport(far, there if back is None else back, self.clock, rng)
        ends = {
            role: Endpoint(role, transport, shared_key(key), self.clock, rate_hz=1000)
            for role, transport, key in (("master", to_slave, KEY), ("slave", to_master, slave_key))
        }
        self.slave = IdealSlave(ends["slave"], self.clock, **slave)
        self.master = Master(
            config, LIMITS, self.period_ns, operator, ends["master"], self.clock, effects=library
        )

    def step(self) -> None:
        self.clock.now += self.period_ns
        if self.clock.now % PERIOD_NS == 0:
            self.slave.cycle()
        self.master.cycle()

    def run(self, ticks: int) -> np.ndarray:
        """Return the master's rows of so many ticks."""
        rows = np.empty((ticks, len(self.master.row)))
        for row in rows:
            self.step()
            row[:] = self.master.row
        return rows
