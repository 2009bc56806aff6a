"""The place of a rig's running daemon: its lock, its control socket and its rings.

Below the run folder a rig called "Bench rig" has `bench-rig.socket` (commands) and
`bench-rig.rings`, a link to its ring folder in shared memory: `places()` finds
them, `RingReader(place.ring_folder / "slave.ring")` reads along, and the `.topic` files beside the
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
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from teleop_rt.errors import ExpectedError
from teleop_rt.realtime.leftovers import owner

CHOSEN = "TELEOP_RT_RUN_DIR"
_SERVICE = Path("/run/teleop-rt")
_LOCKS = Path("/run/lock")
_LONGEST_NAME = 60
"""Characters of a rig's name in the path of a socket, which may have 108."""
_RING_FOLDERS = "teleop-rt-"
_LINK = ".rings"
"""Ending of the link from a rig's place to its ring folder."""
_NO_COMMANDS = "takes-no-commands"


class BusyError(ExpectedError):
    """The rig is in use: the message gives its owner and the next step."""


class PlaceError(ExpectedError):
    """The folder of sockets and locks cannot be used; the message gives cause and next step."""


@dataclass(frozen=True, slots=True)
class DaemonFiles:
    """The files of one rig's daemon."""

    folder: Path
    name: str

    @property
    def socket(self) -> Path:
        """The control socket, which a daemon has from one config to the next, and a run never."""
        return self.folder / f"{self.name}.socket"

    @property
    def ring_folder(self) -> Path:
        """The link to the ring folder."""
        return self.folder / f"{self.name}{_LINK}"

    @property
    def takes_commands(self) -> bool:
        """False where a run holds the rig, which never has a control socket."""
        try:
            return not (self.ring_folder / _NO_COMMANDS).exists()
        except PermissionError:
            return True

    @property
    def process(self) -> int | None:
        """The process that holds it, or held it until it crashed; None where it was just left."""
        try:
            return owner(self.ring_folder.readlink().name, _RING_FOLDERS)
        except FileNotFoundError:
            return None


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
    return _own_folder(environment)


def _own_folder(environment: Mapping[str, str]) -> Path:
    if environment.get("XDG_RUNTIME_DIR"):
        return Path(environment["XDG_RUNTIME_DIR"]) / "teleop-rt"
    return Path(tempfile.gettempdir()) / f"teleop-rt-{os.getuid()}"


def _anothers(folder: Path) -> bool:
    """Return whether somebody else made this folder, or anybody may change its files."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid in {0, os.getuid()}
    return not ours or bool(found.st_mode & stat.S_IWOTH)


def places(environment: Mapping[str, str] = os.environ) -> list[DaemonFiles]:
    """Return the places of all daemons that can be found from here, running or left behind.

    In a folder that another user made, daemons could be listed that do not exist.
    """
    if environment.get(CHOSEN):
        folders = [Path(environment[CHOSEN])]
    else:
        own = _own_folder(environment)
        folders = [_SERVICE] if _anothers(own) else [_SERVICE, own]
    return [
        DaemonFiles(folder, link.name.removesuffix(_LINK))
        for folder in folders
        for link in sorted(folder.glob(f"*{_LINK}"))
    ]


def refuse_commands(ring_folder: Path) -> None:
    """Note that the process of this ring folder will never take commands."""
    (ring_folder / _NO_COMMANDS).touch()


class Claim:
    """A rig that this process holds, from one config to the next, and where its rings are.

    The buses and ports that reach a rig are locked, so that a copy of the config under another
    name is no way around it. The kernel releases a lock when the process ends, however it ends:
    files that a crash left behind are no obstacle.
    """

    def __init__(self) -> None:
        self._locks: dict[Path, int] = {}
        self._place: DaemonFiles | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def take(self, rig_name: str, reached_by: Sequence[str], ring_folder: Path) -> DaemonFiles:
        """Hold this rig instead of the one held so far, and link its place to `ring_folder`.

        Raises BusyError while another process holds one of its buses and ports, PlaceError where
        the folder for it cannot be written; the rig held so far then stays held.
        """
        folder = _writable(run_folder())
        if folder == _own_folder(os.environ) and _anothers(folder):
            raise PlaceError(
                f"{folder}: another user made this folder, or may change its files, and could "
                f"take commands in the daemon's place: remove it, or name another one in {CHOSEN}"
            )
        taken: dict[Path, int] = {}
        try:
            for device in reached_by:
                self._lock(_lock_folder(folder) / f"teleop-rt-{_unique(device)}.lock", taken)
            place = self._named(folder, name_of(rig_name), taken)
        except BaseException:
            _close(taken, but=self._locks)
            raise
        if self._place != place:
            self._withdraw()
            place.socket.unlink(missing_ok=True)
        _close(self._locks, but=taken)
        self._locks, self._place = taken, place
        _point(place, ring_folder)
        ring_folder.chmod(0o750)
        return place

    def release(self) -> None:
        """Let the rig go."""
        self._withdraw()
        _close(self._locks, but={})
        self._locks = {}

    def _withdraw(self) -> None:
        if self._place is not None:
            self._place.ring_folder.unlink(missing_ok=True)
            self._place.socket.unlink(missing_ok=True)
        self._place = None

    def _named(self, folder: Path, name: str, taken: dict[Path, int]) -> DaemonFiles:
        """Hold and return the first free place of this name: rigs may share a name."""
        for number in itertools.count(1):
            place = DaemonFiles(folder, name if number == 1 else f"{name}-{number}")
            with contextlib.suppress(BusyError):
                self._lock(folder / f"{place.name}.lock", taken)
                break
        return place

    def _lock(self, path: Path, taken: dict[Path, int]) -> None:
        if path not in taken:
            taken[path] = self._locks[path] if path in self._locks else _locked(path)


@contextmanager
def claimed(rig_name: str, reached_by: Sequence[str], ring_folder: Path) -> Iterator[DaemonFiles]:
    """Hold a rig for this process, with one config. Raises as `Claim.take`."""
    with Claim() as claim:
        yield claim.take(rig_name, reached_by, ring_folder)


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


def _locked(path: Path) -> int:
    """Return a descriptor that holds this lock. Raises BusyError."""
    descriptor = _open(path)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.pread(descriptor, 100, 0).decode(errors="replace").strip() or "another"
        os.close(descriptor)
        raise BusyError(
            f"this rig is in use by process {holder}, which holds {path}: end it first "
            "(`teleop-rt status` shows it)"
        ) from None
    with contextlib.suppress(OSError):  # a file that another user's daemon left is only read
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
    return descriptor


def _close(locks: Mapping[Path, int], but: Mapping[Path, int]) -> None:
    for path, descriptor in locks.items():
        if path not in but:
            os.close(descriptor)


def _lock_folder(run: Path) -> Path:
    everybodys = CHOSEN not in os.environ and os.access(_LOCKS, os.W_OK)
    return _LOCKS if everybodys else run


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


def _point(place: DaemonFiles, ring_folder: Path) -> None:
    """Link a place to its ring folder in one step; remove the one that a crash left."""
    left = place.ring_folder.readlink() if place.ring_folder.is_symlink() else None
    fresh = place.ring_folder.with_suffix(".next")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(ring_folder)
    fresh.replace(place.ring_folder)
    if left is not None and left != ring_folder and left.name.startswith(_RING_FOLDERS):
        shutil.rmtree(left, ignore_errors=True)
