"""One cell of the delay study: real slave, link and master on an ideal axis, and a hand."""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Literal

import numpy as np

from teleop_rt.config.link import LinkConfig
from teleop_rt.config.master import CouplingConfig, MasterConfig, Mode
from teleop_rt.config.operator import HandOperator, ProfileOperator
from teleop_rt.config.rig import AxisConfig, Limits, RigConfig, Sensors
from teleop_rt.config.section import Units
from teleop_rt.config.trial import ContactConfig, EstimationConfig, SlaveConfig, TrialConfig
from teleop_rt.master.coupling import make_coupling
from teleop_rt.master.hand import Hand
from teleop_rt.master.master import Master
from teleop_rt.master.operators import Operator
from teleop_rt.realtime.clock import SimulatedClock
from teleop_rt.signals import MASTER, columns
from teleop_rt.slave.faults import State
from teleop_rt.slave.slave import Slave
from teleop_rt.study.delay_hand import MoveAndWait
from teleop_rt.study.delay_plant import (
    FORCE_NOISE_N,
    MATERIALS,
    PERIOD_S,
    RESOLUTION_M,
    SURFACE_M,
    Array,
    EnvironmentName,
    IdealAxis,
)
from teleop_rt.trial.lockstep_run import memory_link
from teleop_rt.trial.sides import make_slave

PERIOD_NS = 1_000_000  # of the shipped rigs: 1 kHz
SETTLING_S, MOVING_S, STILL_S = 2.0, 6.0, 6.0
"""After the press, with the motion by which errors are measured, and at rest."""
FORCE_MAX_N, FORCE_STEP_N, DEVICE_DAMPING = 40.0, 0.5, 20.0
"""The operator's device: its largest force and step of force, and its damping [N s/m]."""
FORCE_CAP_N = 40.0  # of the slave, as much as the device can show

_COLUMN = columns(MASTER)
_RECORDED = ("position", "velocity", "offset", "rendered_force", "reflected_force", "surface")
LAW = "law_force"
"""The newest wall's force at the hand's motion of the same tick; not-a-number without a model."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One point of the study; `gain` is the share of force that a mode without a model reflects."""

    mode: Mode
    environment: EnvironmentName
    round_trip_ms: float
    loss: float
    seed: int
    gain: float = 1.0
    deadband: Literal["noise", "just-noticeable", "none"] = "noise"


@dataclass(slots=True)
class Traces:
    """The results of a cell's run: master's signals by name (n,), truth and counts."""

    cell: Cell
    signals: dict[str, Array]
    intention: list[float]
    onset_tick: int | None
    step_tick: int | None
    still_tick: int | None
    slave_force_max: float
    clamped_stiffness: float | None
    energy_min_J: float
    epsilon_J: float
    adoption_energy_J: float
    master_packets: int
    slave_packets: int
    models_sent: int
    fault: str


def hand_config() -> HandOperator:
    """Return hand and device: the device's own damping is part of the damping."""
    unused = ProfileOperator(
        kind="profile", approach_speed=0.02, mean=0.01, amplitude=0.005, frequency_hz=1.0,
        felt_force=0.5, lift_off_height=0.005,
    )  # fmt: skip
    return HandOperator(
        kind="hand", intention=unused, mass=0.5, stiffness=600.0, damping=10.0 + DEVICE_DAMPING,
        tremor=0.1, reaction_ms=150.0, grip_every_s=2.0, grip_change=0.15,
    )  # fmt: skip


def trial_of(cell: Cell) -> TrialConfig:
    """Return the trial of a cell, on a rig that needs no driver.

    A hand that feels a share of the force presses the tool so much harder: the slave's cap grows
    with it, for the study judges the coupling, not the cap.
    """
    return TrialConfig(
        name="delay",
        rig=RigConfig(
            name="ideal axis",
            units=Units(position="m", force="N"),
            rate_hz=1000,
            sensors=Sensors(position_resolution=RESOLUTION_M, force_noise=FORCE_NOISE_N),
            limits=Limits(
                position_min=-0.2, position_max=0.2, velocity_max=1.5, acceleration_max=60.0,
                force_max=400.0,
            ),
            axis=AxisConfig(driver="none"),
            unsafe_i_know=("watchdog", "force_comparison", "position_comparison"),
        ),
        duration_s=86400.0,
        seed=cell.seed,
        mode=cell.mode,
        coupling=CouplingConfig(force_gain=cell.gain),
        operator=hand_config(),
        contact=ContactConfig(onset_force=0.4, release_force=0.2),
        estimation=EstimationConfig(models=("kelvin-voigt",), forgetting_factor=0.998),
        slave=SlaveConfig(force_cap=FORCE_CAP_N / cell.gain, retreat_speed=0.1),
        master=MasterConfig(
            force_max=FORCE_MAX_N, force_step=FORCE_STEP_N, device_damping=DEVICE_DAMPING,
            offset_speed=0.02,
        ),
        link=LinkConfig(
            round_trip_ms=cell.round_trip_ms, jitter_ms=min(10.0, 0.1 * cell.round_trip_ms),
            loss=cell.loss, loss_burst=3.0 if cell.loss else 1.0, model_deadband=cell.deadband,
        ),
    )  # fmt: skip


class World:
    """Hand, master, link, slave and environment of a cell on one simulated clock."""

    def __init__(
        self,
        cell: Cell,
        slave_of_cell: Callable[..., Slave] = make_slave,
        trial: TrialConfig | None = None,
        operator: Operator | None = None,
    ) -> None:
        self.cell, self.trial = cell, trial or trial_of(cell)
        self.round_trip_s = cell.round_trip_ms * 1e-3
        self.before, self.after = MATERIALS[cell.environment]
        self.clock = SimulatedClock(1_000_000_000)
        ends = memory_link(self.trial, self.clock.now_ns)
        self.slave_end, self.master_end = ends
        rng = np.random.default_rng([cell.seed, 7])
        self.axis = IdealAxis(self.before, self.clock.now_ns, rng)
        self._ring_folder = Path(tempfile.mkdtemp(prefix="teleop-rt-study-"))
        self.slave = slave_of_cell(
            self.trial, self.axis, self.slave_end, self.clock.now_ns, self._ring_folder,
            measure_work=False, log_estimates=False,
        )  # fmt: skip
        stepping_s = self.round_trip_s + SETTLING_S if cell.environment == "step" else 0.0
        self.intention = MoveAndWait(
            self.round_trip_s, self.round_trip_s + SETTLING_S + stepping_s + MOVING_S
        )
        hand = Hand(hand_config(), PERIOD_S, np.random.default_rng([cell.seed, 3]), self.intention)
        self.master = Master(
            self.trial.master, self.trial.rig.limits, PERIOD_NS, operator or hand, self.master_end,
            self.clock.now_ns, make_coupling(cell.mode, self.trial.coupling),
        )  # fmt: skip
        self.tick = 0
        self.onset_tick: int | None = None
        self.step_tick: int | None = None
        self.slave.configure()

    def step(self) -> None:
        """Run one tick of everything."""
        self.clock.move_to(self.clock.now_ns() + PERIOD_NS)
        self.slave.cycle()
        if self.slave.safety.state == State.DISARMED:
            self.slave.arm()
        self.master.cycle()
        self.tick += 1
        if self.onset_tick is None and self.axis.position > SURFACE_M:
            self.onset_tick = self.tick
        felt_s = self.intention.felt_s
        due_s = None if felt_s is None else felt_s + self.round_trip_s + SETTLING_S
        if (
            self.before is not self.after
            and self.step_tick is None
            and due_s is not None
            and self.hand_s >= due_s
        ):
            self.step_tick = self.tick
            self.axis.material = self.after

    def law_force(self) -> float:
        """Return the force of the newest wall at the hand's place and velocity of this tick."""
        if self.cell.mode != "model-mediated":
            return math.nan
        master = self.master
        return master.adoption.newest.force(master.x, master.velocity)

    def close(self) -> None:
        """Release the rings that the slave fills, and remove them."""
        self.slave.close()
        shutil.rmtree(self._ring_folder, ignore_errors=True)

    @property
    def hand_s(self) -> float:
        """The hand's own time, which starts with engagement."""
        return len(self.intention.positions) * PERIOD_S

    @property
    def finished(self) -> bool:
        """Whether the hand has held still for long enough, or found nothing."""
        still_s = self.intention.still_s
        if still_s is None:
            return self.hand_s > self.intention.gave_up_s + self.round_trip_s
        return self.hand_s > still_s + self.round_trip_s + STILL_S


def run_cell(cell: Cell) -> Traces:
    """Run a cell to its end; deterministic for the cell."""
    world = World(cell)
    rows: list[list[float]] = []
    still_tick: int | None = None
    recorded = itemgetter(*(_COLUMN[name] for name in _RECORDED))
    try:
        while not world.finished:
            world.step()
            rows.append([*recorded(world.master.row), world.law_force()])
            if still_tick is None and world.intention.still_s is not None:
                still_tick = world.tick if world.hand_s >= world.intention.still_s else None
    finally:
        world.close()
    table = np.array(rows)
    observer, bound = world.master.observer, world.master.rendered_bound
    return Traces(
        cell=cell,
        signals={name: table[:, column] for column, name in enumerate((*_RECORDED, LAW))},
        intention=world.intention.positions,
        onset_tick=world.onset_tick,
        step_tick=world.step_tick,
        still_tick=still_tick,
        slave_force_max=world.axis.force_max,
        clamped_stiffness=bound.rendered_stiffness if bound.reduced else None,
        energy_min_J=observer.lowest_J,
        epsilon_J=observer.epsilon_J,
        adoption_energy_J=world.master.adoption.energy_J,
        master_packets=world.master_end.statistics.sent,
        slave_packets=world.slave_end.statistics.sent,
        models_sent=world.slave.models_sent,
        fault=world.slave.safety.fault.name,
    )
