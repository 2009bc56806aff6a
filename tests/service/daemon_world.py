"""A daemon on simulated time: the shipped trial in lock-step, commanded as by its server."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.realtime.histogram import TimingHistograms
from teleop_rt.service.connections import Answer, Answering
from teleop_rt.service.daemon import Daemon
from teleop_rt.service.notify import Notifier
from teleop_rt.service.server import CommandServer
from teleop_rt.slave.faults import State
from teleop_rt.trial.bench import Bench
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_drivers import opening

SILICONE = Path(__file__).parents[2] / "config" / "trials" / "silicone_cube.yaml"


class StepClock:
    """The clock of a loop that steps the world at each tick."""

    wake_latency_ns = 0

    def __init__(self, world: DaemonWorld) -> None:
        self._world = world

    def now_ns(self) -> int:
        return self._world.trial.clock.now_ns()

    def wait_next_tick(self) -> int:
        self._world.step_others()
        return 0


class Asked:
    """A request under way: as many steps as ticks, whatever else the machine does."""

    def __init__(self, answering: Answering) -> None:
        self._answering = answering
        self._answer: Answer | None = None

    def step(self) -> bool:
        """Let the server go on; true once it has answered."""
        if self._answer is None:
            try:
                next(self._answering)
            except StopIteration as done:
                self._answer = done.value
        return self._answer is not None

    def result(self) -> Answer:
        """Return the answer, which takes no more ticks."""
        while not self.step():
            pass
        assert self._answer is not None
        return self._answer


class DaemonWorld:
    """Slave daemon, master and simulated rig, stepped together."""

    def __init__(self, ring_folder: Path, environment: dict[str, str] | None = None) -> None:
        self.ring_folder = ring_folder
        self.trial = LockstepTrial(
            load_trial_file(SILICONE, ["link.round_trip_ms=0", "link.loss=0", "link.jitter_ms=0"]),
            SILICONE.parent,
            self._open,
            ring_folder,
        )
        self.slave = self.trial.slave
        # As its process would be timed, and no sooner armed than by a command.
        self.slave._measure_work = True
        notifier = Notifier(self.trial.trial.rig.period_ns, environment or {})
        histograms = TimingHistograms(ring_folder, create=True)
        self.daemon = Daemon(self.slave, ring_folder, notifier, histograms)
        self.server = CommandServer(ring_folder)
        (ring_folder / "daemon.json").write_text(
            '{"trial_file": "t.yaml", "overrides": [], "rig": "r", "trial": "t"}'
        )
        self.slave.configure()

    def _open(self, trial: Any, now_ns: Any) -> Bench:
        axis, self.rig = opening.open_lock_step(trial.rig, trial.plant, now_ns, trial.seed)
        return Bench(axis)

    def step_others(self) -> None:
        """Move time by a tick and let the master run; the slave's cycle is the daemon's."""
        clock = self.trial.clock
        clock.move_to(clock.now_ns() + self.trial.trial.rig.period_ns)
        self.trial.master.cycle()

    def ticks(self, count: int) -> State:
        for _ in range(count):
            self.step_others()
            self.daemon.cycle(0, 20_000)
        return self.slave.safety.state

    def until(self, state: State) -> None:
        for _ in range(5000):
            if self.ticks(1) is state:
                return
        raise AssertionError(f"never came to {state.name}")

    def ask(self, command: str) -> dict[str, Any]:
        """Ask the server, which looks after the request once in each tick of the loop."""
        request = f'{{"command": "{command}"}}'.encode()
        asked = Asked(self.server.handle(request))
        if command == "reset":
            self.daemon.serve(lambda: StepClock(self), asked.step)
        else:
            while not asked.step() and self.daemon._leave_for.name != "RELOAD":
                self.ticks(1)
        return asked.result()
