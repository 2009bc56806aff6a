"""The exit code of a run stands, whatever signal comes once its outcome is known."""

import subprocess
import sys
import textwrap

from teleop_rt_dev.trial.files import SILICONE

MISMATCH = ("rig.limits.force_max_N=0.6", "slave.force_cap_N=0.6", "contact.onset_force_N=0.5")
"""So close that friction passes the share of it that sensor and drive may differ by: a fault."""

INTERRUPTED = """
    import atexit, signal
    from teleop_rt import __main__
    from teleop_rt.cli import whole_run

    print_summary = whole_run.print_summary

    def printing(*arguments):
        signal.raise_signal(signal.SIGTERM)
        print_summary(*arguments)

    whole_run.print_summary = printing
    atexit.register(signal.raise_signal, signal.SIGHUP)
    __main__.main()
"""


def test_a_signal_between_a_fault_and_the_exit_leaves_the_exit_code(tmp_path):
    changes = [part for change in MISMATCH for part in ("--set", change)]
    run = ["run", SILICONE, "--clock", "simulated", "--duration", "1.5", "--out", tmp_path / "run"]
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(INTERRUPTED), *run, *changes],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "stopped: force sensor and drive measure different forces" in done.stderr
    assert "files in" in done.stdout
