"""Where a rig's running daemon is found: its lock, its control socket and its rings.

Below the run folder a rig called "Bench rig" has `bench-rig.socket` (commands) and
`bench-rig.session`, a link to the folder in shared memory that holds its rings: `places()` finds
them, `RingReader(place.session / "slave.ring")` reads along, and the `.topic` files beside the
rings name their columns. The locks lie where every user's daemon sees them.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import itertools
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from teleop_rt.errors import ExpectedError

CHOSEN = "TELEOP_RT_RUN_DIR"
_SERVICE = Path("/run/teleop-rt")
_LOCKS = Path("/run/lock")
_LONGEST_NAME = 60


class BusyError(ExpectedError):
    """The rig is in use: says by whom, and what to do next."""


class PlaceError(ExpectedError):
    """The folder of sockets and locks cannot be used: says why, and what to do next."""


@dataclass(frozen=True, slots=True)
class Place:
    """The files of one rig's daemon."""

    folder: Path
    name: str

    @property
    def socket(self) -> Path:
        """The control socket."""
        return self.folder / f"{self.name}.socket"

    @property
    def session(self) -> Path:
        """The link to the folder of rings."""
        return self.folder / f"{self.name}.session"


def name_of(rig_name: str) -> str:
    """Return a rig's name as part of a file name."""
    return re.sub(r"[^a-z0-9]+", "-", rig_name.lower()).strip("-")[:_LONGEST_NAME] or "rig"


def run_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder in which a daemon of this user puts its files.

    That is TELEOP_RT_RUN_DIR, else what systemd gives a service (RUNTIME_DIRECTORY), else the
    user's own (XDG_RUNTIME_DIR), else one in the folder for temporary files.
    """
    for variable in (CHOSEN, "RUNTIME_DIRECTORY"):
        if environment.get(variable):
            return Path(environment[variable])
    return _own_folder(environment)


def _own_folder(environment: Mapping[str, str]) -> Path:
    if environment.get("XDG_RUNTIME_DIR"):
        return Path(environment["XDG_RUNTIME_DIR"]) / "teleop-rt"
    return Path(tempfile.gettempdir()) / f"teleop-rt-{os.getuid()}"


def places(environment: Mapping[str, str] = os.environ) -> list[Place]:
    """Return the places of all daemons that can be found from here, running or left behind."""
    if environment.get(CHOSEN):
        folders = [Path(environment[CHOSEN])]
    else:
        folders = [_SERVICE, _own_folder(environment)]
    return [
        Place(folder, link.name.removesuffix(".session"))
        for folder in folders
        for link in sorted(folder.glob("*.session"))
    ]


@contextmanager
def claimed(rig_name: str, reached_by: Sequence[str], session: Path) -> Iterator[Place]:
    """Hold a rig for this process, and say where its rings are.

    `reached_by` are the buses and ports of the rig: each is locked, so that a copy of the config
    under another name is no way around it. The kernel releases a lock when the process ends,
    however it ends: what a crash left behind is no obstacle. Raises BusyError while another
    process holds one of them, PlaceError where the folder for it cannot be written.
    """
    folder = run_folder()
    try:
        folder.mkdir(mode=0o750, parents=True, exist_ok=True)
        (folder / ".writable").touch()
    except OSError as error:
        raise PlaceError(
            f"{folder}: the daemon's socket and locks cannot be made there: {error.strerror}; "
            f"name another folder in {CHOSEN}, or make this one writable"
        ) from None
    with ExitStack() as held:
        for device in reached_by:
            held.enter_context(_locked(_lock_folder(folder) / f"teleop-rt-{_unique(device)}.lock"))
        place = _named(folder, name_of(rig_name), held)
        _forget(place)
        place.session.symlink_to(session)
        session.chmod(0o750)
        try:
            yield place
        finally:
            place.session.unlink(missing_ok=True)
            place.socket.unlink(missing_ok=True)


def _unique(device: str) -> str:
    digest = hashlib.sha256(device.encode()).hexdigest()[:8]
    return f"{name_of(device)}-{digest}"


def _named(folder: Path, name: str, held: ExitStack) -> Place:
    """Hold and return the first free place of this name: rigs may share a name."""
    for number in itertools.count(1):
        place = Place(folder, name if number == 1 else f"{name}-{number}")
        with contextlib.suppress(BusyError):
            held.enter_context(_locked(folder / f"{place.name}.lock"))
            break
    return place


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    descriptor = _open(path)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.pread(descriptor, 100, 0).decode(errors="replace").strip() or "another"
            raise BusyError(
                f"this rig is in use by process {owner}, which holds {path}: end it first "
                "(`teleop-rt status` tells what it is)"
            ) from None
        with contextlib.suppress(OSError):  # a file that another user's daemon left is only read
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)


def _lock_folder(run: Path) -> Path:
    everybodys = CHOSEN not in os.environ and os.access(_LOCKS, os.W_OK)
    return _LOCKS if everybodys else run


def _open(path: Path) -> int:
    """Open a lock file, also one of another user's, which a lock need only read."""
    if path.exists() and not os.access(path, os.W_OK):
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    flags = os.O_RDWR | os.O_CLOEXEC
    with contextlib.suppress(FileExistsError):
        return os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o644)
    return os.open(path, flags)


def _forget(place: Place) -> None:
    """Remove what a daemon that crashed left: its socket, and its rings in shared memory."""
    place.socket.unlink(missing_ok=True)
    if place.session.is_symlink():
        left = place.session.readlink()
        if left.name.startswith("teleop-rt-"):
            shutil.rmtree(left, ignore_errors=True)
        place.session.unlink()
