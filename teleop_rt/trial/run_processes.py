"""A run on the machine's clock: its processes, their order, and the files they leave."""

from __future__ import annotations

import gc
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial, reduce
from operator import or_
from pathlib import Path
from typing import Any, Protocol

from teleop_rt.config.trial import TrialConfig
from teleop_rt.interrupts import deferred_interrupts
from teleop_rt.kernels.jit import load_compiler
from teleop_rt.link.keys import generate_key
from teleop_rt.realtime.leftovers import began_ns
from teleop_rt.realtime.ring_folder import describe, new_ring_folder
from teleop_rt.service.place import claimed, refuse_commands
from teleop_rt.trial.estimators import recording_metadata
from teleop_rt.trial.folder import LOG, TRUTH, date_of, write_json
from teleop_rt.trial.processes import Child, Gate, ProcessFailedError, TrialProcesses
from teleop_rt.trial.recorder_main import main as record
from teleop_rt.trial.sides import merge_outcomes

_STOPPING_ORDER = ("slave", "master", "sim", "recorder")


class RunSide(Protocol):
    """Be one side of a run, `slave`, `master` or `sim`, in this process until it is ended."""

    def __call__(
        self, name: str, folder: Path, ring_folder: Path, key: Path, others: Callable[[], None]
    ) -> None:
        """Write into the run's folder, make rings in its ring folder, and seal packets by its key.

        `others` waits until the parts that this side relies on are ready; slow work comes before.
        """


def run_processes(
    trial: TrialConfig,
    run_side: RunSide,
    folder: Path,
    progress: Callable[[float], None],
    reached_by: Sequence[str] = (),
    over: Callable[[], None] = lambda: None,
) -> tuple[dict[str, Any], ProcessFailedError | None]:
    """Run a trial as separate processes into its folder; return the outcome and the failure.

    All processes start at once. The slave opens its axis when recorder, master and rig (if it is
    simulated) are ready, and its first tick begins the trial. At the end, also after Ctrl-C, slave,
    master, rig and recorder stop in this order.
    `reached_by` are the rig's buses and ports; `over` is called at the end of the trial, whatever
    its cause: from then on nothing may interrupt. Raises ProcessFailedError where a process cannot
    start, BusyError where the rig is in use.
    """
    with new_ring_folder() as ring_folder, claimed(trial.rig.name, reached_by, ring_folder):
        refuse_commands(ring_folder)
        key = Path(trial.link.key_file) if trial.link.key_file else ring_folder / "link.key"
        if trial.link.key_file is None:
            generate_key(key)
        describe(ring_folder, recording_metadata(trial, date_of()))
        processes = TrialProcesses(folder / LOG, "slave", trial.rig.realtime.cpu)
        try:
            side = partial(run_side, folder=folder, ring_folder=ring_folder, key=key)
            with prepared_to_fork():
                recorder = processes.fork_kept(
                    "recorder", ring_folder, record, [str(ring_folder), str(folder)]
                )
                ended = run_to_end(trial, processes, recorder, side, progress, over)
            complete_truth(folder, processes.children)
            return ended
        finally:
            processes.end(_STOPPING_ORDER)
            processes.close()


def complete_truth(folder: Path, children: Sequence[Child]) -> None:
    """Add the truth of other processes to the rig's: that of the operator's device.

    A disk that takes no more of it refuses the summary, too, and that is reported.
    """
    path = folder / TRUTH
    others = [child.events["truth"] for child in children if "truth" in child.events]
    if others and path.is_file():
        with suppress(OSError):
            truth = json.loads(path.read_text(encoding="utf-8"))
            write_json(path, reduce(or_, others, truth))


@contextmanager
def prepared_to_fork() -> Iterator[None]:
    """Load the modules of all sides once, and keep collections from copying shared memory."""
    with deferred_interrupts():  # the compiler would be left half loaded
        load_compiler()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def run_to_end(
    trial: TrialConfig,
    processes: TrialProcesses,
    recorder: Child,
    side: Callable[..., None],
    progress: Callable[[float], None],
    over: Callable[[], None],
) -> tuple[dict[str, Any], ProcessFailedError | None]:
    """Start the sides, wait for their end, and end those that have not ended by themselves.

    Returns the outcome, and the failure of a process that ended the trial early.
    """
    first = [recorder]
    if trial.plant is not None:
        first.append(processes.start("sim", partial(side, "sim", others=_none)))
    first.append(master := processes.start("master", partial(side, "master", others=_none)))
    with closing(Gate()) as gate:
        slave = processes.start("slave", partial(side, "slave", others=gate.wait))
        processes.wait_ready(*first)
        gate.open()
    failure: ProcessFailedError | None = None
    interrupted = False
    try:
        try:
            processes.wait_ready(slave)
            _watch(processes, slave, progress)
        finally:
            over()
        # At once: without a slave it would freeze and declutch while the slave's process ends.
        processes.end(["master"])
        processes.run_until(lambda: slave.ended)
    except ProcessFailedError as error:
        failure = error
    except KeyboardInterrupt:
        interrupted = True
    processes.end(_STOPPING_ORDER)
    if "ready" not in slave.events:  # it has not ticked, and an interrupt has no trial to end
        raise failure or KeyboardInterrupt
    return outcome_of(slave, master, recorder, interrupted=interrupted), failure


def _none() -> None:
    """Wait for nobody."""


def _watch(processes: TrialProcesses, slave: Child, progress: Callable[[float], None]) -> None:
    start = time.monotonic()

    def done() -> bool:
        progress(time.monotonic() - start)
        return slave.ended or "done" in slave.events

    processes.run_until(done)


def outcome_of(
    slave: Child, master: Child, recorder: Child, *, interrupted: bool
) -> dict[str, Any]:
    """Put the counts of the processes together; a process that died has counted nothing."""
    counts = ("sent", "received", "lost", "overtaken", "rejected", "round_trip_ms")
    nothing = dict.fromkeys(counts)
    died = {
        "code": None,
        "name": "process_died",
        "cause": "the slave's process ended before it could report its outcome",
        "next_step": "read log.jsonl, and the output of the run",
    }
    slave_done = slave.events.get(
        "done", {"link": nothing, "safety": {"state": "UNKNOWN", "fault": died}}
    )
    return merge_outcomes(
        "real",
        slave_done,
        master.events.get("done", {"link": nothing}),
        recorder.events.get("done", {"dropped": None}),
        slave.events.get("ready", {}).get("privileges", ()),
        began_ns(os.getpid()),
        interrupted=interrupted,
    )
