"""The last line of a command that a fault has ended."""

import pytest
import typer

from teleop_rt.cli.leaving import leave_on_fault
from teleop_rt.slave.faults import FAULTS, NO_FAULT


@pytest.mark.parametrize("fault", [one for one in FAULTS.values() if one is not NO_FAULT])
def test_no_process_that_has_ended_is_to_be_reset(fault, capsys):
    stated = {"code": fault.code, "cause": fault.cause, "next_step": fault.next_step}
    with pytest.raises(typer.Exit):
        leave_on_fault({"fault": stated}, "start the slave again")
    said = capsys.readouterr().err
    assert "reset" not in said
    assert said.count("start the slave again") == ("then reset" in fault.next_step)
