"""Refused privileges are reported with the reason and the remedy; the loop goes on."""

import errno
import gc
import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numba
import pytest

from teleop_rt.realtime import own_pages, scheduling
from teleop_rt.trial.processes import TrialProcesses

MCL_FUTURE = 2  # of <sys/mman.h>: pages mapped later are locked, too


@pytest.fixture
def asked(monkeypatch):
    """Ask without changing this process; returns the requests by name."""
    locked = scheduling.Privilege("mlockall", granted=True, reason="", how_to_grant="")
    monkeypatch.setattr(scheduling, "lock_memory", lambda: locked)
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: None)
    for name in ("freeze", "disable", "collect"):
        monkeypatch.setattr(gc, name, lambda: None)

    def asking(priority=60, cpu=None, awake=False):
        return {p.name: p for p in scheduling.prepare_process(priority, cpu, awake=awake)}

    return asking


def refusing(monkeypatch, name, code):
    def refuse(*_):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, name, refuse)


def test_no_privilege_for_fifo_names_the_command_that_grants_it(asked, monkeypatch):
    refusing(monkeypatch, "sched_setscheduler", errno.EPERM)
    for user, how in (
        (1000, f"sudo setcap cap_sys_nice+ep {Path(sys.executable).resolve()}, or "),
        (0, "--cap-add=SYS_NICE --ulimit rtprio=60 for a container, or "),
    ):
        monkeypatch.setattr(os, "geteuid", lambda user=user: user)
        result = asked()["SCHED_FIFO"].describe()
        assert result.startswith(f"SCHED_FIFO: refused (Operation not permitted); {how}")


@pytest.mark.parametrize("code", [errno.EINVAL, errno.ENOSYS])
def test_a_kernel_without_fifo_is_reported(asked, monkeypatch, code):
    refusing(monkeypatch, "sched_setscheduler", code)
    assert "use a kernel with real-time scheduling" in asked()["SCHED_FIFO"].describe()


def test_a_system_without_scheduling_calls_is_reported(asked, monkeypatch):
    monkeypatch.delattr(os, "sched_setscheduler")
    assert not asked()["SCHED_FIFO"].granted


def test_fifo_that_the_service_manager_gave_is_kept(asked, monkeypatch):
    refusing(monkeypatch, "sched_setscheduler", errno.EPERM)
    monkeypatch.setattr(os, "sched_getscheduler", lambda _: os.SCHED_FIFO | 0x40000000)
    monkeypatch.setattr(os, "sched_getparam", lambda _: os.sched_param(60))
    assert asked()["SCHED_FIFO"].describe() == "SCHED_FIFO: granted (by whoever started it)"
    assert not asked(priority=70)["SCHED_FIFO"].granted


def test_a_core_that_is_not_there_is_refused_with_those_that_are(asked):
    result = asked(cpu=4000)["core 4000 alone"].describe()
    assert "refused" in result
    assert f"one of {sorted(os.sched_getaffinity(0))}" in result


@pytest.mark.parametrize("call", ["sched_setaffinity", "sched_getaffinity"])
def test_a_core_that_is_there_but_refused_names_who_refuses_it(asked, monkeypatch, call):
    core = min(os.sched_getaffinity(0))
    refusing(monkeypatch, call, errno.EPERM)
    result = asked(cpu=core)[f"core {core} alone"].describe()
    assert "refused (Operation not permitted); let SystemCallFilter= " in result
    assert "one of" not in result


def test_pinning_and_waking_do_what_they_say(tmp_path):
    core = min(os.sched_getaffinity(0))
    latency = tmp_path / "cpu_dma_latency"
    latency.touch()
    script = (
        "import os, gc, sys; from teleop_rt.realtime import scheduling as s\n"
        f"s.DMA_LATENCY = {str(latency)!r}\n"
        f"asked = {{p.name: p.granted for p in s.prepare_process(60, {core}, awake=True)}}\n"
        f"print(os.sched_getaffinity(0) == {{{core}}} and asked['core {core} alone'],\n"
        "      asked['no deep sleep'], gc.isenabled(), gc.get_freeze_count() > 0)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout
    assert result.split() == ["True", "True", "False", "True"]
    assert latency.read_bytes() == bytes(4)


def test_a_process_that_goes_on_after_its_loop_has_all_given_back(tmp_path):
    latency = tmp_path / "cpu_dma_latency"
    latency.touch()
    script = (
        "import os, gc, json; from pathlib import Path; from teleop_rt.realtime import scheduling\n"
        f"scheduling.DMA_LATENCY = {str(latency)!r}\n"
        "def now():\n"
        "    locked = Path('/proc/self/status').read_text().partition('VmLck:')[2].split()[0]\n"
        "    open_files = len(os.listdir('/proc/self/fd'))\n"
        "    cores = sorted(os.sched_getaffinity(0))\n"
        "    return [os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, cores,\n"
        "            gc.isenabled(), gc.get_freeze_count(), open_files, locked]\n"
        "states = [now()]\n"
        "give_back = scheduling.remember_process()\n"
        "asked = scheduling.prepare_process(60, states[0][2][-1], awake=True)\n"
        "states.append(now())\n"
        "child = os.fork()\n"
        "if not child: os._exit(os.sched_getscheduler(0))\n"
        "inherited = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])\n"
        "give_back()\n"
        "states.append(now())\n"
        "print(json.dumps([states, inherited]))\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    (before, within, after), inherited = json.loads(result.stdout)
    assert within != before
    assert after == before
    assert inherited == os.SCHED_OTHER


def test_a_latency_file_that_may_not_be_opened_is_reported(asked, monkeypatch, tmp_path):
    monkeypatch.setattr(scheduling, "DMA_LATENCY", str(tmp_path / "none"))
    result = asked(awake=True)["no deep sleep"].describe()
    assert "none: No such file or directory" in result
    assert "/udev/*.rules /etc/udev/rules.d" in result


@pytest.mark.parametrize(
    ("limit", "capabilities", "later"),
    [
        (resource.RLIM_INFINITY, 0, True),
        (1 << 30, 1 << 14, True),
        (1 << 30, ~(1 << 14), False),
        (1 << 30, None, False),
    ],
)
def test_a_limit_of_locked_memory_never_refuses_memory_to_a_loop_that_runs(
    monkeypatch, tmp_path, limit, capabilities, later
):
    if capabilities is not None:
        result = f"Name:\tx\nCapEff:\t{capabilities & (1 << 41) - 1:016x}\n"
        (tmp_path / "status").write_text(result)
    asked = []
    libc = SimpleNamespace(mlockall=lambda flags: asked.append(flags) or 0)
    monkeypatch.setattr(scheduling, "STATUS", tmp_path / "status")
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    monkeypatch.setattr(scheduling.ctypes, "CDLL", lambda *_, **__: libc)
    result = scheduling.lock_memory().describe()
    assert result.startswith("mlockall: granted (")
    assert bool(asked[0] & MCL_FUTURE) is later
    assert ("what is mapped now" in result) is not later


EVERYTHING = {"sched_setscheduler": 144, "mlockall": 151, "sched_setaffinity": 203}
"""Numbers of the system calls on x86-64."""
FILTERED = """
import ctypes, json, os, struct, sys
from teleop_rt.realtime import scheduling

def instruction(code, true, false, value):
    return struct.pack("HBBI", code, true, false, value)

refused, error = json.loads(sys.argv[1])
program = instruction(0x20, 0, 0, 0)  # load the number of the call
for number in refused:
    program += instruction(0x15, 0, 1, number) + instruction(0x06, 0, 0, 0x50000 | error)
program += instruction(0x06, 0, 0, 0x7FFF0000)  # all others are allowed
libc, held = ctypes.CDLL(None), ctypes.create_string_buffer(program, len(program))
length_and_place = struct.pack("H6xQ", len(program) // 8, ctypes.addressof(held))
if libc.prctl(38, 1, 0, 0, 0) or libc.prctl(22, 2, length_and_place, 0, 0):
    sys.exit("no filter")
asked = scheduling.prepare_process(60, min(os.sched_getaffinity(0)), awake=True)
print(json.dumps({one.name.split()[0]: one.describe() for one in asked}))
"""


@pytest.mark.skipif(os.uname().machine != "x86_64", reason="the numbers are those of x86-64")
@pytest.mark.parametrize("code", [errno.EPERM, errno.ENOSYS])
def test_a_process_whose_kernel_refuses_everything_reports_each_and_goes_on(code):
    done = subprocess.run(
        [sys.executable, "-c", FILTERED, json.dumps([list(EVERYTHING.values()), code])],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.stderr == "no filter\n":
        pytest.skip("this kernel has no seccomp filters")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    for name in ("SCHED_FIFO", "mlockall", "core"):
        _, _, why = result[name].partition(f": refused ({os.strerror(code)}); ")
        assert why, result[name]
    assert "granted" in result["garbage"]
    if code == errno.ENOSYS:
        assert result["mlockall"].endswith(
            "use a kernel that locks memory on fault (Linux 4.4 or newer)"
        )


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="there is one core")
def test_what_runs_beside_the_loop_keeps_off_its_core_and_the_loop_stays(tmp_path):
    cores = os.sched_getaffinity(0)
    loop_cpu = max(cores)
    processes = TrialProcesses(tmp_path / "log", "loop", loop_cpu)
    try:
        beside, loop = (processes.start(name, signal.pause) for name in ("recorder", "loop"))
        assert os.sched_getaffinity(beside.process.pid) == cores - {loop_cpu}
        assert os.sched_getaffinity(loop.process.pid) == cores
    finally:
        processes.close()


def test_the_only_core_is_shared(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: pytest.fail("no core would be left"))
    scheduling.keep_off(os.getpid(), 0)


MAPS = """\
7f0000000000-7f0000003000 r--p 00000000 fe:00 11   /opt/my venv/libllvmlite.so
Rss:                  12 kB
Anonymous:             0 kB
7f0000003000-7f0000005000 r-xp 00003000 fe:00 11   /opt/my venv/libllvmlite.so
Anonymous:             0 kB
7f0000005000-7f0000006000 r--p 00005000 fe:00 11   /opt/my venv/libllvmlite.so
Anonymous:             4 kB
7f0000006000-7f0000007000 rw-p 00006000 fe:00 11   /opt/my venv/libllvmlite.so
Anonymous:             0 kB
7f0000007000-7f0000008000 r-xp 00000000 fe:00 12   /usr/lib/libc.so.6
Anonymous:             0 kB
7f0000008000-7f0000009000 r-xp 00000000 00:00 0
Anonymous:             0 kB
"""


def test_only_pages_that_can_be_read_again_are_given_back():
    first, second = 0x7F0000000000, 0x7F0000003000
    assert scheduling.unwritten(MAPS, "libllvmlite") == [
        (first, second),
        (second, 0x7F0000005000),
    ]


def test_only_private_pages_in_use_that_may_be_written_are_copied_early():
    maps = """\
7f0000000000-7f0000004000 rw-p 00000000 00:00 0    [heap]
Size:                 16 kB
Rss:                   8 kB
7f0000004000-7f0000008000 rw-p 00000000 00:00 0
Rss:                   4 kB
7f0000008000-7f000000c000 rw-s 00000000 00:01 11   /dev/shm/ring
Rss:                  16 kB
7f000000c000-7f0000010000 r--p 00000000 fe:00 12   /usr/lib/libc.so.6
Rss:                  16 kB
"""
    assert list(own_pages.in_use(maps)) == [(0x7F0000000000, 0x7F0000004000)]


def test_a_system_that_does_not_report_its_mappings_copies_nothing(monkeypatch, tmp_path):
    monkeypatch.setattr(own_pages, "MAPS", tmp_path / "smaps")
    assert own_pages.own_written_pages() == 0


def compiler_resident_kb():
    total, wanted = 0, False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        words = line.split()
        if not words[0].endswith(":"):
            wanted = "libllvmlite" in words[-1]
        elif wanted and words[0] == "Rss:":
            total += int(words[1])
    return total


def test_the_compiler_leaves_memory_and_still_compiles():
    numba.njit(lambda x: x + 1.0)(1.0)
    before = compiler_resident_kb()
    assert scheduling.give_back_compiler() > 0
    assert compiler_resident_kb() < 0.2 * before
    assert numba.njit(lambda x: x * 3.0)(2.0) == 6.0


def test_a_system_that_does_not_report_its_mappings_keeps_the_compiler(monkeypatch, tmp_path):
    monkeypatch.setattr(scheduling, "MAPS", tmp_path / "smaps")
    assert scheduling.give_back_compiler() == 0
