"""A hand and a handle written apart from the campaign's: 20 kHz, semi-implicit, counts, latency.

Hand, device and dry friction are one mass while it is held; spring and damper are implicit. The
master reads a rounded, old position through `DeviceOperator` and its force acts late, behind a
first-order motor.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from master_world import KEY, PERIOD_NS, IdealSlave, SteppedClock

from teleop_rt.axis import Sample, Timing
from teleop_rt.config.master import MasterConfig
from teleop_rt.config.rig import Limits
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.impairment import ImpairedTransport, Impairment
from teleop_rt.link.keys import shared_key
from teleop_rt.link.transport import MemoryTransport
from teleop_rt.master.device import HeldDevice
from teleop_rt.master.handle_safety import HandleWatch
from teleop_rt.master.master import Master
from teleop_rt.master.passivity import Port

STEP_S = 5e-5
PERIOD_S = PERIOD_NS * 1e-9
SURFACE, END_STOP = 0.0137, 0.21
LIMITS = Limits(
    position_min=-0.2, position_max=0.2, velocity_max=1.5, acceleration_max=60.0, force_max=120.0
)
CONFIG = MasterConfig(force_max=100.0, force_step=0.5, offset_speed=0.02)
LACKS = {"force_comparison": "not simulated", "position_comparison": "not simulated"}


@dataclass(frozen=True)
class Grip:
    """A mass on spring and damper to where it wants to be, or to a force felt late."""

    mass: float
    stiffness: float
    damping: float
    changes: tuple[tuple[float, float], ...] = ()
    reaction_s: float = 0.0
    lets_go_s: float = math.inf


@dataclass(frozen=True)
class Handle:
    damping: float
    sample_age_s: float
    force_delay_s: float = 0.0
    count_m: float = 1e-6
    bandwidth_hz: float = 1000.0
    mass: float = 0.2
    coulomb_N: float = 0.2

    @property
    def timing(self) -> Timing:
        lag_s = 1 / (2 * math.pi * self.bandwidth_hz)
        return Timing(self.sample_age_s, self.force_delay_s + lag_s)


class HeldHandle:
    """Both bodies and the motor; a `Device` for the master. `taken_J`: the motor's energy."""

    def __init__(self, grip: Grip, handle: Handle) -> None:
        self.grip, self.handle, self.timing = grip, handle, handle.timing
        self.x = self.v = self.t = self.goal = self.motor = self.taken_J = 0.0
        self.known, self._command, self._met_s, self._met_at = False, 0.0, math.inf, 0.0
        self._past = _line(handle.sample_age_s)
        self._coming = _line(handle.force_delay_s)
        self._felt = _line(grip.reaction_s)

    def configure(self) -> None: ...

    def arm(self) -> None: ...

    def close(self) -> None: ...

    def stop(self) -> None:
        self._command = 0.0

    def read_into(self, sample: Sample) -> None:
        sample.position = round(self._past[0] / self.handle.count_m) * self.handle.count_m
        sample.valid = sample.enabled = True

    def push(self, force: float) -> None:
        self._command = force

    def advance(self) -> None:
        for _ in range(round(PERIOD_S / STEP_S)):
            self._coming.append(self._command)
            share = 1 - math.exp(-2 * math.pi * self.handle.bandwidth_hz * STEP_S)
            self.motor += share * (self._coming[0] - self.motor)
            self._move()
            self._past.append(self.x)
            self._felt.append(-self.motor)

    def _intend(self) -> float:
        """Move the goal on; return its rate."""
        before = self.goal
        if math.isinf(self._met_s) and self.known and -self.motor > 0.3:
            self._met_s = self.t
            self._met_at = self.goal = before = self.x
        since = self.t - self._met_s
        if math.isinf(self._met_s):
            self.goal = min(self.goal + 0.04 * STEP_S, self.x + 0.01)
        elif self.grip.reaction_s > 0.0:
            wanted = 4.0 + 1.2 * math.sin(2 * math.pi * 0.7 * since)
            self.goal += max(-0.1, min(0.1, 0.004 * (wanted - self._felt[0]))) * STEP_S
        else:
            wave = 0.004 + 0.002 * math.sin(2 * math.pi * 1.3 * since)
            self.goal = self._met_at + min(1.0, since / 0.5) * wave
        return (self.goal - before) / STEP_S

    def _move(self) -> None:
        self.t += STEP_S
        grip, handle, dt = self.grip, self.handle, STEP_S
        share = 1.0
        for at_s, factor in grip.changes:
            share += (factor - share) * max(0.0, min(1.0, (self.t - at_s) / 0.1))
        held = self.t < grip.lets_go_s
        k, b = (share * grip.stiffness, share * grip.damping) if held else (0.0, 0.0)
        mass = handle.mass + (grip.mass if held else 0.0)
        stop = math.copysign(END_STOP, self.x)
        k_stop, b_stop = (2e5, 200.0) if abs(self.x) > END_STOP else (0.0, 0.0)
        rate = self._intend()
        push = self.motor + k * (self.goal - self.x) + b * rate + k_stop * (stop - self.x)
        v = (mass * self.v + dt * push) / (
            mass + dt * (b + handle.damping + b_stop) + dt * dt * (k + k_stop)
        )
        self.v = math.copysign(max(0.0, abs(v) - handle.coulomb_N * dt / mass), v)
        self.x += dt * self.v
        self.taken_J -= self.motor * self.v * dt


def _line(delay_s: float) -> deque[float]:
    length = round(delay_s / STEP_S) + 1
    return deque([0.0] * length, maxlen=length)


def hold(
    grip: Grip, handle: Handle, k: float, b: float, delay_ms: float
) -> tuple[np.ndarray, Master]:
    """Return rows of position, motor's force and energy taken, and the master.

    It knows the device as it is.
    """
    clock = SteppedClock()
    way = Impairment(delay_ns=round(delay_ms * 5e5))
    ends = [
        Endpoint(
            role,
            ImpairedTransport(transport, way, clock, np.random.default_rng(1)),
            shared_key(KEY),
            clock,
            rate_hz=1000,
        )
        for role, transport in zip(("master", "slave"), MemoryTransport.pair(), strict=True)
    ]
    slave = IdealSlave(ends[1], clock, surface=SURFACE, k=k, b=b, model_after=60)
    body = HeldHandle(grip, handle)
    operator = HeldDevice(body, HandleWatch(LIMITS, PERIOD_S, "none", LACKS), PERIOD_S, 30.0)
    port = Port(PERIOD_S, handle.damping, "difference", 30.0, handle.timing.latency_s)
    operator.configure()
    master = Master(CONFIG, LIMITS, PERIOD_NS, operator, ends[0], clock, port=port)
    rows = []
    for _ in range(round((5.0 + 4e-3 * delay_ms) / PERIOD_S)):
        clock.now += PERIOD_NS
        slave.cycle()
        master.cycle()
        body.advance()
        body.known = math.isfinite(master.adoption.newest.surface)
        rows.append((body.x, body.motor, body.taken_J))
    return np.array(rows), master


def swings(x: np.ndarray, force: np.ndarray) -> int:
    """Return the most swings in a row of 3 to 40 Hz, 0.2 mm and 0.5 N that do not decay."""
    turns, way, extreme = [], 0.0, 0
    for i, here in enumerate(x):
        if (here - x[extreme]) * way >= 0.0:
            extreme, way = i, way or float(here != x[extreme])
        elif abs(here - x[extreme]) > 5e-5:
            turns.append(extreme)
            extreme, way = i, -way
    most = row = 0
    before = 0.0
    for a, c in pairwise(turns):
        size, lasts_s = abs(x[c] - x[a]), (c - a) * PERIOD_S
        felt = size > 2e-4 and np.ptp(force[a : c + 1]) > 0.5 and 0.5 / 40 < lasts_s < 0.5 / 3
        row = (row + 1 if size >= 0.95 * before else 1) if felt else 0
        before = size if felt else 0.0
        most = max(most, row)
    return most


def given_back(rows: np.ndarray) -> float:
    """Return the most that the motor gave between two moments without force, springs relaxed."""
    taken = rows[np.abs(rows[:, 1]) < 0.01, 2]
    return float(max((np.maximum.accumulate(taken) - taken).max(), -rows[:, 2].min()))


LOOSE = Grip(0.3, 200.0, 3.0)
GRIPS = {
    "loose": LOOSE,
    "stiff": Grip(1.0, 3000.0, 60.0),
    "heavy": Grip(4.0, 2000.0, 10.0),
    "undamped": Grip(0.3, 300.0, 0.0),
    "changing": Grip(0.5, 600.0, 10.0, changes=((2.0, 0.15), (3.0, 3.0), (4.0, 0.3))),
    "nobody": Grip(0.3, 300.0, 5.0, lets_go_s=2.5),
    "reacts": Grip(0.5, 300.0, 8.0, reaction_s=0.2),
}
HANDLES = {
    "answered at once": Handle(8.0, 0.0003),
    "late, coarse": Handle(12.0, 0.0005, 0.001, count_m=4e-6),
}


SOFT, NEAR_THE_BOUND = ("answered at once", 300.0, 0.0, 0.0), ("late, coarse", 5400.0, 0.0, 0.0)
STIFF, BEYOND = ("answered at once", 15e3, 20.0, 150.0), ("late, coarse", 40e3, 0.0, 20.0)


@pytest.mark.parametrize(
    ("name", "wall"),
    [
        ("loose", SOFT), ("loose", BEYOND), ("stiff", STIFF), ("heavy", BEYOND),
        ("undamped", NEAR_THE_BOUND), ("undamped", BEYOND), ("changing", STIFF),
        ("changing", NEAR_THE_BOUND), ("nobody", BEYOND), ("reacts", STIFF),
    ],
)  # fmt: skip
def test_no_hand_shakes_and_none_is_given_more_than_the_tank(
    name: str, wall: tuple[str, float, float, float]
) -> None:
    handle, k, b, delay_ms = wall
    rows, master = hold(GRIPS[name], HANDLES[handle], k, b, delay_ms)
    assert master.intake.model is not None
    assert master.fault.name == "none"
    assert np.abs(rows[:, 1]).max() > 0.5
    assert swings(rows[:, 0], rows[:, 1]) < 5
    allowed_J = 1e-3 * CONFIG.tank_capacity_mJ + 1e-3 * CONFIG.tank_power_mW * len(rows) * PERIOD_S
    assert given_back(rows) <= allowed_J


def test_five_seconds_of_delay_are_felt_without_shaking() -> None:
    """The link takes three round trips until the slave follows, and the touch a fourth."""
    rows, master = hold(LOOSE, HANDLES["answered at once"], 3600.0, 20.0, 5000.0)
    assert master.intake.model is not None
    assert master.fault.name == "none"
    assert swings(rows[:, 0], rows[:, 1]) < 5


def test_a_device_that_is_worse_than_it_says_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The measure finds its case: a wall far beyond the bound, without the watch."""
    monkeypatch.setattr("teleop_rt.master.shaking.ShakeGuard.update", lambda *_: False)
    monkeypatch.setattr("teleop_rt.master.passivity.PassivityBound.reduce", lambda _, *kb: kb)
    rows, _ = hold(LOOSE, Handle(1.0, 0.002, coulomb_N=0.0), 8000.0, 0.0, 0.0)
    assert swings(rows[:, 0], rows[:, 1]) >= 5
