"""Ctrl-C in a trial of `close-loop`: the recording so far is kept, and nothing further is run."""

from __future__ import annotations

import json
import signal
from contextlib import suppress

import pytest

from teleop_rt.cli import whole_run
from teleop_rt.interrupts import interrupt
from teleop_rt.offline import closing, closing_command
from teleop_rt_dev.trial.files import TRIALS

CLOSE_LOOP = ("close-loop", TRIALS / "stiffening_foam.yaml", "--clock", "simulated", "--out")


class InterruptedView:
    """A terminal at which Ctrl-C is pressed at the first report of progress."""

    def __init__(self, *_given: object) -> None:
        self._came = False

    def __enter__(self) -> InterruptedView:
        return self

    def __exit__(self, *_error: object) -> None:
        pass

    def __call__(self, _seconds: float) -> None:
        if not self._came:
            self._came = True
            signal.raise_signal(signal.SIGINT)


@pytest.fixture
def begun(monkeypatch):
    """Let Ctrl-C come in the first trial; return the folders of the trials that were begun."""
    folders, run = [], whole_run.run_lockstep

    def run_noted(trial, trial_file, bench, folder, progress):
        folders.append(folder.name)
        return run(trial, trial_file, bench, folder, progress)

    monkeypatch.setattr(whole_run, "RunView", InterruptedView)
    monkeypatch.setattr(whole_run, "run_lockstep", run_noted)
    return folders


def test_an_interrupted_trial_ends_close_loop_and_keeps_its_recording(
    call, tmp_path, begun, monkeypatch
):
    diagnosed = []
    monkeypatch.setattr(closing, "diagnose", diagnosed.append)
    before = signal.getsignal(signal.SIGINT)
    out = tmp_path / "loop"
    code, text, said = call(*CLOSE_LOOP, out)
    assert (code, text, begun, diagnosed) == (130, "", ["first"], [])
    assert f"{out / 'first'} keeps the recording so far; nothing further is run" in said
    summary = json.loads((out / "first" / "summary.json").read_text())
    assert summary["interrupted"] is True
    assert 0 < summary["ticks"] < 20_000
    assert (out / "first" / "recording.mcap").stat().st_size > 0
    assert not (out / "loop.json").exists()
    assert signal.getsignal(signal.SIGINT) == before


@pytest.mark.parametrize("moment", ["summarise", "_report"])
def test_an_interrupt_while_a_trials_results_are_written_ends_close_loop(
    call, tmp_path, monkeypatch, moment
):
    """The trial is whole and its files are finished, but the next trial is not begun."""
    runs, diagnosed = [], []
    write, run = getattr(whole_run, moment), whole_run.run_lockstep

    def write_and_press(*given):
        signal.raise_signal(signal.SIGINT)
        return write(*given)

    def run_shortly(trial, *given):
        runs.append(given[2].name)
        return run(trial.model_copy(update={"duration_s": 1.0}), *given)

    monkeypatch.setattr(whole_run, moment, write_and_press)
    monkeypatch.setattr(whole_run, "run_lockstep", run_shortly)
    monkeypatch.setattr(closing, "diagnose", diagnosed.append)
    out = tmp_path / "loop"
    code, text, said = call(*CLOSE_LOOP, out)
    assert (code, text, runs, diagnosed) == (130, "", ["first"], [])
    assert f"{out / 'first'} keeps the recording so far; nothing further is run" in said
    assert json.loads((out / "first" / "summary.json").read_text())["interrupted"] is False
    assert not (out / "loop.json").exists()


def test_an_interrupt_that_compiled_code_loses_ends_close_loop_before_the_next_trial(
    call, tmp_path, monkeypatch
):
    runs = []

    def close_loop(_trial, _base, run, _library, out, _keep):
        run([], out / "first")
        with suppress(KeyboardInterrupt):  # as a call from the compiler into Python does
            signal.raise_signal(signal.SIGINT)
        run([], out / "before")
        return {}

    def run_in(_trial_file, _changes, _clock, into):
        runs.append(into.name)
        return {}

    monkeypatch.setattr(closing_command, "close_loop", close_loop)
    monkeypatch.setattr(whole_run, "run_in", run_in)
    before = signal.signal(signal.SIGINT, interrupt)  # as the program sets it
    try:
        code, _, _ = call(*CLOSE_LOOP, tmp_path / "loop")
    finally:
        signal.signal(signal.SIGINT, before)
    assert (code, runs) == (130, ["first"])


class InterruptedAtOnce(InterruptedView):
    """A terminal at which Ctrl-C is pressed before anything has moved."""

    def __enter__(self) -> InterruptedView:
        signal.raise_signal(signal.SIGINT)
        return self


@pytest.mark.parametrize("there_before", [False, True])
def test_an_interrupt_before_the_first_tick_is_reported_and_leaves_no_folder(
    call, tmp_path, monkeypatch, there_before
):
    monkeypatch.setattr(whole_run, "RunView", InterruptedAtOnce)
    out = tmp_path / "loop"
    if there_before:
        out.mkdir()
    code, text, said = call(*CLOSE_LOOP, out)
    assert (code, text) == (130, "")
    assert "interrupted before the trial began; nothing further is run" in said
    assert list(tmp_path.rglob("*")) == [out] * there_before
