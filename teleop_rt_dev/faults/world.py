"""Slave, master and simulated rig in lock-step, led to a phase of a trial and then harmed."""

from __future__ import annotations

import contextlib
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.service.notify import Notifier
from teleop_rt.slave.faults import State
from teleop_rt.slave.slave import Slave
from teleop_rt.trial.bench import Bench
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt.trial.sides import make_slave
from teleop_rt_dev.paths import SILICONE
from teleop_rt_drivers import opening

PERIOD_NS = 1_000_000  # of the shipped rigs: 1 kHz
Phase = Literal["arming", "approach", "contact", "release"]
PHASES: tuple[Phase, ...] = ("arming", "approach", "contact", "release")
LONGEST_WAY_MS = 8000
"""Simulated time after which an awaited event does not come any more."""
WATCHDOG_MS = 3000
"""As WatchdogSec of the unit in config/systemd."""
"""WatchdogSec of the systemd unit."""
_QUICK = (
    "operator.lift_off_every_s=1.0",
    "link.round_trip_ms=20",
    "link.jitter_ms=2",
)


class HeardByAxis:
    """Passes everything on to the axis, and remembers the last command."""

    def __init__(self, axis: Any) -> None:
        self._axis = axis
        self.last = ""

    def write(self, position: float) -> None:
        self.last = "write"
        self._axis.write(position)

    def stop(self) -> None:
        self.last = "stop"
        self._axis.stop()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._axis, name)


class FaultWorld:
    """One trial of a rig; `tick` runs everything once, unless the daemon is frozen."""

    def __init__(self, ring_folder: Path, rig: str, seed: int, *overrides: str) -> None:
        changes = [f"rig=../rigs/simulated_{rig}.yaml", f"seed={seed}", *_QUICK, *overrides]
        self.ring_folder = ring_folder
        self.trial = load_trial_file(SILICONE, changes)
        self.world = LockstepTrial(self.trial, SILICONE.parent, self._open, ring_folder)
        self.slave, self.master = self.world.slave, self.world.master.master
        self.closing = contextlib.ExitStack()
        self.manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.manager.bind(str(ring_folder / "notify"))
        self.manager.settimeout(0.0)
        watched = {
            "NOTIFY_SOCKET": str(ring_folder / "notify"),
            "WATCHDOG_USEC": str(WATCHDOG_MS * 1000),
        }
        self.notifier = Notifier(PERIOD_NS, watched)
        self.not_fed_ms = 0
        self.frozen = False
        self.skipped = 0
        self.ticks = 0
        self.peak_force = 0.0
        self.states: list[State] = []
        self.kept = SimpleNamespace()
        """Notes of a row when it harms, for its checks afterwards."""

    def _open(self, trial: Any, now_ns: Any) -> Bench:
        axis, self.rig = opening.open_lock_step(trial.rig, trial.plant, now_ns, trial.seed)
        self.axis = HeardByAxis(axis)
        return Bench(self.axis)

    @property
    def state(self) -> State:
        return self.slave.safety.state

    @property
    def fault(self) -> str:
        return self.slave.safety.fault.name

    @property
    def in_contact(self) -> bool:
        return self.slave.contact.in_contact

    @property
    def stopped(self) -> bool:
        """Whether the drive follows nothing and the tool is at rest."""
        return not self.rig.drive.enabled and abs(self.rig.plant.velocity) < 1e-3

    def restarted(self) -> Slave:
        """Return the slave of a daemon that was started again on the same rig."""
        rings = self.ring_folder / "again"
        rings.mkdir()
        now_ns, endpoint = self.world.clock.now_ns, self.world.slave_endpoint
        return make_slave(self.trial, self.axis, endpoint, now_ns, rings, measure_work=False)

    def tick(self) -> None:
        clock = self.world.clock
        clock.move_to(clock.now_ns() + PERIOD_NS)
        self.rig.process()
        if not self.frozen:
            self.slave.cycle(self.skipped)
            self.notifier.tick()
            self.skipped = 0
        self.world.master.cycle()
        self.ticks += 1
        self._listen()
        self.states.append(self.state)
        self.peak_force = max(self.peak_force, abs(self.rig.plant.force))

    def _listen(self) -> None:
        """Hear as systemd hears: how long the daemon has not fed its watchdog."""
        self.not_fed_ms += 1
        with contextlib.suppress(BlockingIOError):
            if self.manager.recv(100) == b"WATCHDOG=1":
                self.not_fed_ms = 0

    def close(self) -> None:
        self.notifier.close()
        self.manager.close()
        self.closing.close()

    def jump(self, milliseconds: int) -> None:
        """The daemon is held up: time goes on for everybody else, its ticks are skipped."""
        self.frozen = True
        for _ in range(milliseconds):
            self.tick()
        self.frozen = False
        self.skipped = milliseconds

    def until(self, done: Any, most: int = LONGEST_WAY_MS) -> int:
        """Tick until `done()`; returns the ticks it took, or -1."""
        for count in range(1, most + 1):
            self.tick()
            if done():
                return count
        return -1

    def lead_to(self, phase: Phase) -> FaultWorld:
        """Configure, arm and go on until the phase."""
        self.slave.configure()
        self.reach(lambda: self.state is State.DISARMED)
        assert self.slave.arm()
        if phase == "arming":
            self.until(lambda: True)
            assert self.state is State.ARMED
            return self._from_here()
        self.reach(lambda: self.state is State.RUN and self.rig.plant.position > 0.002)
        if phase == "approach":
            return self._from_here()
        self.reach(lambda: self.in_contact and self.rig.plant.force > 20)
        if phase == "release":
            self.reach(lambda: not self.in_contact)
        return self._from_here()

    def reach(self, done: Any) -> None:
        assert self.until(done) > 0, f"never got there: {self.state.name}, {self.fault}"

    def _from_here(self) -> FaultWorld:
        self.ticks = 0
        self.peak_force = 0.0
        self.states.clear()
        return self
