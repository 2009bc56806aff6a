"""Locks of the buses and ports of a rig: one process at a time uses them.

The kernel releases a lock when its process ends, however it ends: files that a crash left behind
are no obstacle. The locks lie where every user's process sees them.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import re
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from teleop_rt.errors import ExpectedError

CHOSEN = "TELEOP_RT_RUN_DIR"
_LOCKS = Path("/run/lock")
_LONGEST_NAME = 60
"""Characters of a rig's name in the path of a socket, which may have 108."""


_RIG_IN_USE = (
    "this rig is in use by process {holder}, which holds {path}: end it first "
    "(`teleop-rt status` shows it)"
)
_SIMULATED_ALREADY = (
    "this rig is simulated already, by process {holder}, which holds {path}: end that one first, "
    "or give this one another bus or folder"
)


class BusyError(ExpectedError):
    """The rig is in use: the message gives its owner and the next step."""


class PlaceError(ExpectedError):
    """The folder of sockets and locks cannot be used; the message gives cause and next step."""


def name_of(rig_name: str) -> str:
    """Return a rig's name as part of a file name."""
    return re.sub(r"[^a-z0-9]+", "-", rig_name.lower()).strip("-")[:_LONGEST_NAME] or "rig"


def run_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder in which a daemon of this user puts its files.

    That is TELEOP_RT_RUN_DIR, else systemd's folder for a service (RUNTIME_DIRECTORY), else the
    user's own (XDG_RUNTIME_DIR), else one in the folder for temporary files.
    """
    for variable in (CHOSEN, "RUNTIME_DIRECTORY"):
        if environment.get(variable):
            return Path(environment[variable])
    return own_folder(environment)


def own_folder(environment: Mapping[str, str]) -> Path:
    """Return the folder of this user's daemons where none is chosen."""
    if environment.get("XDG_RUNTIME_DIR"):
        return Path(environment["XDG_RUNTIME_DIR"]) / "teleop-rt"
    return Path(tempfile.gettempdir()) / f"teleop-rt-{os.getuid()}"


def made_by_another(folder: Path) -> bool:
    """Return whether somebody else made this folder, or anybody may change its files."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid in {0, os.getuid()}
    return not ours or bool(found.st_mode & stat.S_IWOTH)


def made_run_folder() -> Path:
    """Return the run folder, made where it is missing.

    Raises PlaceError where it cannot be written, or another user could change its files.
    """
    folder = _writable(run_folder())
    if folder == own_folder(os.environ) and made_by_another(folder):
        raise PlaceError(
            f"{folder}: another user made this folder, or may change its files, and could "
            f"take commands in the daemon's place: remove it, or name another one in {CHOSEN}"
        )
    return folder


def locks_of(folder: Path, reached_by: Sequence[str]) -> list[Path]:
    """Return the lock of each bus and port of a rig; `folder` is the run folder."""
    everybodys = CHOSEN not in os.environ and os.access(_LOCKS, os.W_OK)
    place = _LOCKS if everybodys else folder
    return [place / f"teleop-rt-{_unique(device)}.lock" for device in reached_by]


@contextmanager
def devices_held(reached_by: Sequence[str], in_use: str = _RIG_IN_USE) -> Iterator[None]:
    """Hold the buses and ports of a rig for work on its devices, as a daemon holds them.

    Raises BusyError while another process holds one of them, PlaceError as `made_run_folder`.
    """
    taken: dict[Path, int] = {}
    try:
        for path in locks_of(made_run_folder(), reached_by):
            if path not in taken:
                taken[path] = locked(path, in_use)
        yield
    finally:
        close(taken, but={})


def simulation_held(reached_by: Sequence[str]) -> AbstractContextManager[None]:
    """Hold the simulated side of a rig's buses and ports, whose other side a daemon may hold.

    Two simulated rigs on one bus would both answer. Raises as `devices_held`.
    """
    return devices_held([f"simulated {device}" for device in reached_by], _SIMULATED_ALREADY)


def locked(path: Path, in_use: str = _RIG_IN_USE) -> int:
    """Return a descriptor that holds this lock.

    Raises BusyError with the message `in_use`, in which holder and path are filled in; PlaceError.
    """
    descriptor = _open(path)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.pread(descriptor, 100, 0).decode(errors="replace").strip() or "another"
        os.close(descriptor)
        raise BusyError(in_use.format(holder=holder, path=path)) from None
    with contextlib.suppress(OSError):  # a file that another user's daemon left is only read
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
    return descriptor


def close(locks: Mapping[Path, int], but: Mapping[Path, int]) -> None:
    """Release the locks that are not among `but`."""
    for path, descriptor in locks.items():
        if path not in but:
            os.close(descriptor)


def _writable(folder: Path) -> Path:
    try:
        folder.mkdir(mode=0o750, parents=True, exist_ok=True)
        (folder / ".writable").touch()
    except OSError as error:
        raise PlaceError(
            f"{folder}: the daemon's socket and locks cannot be made there: {error.strerror}; "
            f"name another folder in {CHOSEN}, or make this one writable"
        ) from None
    return folder


def _unique(device: str) -> str:
    digest = hashlib.sha256(device.encode()).hexdigest()[:8]
    return f"{name_of(device)}-{digest}"


def _open(path: Path) -> int:
    """Open a lock file, also one of another user's, which a lock need only read.

    Its folder may be everybody's: a link could lead to a file of ours, and a pipe be waited for.
    Raises PlaceError.
    """
    flags = os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        if os.path.lexists(path) and not os.access(path, os.W_OK):
            descriptor = os.open(path, os.O_RDONLY | flags)
        else:
            descriptor = _made(path, os.O_RDWR | flags)
    except OSError as error:
        raise PlaceError(f"{path}: cannot lock this rig: {error.strerror}; remove it") from None
    found = os.fstat(descriptor)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        os.close(descriptor)
        raise PlaceError(
            f"{path}: cannot lock this rig: it is not a regular file with one name; remove it"
        )
    return descriptor


def _made(path: Path, flags: int) -> int:
    """Open a file, which is made where there is none: in two steps, for everybody's folder."""
    with contextlib.suppress(FileExistsError):
        return os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o644)
    return os.open(path, flags)
