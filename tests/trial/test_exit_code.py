"""The exit code of a run stands, whatever signal comes once its outcome is known."""

import signal
import subprocess
import sys
import textwrap

import pytest
from lean_install import without_report

from teleop_rt_dev.trial.files import SILICONE

MISMATCH = ("rig.limits.force_max_N=0.6", "slave.force_cap_N=0.6", "contact.onset_force_N=0.5",
            "rig.limits.stiffness_max_N_per_m=null")  # fmt: skip
"""So close that friction passes the share of it that sensor and drive may differ by: a fault.

No wall is said to be the stiffest, for which so low a cap would let the tool creep.
"""

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
        capture_output=True, text=True, check=False, env=without_report(tmp_path),
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "stopped: force sensor and drive measure different forces" in done.stderr
    assert "files in" in done.stdout


TAKEN_DOWN = """
    import os, signal, sys
    from teleop_rt import __main__, cli

    class Half:
        \"\"\"The objects of an interrupted compiler: their release ends the process.\"\"\"

        def __del__(self, kill=os.kill, me=os.getpid(), number=signal.SIGSEGV):
            kill(me, number)

    sys.half = Half()  # in no cycle, which Python leaves at its end
    cli.main = {command}
    __main__.program()
"""


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("lambda: signal.raise_signal(signal.SIGTERM)", 130),
        ("lambda: signal.raise_signal(signal.SIGINT)", 130),
        ("lambda: sys.exit(0)", -signal.SIGSEGV),  # undisturbed, everything is taken down
    ],
)
def test_an_interrupted_program_leaves_without_taking_the_compiler_down(command, code):
    script = textwrap.dedent(TAKEN_DOWN.format(command=command))
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == code
    assert done.stderr == ("interrupted\n" if code == 130 else "")


CLOSED = """
    import os, sys
    from teleop_rt import __main__

    for stream in (0, 1, 2):
        assert not os.path.exists(f"/proc/self/fd/{stream}"), "closed as the test begins"
    try:
        __main__.main()
    finally:
        places = [os.readlink(f"/proc/self/fd/{stream}") for stream in (0, 1, 2)]
        os.open(sys.argv[-1], os.O_CREAT)
        os.rename(sys.argv[-1], f"{sys.argv[-1]}{places.count(os.devnull)}")
"""


def test_closed_standard_streams_lead_nowhere_and_into_no_socket_or_log(tmp_path):
    """Their numbers would be the next file's: a message of a library would go into a bus."""
    words = [sys.executable, "-c", textwrap.dedent(CLOSED), "keygen", tmp_path / "link.key"]
    closed = subprocess.run(["/bin/sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *words], check=False)
    assert closed.returncode == 0
    assert (tmp_path / "link.key3").exists()
