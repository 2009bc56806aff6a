"""The campaign of faults: a fault that cannot be injected is reported, and ends nothing."""

import json
from subprocess import TimeoutExpired
from types import SimpleNamespace

import pytest

from teleop_rt_dev.campaign import faults as campaign_faults
from teleop_rt_dev.faults import real as real_faults
from teleop_rt_dev.faults.rows import Row


def unplayable(world):
    raise RuntimeError("no such device")


WITHOUT = Row("one without an end", unplayable, lambda world: True, 5, stops=False)
HARMLESS = Row("another", lambda world: None, lambda world: True, 5, stops=False)


@pytest.fixture
def played(monkeypatch, capsys):
    """Play two rows while arming, over two seeds; returns exit code, lines and output."""
    monkeypatch.setattr(campaign_faults, "ROWS", (WITHOUT, HARMLESS))
    monkeypatch.setattr(campaign_faults, "ACTUATOR_ROWS", ())
    words = ["--seeds", "2", "--phases", "arming", "--rows", "one", "another", "--json"]
    code = campaign_faults.main(words)
    out = capsys.readouterr().out
    return code, [json.loads(line) for line in out.splitlines()], out


def test_a_row_that_cannot_be_played_does_not_hold_and_the_others_are_played(played):
    code, (without, harmless, end), _ = played
    assert code == 1
    assert (without["holds"], without["seeds"], without["played"]) == (False, 2, 0)
    why = "not played: RuntimeError: no such device"
    assert without["problem"] == f"seed 1 {why}; seed 2 {why}"
    assert (harmless["fault"], harmless["holds"], harmless["played"]) == ("another", True, 2)
    assert end == {"campaign": "faults", "rows": 2, "failed": 1}


def test_rows_are_chosen_by_texts_and_left_out_by_others(monkeypatch, capsys):
    monkeypatch.setattr(campaign_faults, "ROWS", (WITHOUT, HARMLESS))
    monkeypatch.setattr(campaign_faults, "ACTUATOR_ROWS", ())
    words = ["--seeds", "1", "--phases", "arming", "--rows", "one", "another"]
    code = campaign_faults.main([*words, "--without", "end"])
    assert (code, capsys.readouterr().out) == (0, "1 rows and phases, 0 of them do not hold\n")


def test_a_counted_piece_that_raises_is_a_row_that_does_not_hold():
    def raising():
        raise OSError("no room")

    row = campaign_faults.worked("a soak", raising)
    assert (row["fault"], row["holds"]) == ("a soak", False)
    assert row["problem"] == "not played: OSError: no room"


def test_results_that_were_cut_off_are_still_a_table(played, tmp_path):
    file = tmp_path / "faults.json"
    lines = played[2].splitlines(keepends=True)
    file.write_text(lines[0] + lines[1] + lines[2] + lines[0][:50])
    _, _, without, another = campaign_faults.markdown([file]).splitlines()
    assert without.startswith("| one without an end | 2 | 5 ms |")
    assert "**fails**: seed 1 not played" in without
    assert another == "| another | 2 | 5 ms | 1 ms, 0 N |  |  |  | ARMED |"


class Sides:
    """Three processes in contact, of which the slave ends by itself in some of the trials."""

    ended: list[bool]

    def __init__(self, _folder) -> None:
        self.processes = {"slave": self}

    def wait(self, timeout_s) -> None:
        if not self.ended.pop(0):
            raise TimeoutExpired("slave", timeout_s)

    def moving_in_contact(self) -> bool:
        return True

    def ring(self, name, _topic):
        raise FileNotFoundError(name)

    def close(self) -> None:
        pass


def test_a_trial_that_the_machine_ended_before_its_process_was_killed_is_tried_again(monkeypatch):
    monkeypatch.setattr(real_faults, "Sides", Sides)
    monkeypatch.setattr(real_faults, "time", SimpleNamespace(sleep=lambda _: None))
    Sides.ended = [True] * 6
    row = real_faults.harm("slave killed: recording", 2)
    assert row["problem"] == "only 0 of 2 trials came into contact on this machine"
    Sides.ended = [False]
    with pytest.raises(TimeoutExpired):
        real_faults.harm("slave killed: recording", 1)
