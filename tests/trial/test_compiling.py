"""The report of a run on its compiling."""

from teleop_rt.cli import whole_run
from teleop_rt.kernels import jit
from teleop_rt_dev.trial.files import silicone


def test_a_run_that_can_keep_nothing_compiled_reports_it(monkeypatch, capsys):
    monkeypatch.setattr(jit, "_ROOT", None)
    whole_run.compile_first(silicone(), quiet=True)
    assert capsys.readouterr().err == ""
    whole_run.compile_first(silicone(), quiet=False)
    assert "each run compiles them again" in capsys.readouterr().err
