"""Run a trial on simulated time: all parts in one process, one tick each, the same every time."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from teleop_rt.axis import EndOfRecording
from teleop_rt.config.trial import TrialConfig
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.keys import KEY_BYTES, shared_key
from teleop_rt.link.transport import MemoryTransport
from teleop_rt.realtime.clock import SimulatedClock
from teleop_rt.realtime.lockstep import Lockstep
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ring_folder import Recorder, describe, new_ring_folder
from teleop_rt.slave.faults import INTERNAL, State
from teleop_rt.slave.slave import Slave
from teleop_rt.trial.bench import OpenBench
from teleop_rt.trial.estimators import recording_metadata
from teleop_rt.trial.event_log import EventLog
from teleop_rt.trial.folder import LOG, RECORDING, TRUTH, write_json
from teleop_rt.trial.master_side import MasterSide, operator_of
from teleop_rt.trial.sides import (
    make_endpoint,
    make_slave,
    merge_outcomes,
    slave_outcome,
)

_START_NS = 1_000_000_000
"""Time at which the simulated clock begins: 0 means never in many stamps."""
_DRAIN_EVERY_STEPS = 200
"""Steps after which rings are written to the recording."""
_SETTLING_TICKS = 50
"""Ticks at the end in which the axis stops, as a daemon's."""


OpenLink = Callable[[TrialConfig, Callable[[], int]], tuple[Endpoint, Endpoint]]
Progress = Callable[[float], None]


def memory_link(trial: TrialConfig, now_ns: Callable[[], int]) -> tuple[Endpoint, Endpoint]:
    """Return the ends of slave and master of a link within one process."""
    to_slave, to_master = MemoryTransport.pair()
    keys = shared_key(bytes(KEY_BYTES))
    return (
        make_endpoint("slave", trial, to_slave, keys, now_ns),
        make_endpoint("master", trial, to_master, keys, now_ns),
    )


class LockstepTrial:
    """Slave, master and devices of a trial on one simulated clock, stepped by hand or run."""

    def __init__(
        self,
        trial: TrialConfig,
        folder: Path,
        open_bench: OpenBench,
        ring_folder: Path,
        open_link: OpenLink | None = None,
    ) -> None:
        """Build everything; `folder` is the trial file's, where its relative paths start.

        `open_link` gives the ends of slave and master, by default ends in memory.
        """
        self.clock = SimulatedClock(_START_NS)
        self.trial = trial
        self.slave_endpoint, self.master_endpoint = (open_link or memory_link)(
            trial, self.clock.now_ns
        )
        self.bench = open_bench(trial, self.clock.now_ns)
        self.slave: Slave = make_slave(
            trial,
            self.bench.axis,
            self.slave_endpoint,
            self.clock.now_ns,
            ring_folder,
            measure_work=False,
        )
        self.master = MasterSide(
            trial,
            operator_of(trial, folder, self.bench.open_device),
            self.master_endpoint,
            self.clock.now_ns,
            ring_folder,
        )
        if self.bench.publish_truth:
            self.bench.publish_truth(ring_folder)
        self.lockstep = Lockstep(self.clock)
        self.lockstep.add(trial.rig.period_ns, self.slave.cycle)
        self.lockstep.add(self.master.period_ns, self.master.cycle)

    def step(self) -> None:
        """Run the next due cycle, and arm the slave as soon as it can be."""
        self.lockstep.step()
        if self.slave.safety.state == State.DISARMED:
            self.slave.arm()

    def finish(self) -> None:
        """Disarm and give the drive the cycles that it needs to switch off."""
        self.slave.disarm()
        for _ in range(_SETTLING_TICKS):
            self.lockstep.step()


def run_lockstep(
    trial: TrialConfig, trial_file: Path, open_bench: OpenBench, folder: Path, progress: Progress
) -> dict[str, Any]:
    """Run a trial into its folder and return the outcome; `progress` gets seconds run.

    Whatever is raised, the axis is stopped, the recording is closed, and it is raised again.
    """
    with new_ring_folder() as ring_folder:
        run = LockstepTrial(trial, trial_file.parent, open_bench, ring_folder)
        metadata = recording_metadata(trial)
        describe(ring_folder, metadata)
        log = EventLog(folder / LOG, simulated=trial.plant is not None)
        recorder = Recorder(
            ring_folder,
            RecordingWriter(folder / RECORDING, trial.rig.units, metadata),
            log.watchers,
        )
        recorder.discover()
        try:
            run.slave.configure()
            interrupted = _steps(run, recorder, log, progress)
        except BaseException:
            run.slave.stop(INTERNAL)
            raise
        finally:
            with ExitStack() as ends:  # each of them, whichever raises
                if (truth := run.bench.truth) is not None:
                    ends.callback(lambda: write_json(folder / TRUTH, truth()))
                ends.callback(log.close)
                ends.callback(recorder.close)
                ends.callback(run.master.let_go)
                ends.callback(run.bench.axis.close)
                ends.callback(run.bench.axis.stop)
        return merge_outcomes(
            "simulated",
            slave_outcome(run.slave, run.slave_endpoint, simulated=trial.plant is not None),
            run.master.outcome(),
            {"dropped": recorder.dropped},
            interrupted=interrupted,
        )


def _steps(run: LockstepTrial, recorder: Recorder, log: EventLog, progress: Progress) -> bool:
    """Step to the duration, the end of the recording, a fault or Ctrl-C; return if it was that."""
    start_ns = run.clock.now_ns()
    end_ns = start_ns + round(run.trial.duration_s * 1e9)
    steps = 0
    try:
        while run.clock.now_ns() < end_ns and run.slave.safety.state != State.FAULT:
            run.step()
            stopped = run.slave.stopped
            log.watch_devices(stopped.said, stopped.stamp_ns, stopped.traceback)
            steps += 1
            if steps % _DRAIN_EVERY_STEPS == 0:
                recorder.drain()
                progress((run.clock.now_ns() - start_ns) * 1e-9)
        run.finish()
    except EndOfRecording:
        run.slave.disarm()
    except KeyboardInterrupt:
        run.slave.disarm()
        return True
    return False
