"""Privileges that the loop requests from the system, each reported as granted or refused."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import gc
import mmap
import os
import resource
import struct
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teleop_rt.realtime.own_pages import MAPS, own_written_pages
from teleop_rt.shipped import EXAMPLES

FIFO, LOCKED, PINNED = "SCHED_FIFO", "mlockall", "core {} alone"
"""Names of privileges that other modules use."""
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4  # flags of mlockall (sys/mman.h)
# Of linux/prctl.h and linux/capability.h, which Python does not have.
_PR_SET_TIMERSLACK = 29
_CAP_IPC_LOCK = 14
DMA_LATENCY = "/dev/cpu_dma_latency"
STATUS = Path("/proc/self/status")
_MAP_FIELDS = 5
"""Permissions, offset, device, inode and file of a mapping, beside its addresses."""
_COMPILER = "libllvmlite"


@dataclass(frozen=True, slots=True)
class Privilege:
    """One thing asked of the system: whether it was granted, and how to grant it."""

    name: str
    granted: bool
    reason: str
    how_to_grant: str

    def describe(self) -> str:
        """Return it as a sentence."""
        if self.granted:
            return f"{self.name}: granted ({self.reason})"
        return f"{self.name}: refused ({self.reason}); {self.how_to_grant}"


def prepare_process(
    fifo_priority: int, cpu: int | None = None, *, awake: bool = False
) -> list[Privilege]:
    """Ask for FIFO scheduling, locked memory and fine timers; freeze the garbage collector.

    `cpu` pins the thread to one core, `awake` keeps the processor out of deep sleep. Acts on the
    calling thread, which must be the one that runs the loop, and comes before the loop starts
    (locking takes tens of milliseconds). A refusal is reported, never raised.
    """
    _touch_linear_algebra()
    give_back_compiler()
    own_written_pages()
    asked = [_fifo(fifo_priority), lock_memory(), _timer_slack()]
    if cpu is not None:
        asked.append(_pin(cpu))
    if awake:
        asked.append(_stay_awake())
    gc.collect()
    gc.freeze()
    gc.disable()
    asked.append(Privilege("garbage collector", True, "frozen and off", "nothing"))  # noqa: FBT003 - granted
    return asked


def remember_process() -> Callable[[], None]:
    """Return a function that undoes `prepare_process`: scheduling, cores, memory, collection.

    A process that goes on after its loop calls it, on the same thread, before it starts another:
    that one would inherit priority and core, and stand in the next loop's way.
    """
    undo = ExitStack()
    with contextlib.suppress(AttributeError, OSError):
        undo.callback(os.sched_setaffinity, 0, os.sched_getaffinity(0))
        undo.callback(os.sched_setscheduler, 0, os.sched_getscheduler(0), os.sched_getparam(0))

    def give_back() -> None:
        with contextlib.suppress(OSError):
            undo.close()
        ctypes.CDLL(None).munlockall()
        while _AWAKE:
            os.close(_AWAKE.pop())
        gc.unfreeze()
        gc.enable()

    return give_back


def give_back_compiler() -> int:
    """Let the system have the pages of LLVM's library that only held its code; return bytes.

    Compiled kernels lie elsewhere, and a page that is needed after all is read again. Only mappings
    that were never written to are given back. A system without /proc keeps them.
    """
    given = 0
    with contextlib.suppress(OSError, AttributeError):
        madvise = ctypes.CDLL(None).madvise
        for start, end in unwritten(MAPS.read_text(encoding="utf-8"), _COMPILER):
            place, length = ctypes.c_void_p(start), ctypes.c_size_t(end - start)
            if madvise(place, length, mmap.MADV_DONTNEED) == 0:
                given += end - start
    return given


def unwritten(maps: str, library: str) -> list[tuple[int, int]]:
    """Return start and end of a library's mappings that hold no page of their own.

    `maps` is the text of /proc/self/smaps. Relocated data may look as if they could not be written
    either, but have pages of their own (Anonymous), which would be lost.
    """
    found: list[tuple[int, int]] = []
    start = end = 0
    wanted = False
    for line in maps.splitlines():
        first, *rest = line.split(maxsplit=_MAP_FIELDS)
        if not first.endswith(":"):
            start, end = (int(address, 16) for address in first.split("-"))
            wanted = len(rest) == _MAP_FIELDS and library in rest[-1] and "w" not in rest[0]
        elif first == "Anonymous:" and wanted and rest[0] == "0":
            found.append((start, end))
    return found


def _touch_linear_algebra() -> None:
    """Make BLAS take its work memory now: with locked pages that takes 80 ms, once."""
    square = np.ones((8, 8))
    np.linalg.solve(square @ square + np.eye(8), square)


def _fifo(priority: int) -> Privilege:
    python = Path(sys.executable).resolve()
    how = f"sudo setcap cap_sys_nice+ep {python}, or LimitRTPRIO= in the service"
    name = FIFO
    try:
        policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
        present = os.sched_getparam(0).sched_priority
        if policy == os.SCHED_FIFO and present == priority:
            return Privilege(name, granted=True, reason="by whoever started it", how_to_grant=how)
        # A child process must not inherit the priority and compete with the loop.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except AttributeError:
        return _none_here(name)
    except OSError as error:
        if error.errno in {errno.EINVAL, errno.ENOSYS}:
            how = "use a kernel with real-time scheduling"
        elif os.geteuid() == 0:  # in a container, or behind a filter of system calls
            how = f"--cap-add=SYS_NICE --ulimit rtprio={priority} for a container, or let the "
            how += "service's SystemCallFilter= allow sched_setscheduler"
        reason = error.strerror or str(error)
        return Privilege(name, granted=False, reason=reason, how_to_grant=how)
    return Privilege(name, granted=True, reason=f"priority {priority}", how_to_grant=how)


def _none_here(name: str) -> Privilege:
    return Privilege(name, granted=False, reason="this system has none", how_to_grant="use Linux")


def _pin(cpu: int) -> Privilege:
    name = PINNED.format(cpu)
    how = f"isolcpus={cpu} on the kernel's command line"
    try:
        present = sorted(os.sched_getaffinity(0))
        if cpu not in present:
            how = f"give realtime.cpu one of {present}; {how}"
        os.sched_setaffinity(0, {cpu})
    except AttributeError:
        return _none_here(name)
    except OSError as error:
        if error.errno in {errno.EPERM, errno.ENOSYS}:
            how = "let SystemCallFilter= of the service, or the container, allow sched_setaffinity"
        reason = error.strerror or str(error)
        return Privilege(name, granted=False, reason=reason, how_to_grant=how)
    return Privilege(name, granted=True, reason="pinned", how_to_grant=how)


def keep_off(process: int, cpu: int) -> None:
    """Keep a process off the loop's core, where there is another one and the system allows it."""
    with contextlib.suppress(AttributeError, OSError):
        others = os.sched_getaffinity(process) - {cpu}
        if others:
            os.sched_setaffinity(process, others)


_AWAKE: list[int] = []
"""The open file that keeps the processor awake: the kernel takes it back when it is closed."""


def _stay_awake() -> Privilege:
    name = "no deep sleep"
    rules = EXAMPLES / "udev" / "*.rules"
    how = f"sudo cp {rules} /etc/udev/rules.d, and join the group teleop-rt"
    try:
        _AWAKE.append(os.open(DMA_LATENCY, os.O_WRONLY | os.O_CLOEXEC))
        os.write(_AWAKE[-1], struct.pack("i", 0))
    except OSError as error:
        reason = f"{DMA_LATENCY}: {error.strerror}"
        return Privilege(name, granted=False, reason=reason, how_to_grant=how)
    return Privilege(name, granted=True, reason=f"0 us in {DMA_LATENCY}", how_to_grant=how)


def lock_memory() -> Privilege:
    """Lock the mapped memory, and later mappings unless a limit would then refuse them."""
    how = "sudo prlimit --pid $$ --memlock=unlimited, or LimitMEMLOCK=infinity in the service"
    flags, reason = _MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT, "every page that is used"
    if not _may_lock_without_limit():
        flags, reason = flags & ~_MCL_FUTURE, "what is mapped now, the limit may refuse more"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(flags):
        code = ctypes.get_errno()
        if code in {errno.EINVAL, errno.ENOSYS}:
            how = "use a kernel that locks memory on fault (Linux 4.4 or newer)"
        return Privilege(LOCKED, granted=False, reason=os.strerror(code), how_to_grant=how)
    return Privilege(LOCKED, granted=True, reason=reason, how_to_grant=how)


def _may_lock_without_limit() -> bool:
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        return True
    with contextlib.suppress(OSError, IndexError):  # without /proc, as without the capability
        effective = STATUS.read_text(encoding="utf-8").partition("CapEff:")[2].split()[0]
        return bool(int(effective, 16) >> _CAP_IPC_LOCK & 1)
    return False


def _timer_slack() -> Privilege:
    granted = False
    with contextlib.suppress(AttributeError):
        granted = ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0
    return Privilege("timer slack 1 ns", granted, "prctl", "use Linux")
