"""The last line of a command that a fault has ended."""

import gc
from contextlib import nullcontext
from pathlib import Path

import pytest
import typer

from teleop_rt.cli import side_mains
from teleop_rt.cli.leaving import leave_on_fault
from teleop_rt.slave.faults import FAULTS, NO_FAULT
from teleop_rt.trial.process_main import SlaveEnd


@pytest.mark.parametrize("fault", [one for one in FAULTS.values() if one is not NO_FAULT])
def test_no_process_that_has_ended_is_to_be_reset(fault, capsys):
    stated = {"code": fault.code, "cause": fault.cause, "next_step": fault.next_step}
    with pytest.raises(typer.Exit):
        leave_on_fault({"fault": stated}, "start the slave again")
    said = capsys.readouterr().err
    assert "reset" not in said
    assert said.count("start the slave again") == ("then reset" in fault.next_step)


@pytest.mark.parametrize(
    ("arm", "received", "code"), [(True, 0, 1), (True, 9, None), (False, 0, None)]
)
def test_a_slave_that_is_armed_at_once_and_hears_no_master_has_the_exit_code_of_a_fault(
    monkeypatch, capsys, arm, received, code
):
    outcome = {"safety": {"fault": {"code": 0}}, "link": {"received": received}}
    end_of_rounds = (SlaveEnd(outcome, again=False), arm)
    monkeypatch.setattr(side_mains, "_rounds", lambda *_, **__: end_of_rounds)
    monkeypatch.setattr(gc, "freeze", lambda: None)
    left = pytest.raises(typer.Exit) if code else nullcontext()
    with left as end:
        side_mains.run_slave(Path("trial.yaml"), None, None, None, arm=arm, as_json=False)
    said = capsys.readouterr().err
    assert (end.value.exit_code if end else None, bool(said)) == (code, bool(code))
    assert said == "" or said.startswith(
        "no master was heard, so the axis held its position: start"
    )
