import sys

import pytest

from teleop_rt.cli import main


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """Call the command line in this process; returns exit code, output and errors."""
    monkeypatch.chdir(tmp_path)

    def calling(*arguments):
        monkeypatch.setattr(sys, "argv", ["teleop-rt", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return end.value.code or 0, captured.out, captured.err

    return calling
