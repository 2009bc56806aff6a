"""How a run of processes ends: a signal after its end does not interrupt it."""

import errno
import json
import selectors
import signal

import pytest

from teleop_rt.config.loader import load_trial
from teleop_rt.interrupts import Interrupts
from teleop_rt.trial import run_processes as module
from teleop_rt.trial.processes import Child, ProcessFailedError, TrialProcesses
from teleop_rt_dev.trial.files import SILICONE
from teleop_rt_drivers import registry


class Ending:
    """A processes whose trial ends in this way; Ctrl-C comes while its processes are ended."""

    def __init__(self, end) -> None:
        self._end = end
        self.ended = []

    def start(self, name, _main):
        return Child(name, None, {"ready": {"privileges": [f"{name}: refused (no); ask"]}})

    def wait_ready(self, *_children):
        """Wait for nobody."""

    def run_until(self, _done):
        if self._end is not None:
            raise self._end

    def end(self, names):
        signal.raise_signal(signal.SIGINT)
        self.ended += names


@pytest.mark.parametrize("end", [None, ProcessFailedError("slave: gone", 1), KeyboardInterrupt()])
def test_an_interrupt_while_the_processes_are_ended_loses_neither_outcome_nor_failure(end):
    trial = load_trial(SILICONE, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS)
    processes = Ending(end)
    with Interrupts() as interrupts:
        outcome, failure = module.run_to_end(
            trial, processes, Child("recorder", None), print, lambda _: None, interrupts.hold
        )
    at_once = ["master"] if end is None else []  # in good order: nobody leads it any more
    assert processes.ended == [*at_once, "slave", "master", "sim", "recorder"]
    assert outcome["clock"] == "real"
    assert outcome["privileges"] == ["slave: refused (no); ask"]
    assert failure is (end if isinstance(end, ProcessFailedError) else None)


class EndingAtTheFirstTick(Ending):
    """A processes to whom Ctrl-C comes while the slave's word that it is ready is on its way."""

    def __init__(self, *, ready) -> None:
        super().__init__(None)
        self._ready = ready

    def start(self, name, _main):
        self.slave = Child(name, None)
        return self.slave

    def wait_ready(self, *children):
        if self.slave in children:
            if self._ready:
                self.slave.events["ready"] = {"privileges": []}
            raise KeyboardInterrupt


def test_an_interrupt_between_the_first_tick_and_the_word_of_it_ends_a_trial_that_began():
    trial = load_trial(SILICONE, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS)
    given = (Child("recorder", None), print, lambda _: None)
    with Interrupts() as interrupts:
        outcome, failure = module.run_to_end(
            trial, EndingAtTheFirstTick(ready=True), *given, interrupts.hold
        )
    assert (outcome["interrupted"], failure) == (True, None)
    with Interrupts() as interrupts, pytest.raises(KeyboardInterrupt):
        module.run_to_end(trial, EndingAtTheFirstTick(ready=False), *given, interrupts.hold)


def test_the_truth_of_a_run_has_what_each_process_simulated(tmp_path):
    master = Child("master", None, {"truth": {"handle": {"energy_J": 1.5}}})
    module.complete_truth(tmp_path, [Child("sim", None), master])
    assert not list(tmp_path.iterdir())
    (tmp_path / "truth.json").write_text('{"environment": {"stiffness": 3600.0}}')
    module.complete_truth(tmp_path, [Child("sim", None), master])
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth == {"environment": {"stiffness": 3600.0}, "handle": {"energy_J": 1.5}}


def test_an_interrupt_while_the_compiler_is_loaded_waits_until_it_is_whole(monkeypatch):
    loaded = []

    def load():
        signal.raise_signal(signal.SIGTERM)
        loaded.append("whole")

    monkeypatch.setattr(module, "load_compiler", load)
    with Interrupts(), pytest.raises(KeyboardInterrupt), module.prepared_to_fork():
        pytest.fail("an interrupted run starts no process")
    assert loaded == ["whole"]


def test_processes_that_cannot_be_watched_leave_no_log_open(tmp_path, monkeypatch):
    def refused() -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(selectors, "DefaultSelector", refused)
    with pytest.raises(OSError, match="Too many open files"):
        TrialProcesses(tmp_path / "log.jsonl")
    assert not (tmp_path / "log.jsonl").exists()
