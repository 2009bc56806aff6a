"""A daemon that begins again with another config: refusals and faults."""

from contextlib import contextmanager

import pytest

from teleop_rt.axis import AxisError
from teleop_rt.cli import side_mains
from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.link.keys import KeyFileError, shared_key
from teleop_rt.service.daemon import Daemon
from teleop_rt.trial import process_main
from teleop_rt.trial.side import Side
from teleop_rt_dev.paths import SILICONE
from teleop_rt_drivers import opening


class Rounds:
    """A slave without clock and processes, whose loop ends as configured, round by round."""

    def __init__(self, folder) -> None:
        self.folder = folder
        self.opened, self.loops = [], []
        """Results of opening the axis and running the loop, one per round: raised or returned."""
        self.given, self.ran, self.armed, self.told = [], [], [], []
        self.taken: list[str] = []
        """The machine's privileges, and the beginning of each round."""

    def run(self, *, arm: bool = False) -> None:
        side_mains.run_slave(SILICONE, self.folder, None, self.folder, arm=arm, as_json=False)

    @contextmanager
    def side(self, _name, trial_file, *_where, as_json, trial):
        self.given.append(trial)
        self.taken.append("begins")
        ring_folder = self.folder / str(len(self.given))
        ring_folder.mkdir()
        emit = lambda event, **_: self.told.append(event)  # noqa: E731
        self.ran.append(trial or load_trial_file(trial_file, None))
        yield Side(self.ran[-1], ring_folder, ring_folder, emit, None)

    def prepare(self, *_, **__) -> list:
        self.taken.append("prepared")
        return []

    def remember(self):
        return lambda: self.taken.append("given back")

    def open_axis(self, rig, now_ns):
        refused = self.opened.pop(0)
        if refused is not None:
            raise refused
        trial = load_trial_file(SILICONE, None)
        return opening.open_lock_step(rig, trial.plant, now_ns, trial.seed)[0]

    def loop(self, daemon):
        self.armed.append(daemon.arm_at_once)
        end = self.loops.pop(0)
        if isinstance(end, Exception):
            raise end
        return end


@pytest.fixture
def rounds(tmp_path, monkeypatch):
    one = Rounds(tmp_path)
    monkeypatch.setattr(side_mains, "_side", one.side)
    monkeypatch.setattr(side_mains, "StopRequest", lambda: lambda: False)
    monkeypatch.setattr(side_mains, "load_keys", lambda _: shared_key(bytes(32)))
    monkeypatch.setattr(opening, "open_axis", one.open_axis)
    monkeypatch.setattr(process_main, "prepare_process", one.prepare)
    monkeypatch.setattr(process_main, "remember_process", one.remember)
    monkeypatch.setattr(Daemon, "run", lambda daemon, *_: one.loop(daemon))
    return one


def test_a_config_that_is_refused_before_its_loop_gives_way_to_the_one_before(rounds, capsys):
    rounds.opened = [None, AxisError("no answer from the encoder"), None]
    rounds.loops = [True, False]
    rounds.run()
    assert rounds.given[:2] == [None, None]
    assert rounds.given[2] is rounds.ran[0]
    refused = "was refused, the one before runs: no answer from the encoder"
    assert f"{refused}: correct the file and reload again" in capsys.readouterr().err


def test_what_any_part_refuses_before_the_loop_gives_way_to_the_one_before(rounds):
    rounds.opened = [None, KeyFileError("link.key: is readable by others"), None]
    rounds.loops = [True, False]
    rounds.run()
    assert rounds.given[2] is rounds.ran[0]


def test_what_goes_wrong_in_the_loop_of_a_reloaded_config_is_no_refusal_of_it(rounds, capsys):
    rounds.opened = [None, None]
    rounds.loops = [True, AxisError("the bus has gone")]
    with pytest.raises(AxisError, match="the bus has gone"):
        rounds.run()
    assert rounds.given == [None, None]
    assert rounds.told.count("ready") == 2
    assert "refused" not in capsys.readouterr().err


def test_a_config_that_is_refused_twice_ends_the_daemon(rounds):
    rounds.opened = [None, AxisError("no answer"), AxisError("nobody answers")]
    rounds.loops = [True]
    with pytest.raises(AxisError, match="nobody answers"):
        rounds.run()


def test_a_slave_that_armed_at_once_is_disarmed_after_a_reload(rounds):
    rounds.opened = [None, None]
    rounds.loops = [True, False]
    rounds.run(arm=True)
    assert rounds.armed == [True, False]


def test_recorder_and_server_of_the_next_config_are_not_started_with_the_loops_priority(rounds):
    rounds.opened = [None, AxisError("no answer"), None]
    rounds.loops = [True, False]
    rounds.run()
    assert rounds.taken == [
        *("begins", "prepared", "given back"),
        *("begins", "given back"),
        *("begins", "prepared", "given back"),
    ]
