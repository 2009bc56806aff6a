"""The place of a rig's running daemon: its lock, its control socket and its rings.

Below the run folder a rig called "Bench rig" has `bench-rig.socket` (commands) and
`bench-rig.rings`, a link to its ring folder in shared memory: `places()` finds
them, `RingReader(place.ring_folder / "slave.ring")` reads along, and the `.topic` files beside the
rings name their columns.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from teleop_rt.realtime.leftovers import owner
from teleop_rt.realtime.rig_locks import (
    CHOSEN,
    BusyError,
    close,
    locked,
    locks_of,
    made_by_another,
    made_run_folder,
    name_of,
    own_folder,
)

_SERVICE = Path("/run/teleop-rt")
_RING_FOLDERS = "teleop-rt-"
_LINK = ".rings"
"""Ending of the link from a rig's place to its ring folder."""
_NO_COMMANDS = "takes-no-commands"


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


def places(environment: Mapping[str, str] = os.environ) -> list[DaemonFiles]:
    """Return the places of all daemons that can be found from here, running or left behind.

    In a folder that another user made, daemons could be listed that do not exist.
    """
    if environment.get(CHOSEN):
        folders = [Path(environment[CHOSEN])]
    else:
        own = own_folder(environment)
        folders = [_SERVICE] if made_by_another(own) else [_SERVICE, own]
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
        folder = made_run_folder()
        taken: dict[Path, int] = {}
        try:
            for path in locks_of(folder, reached_by):
                self._lock(path, taken)
            place = self._named(folder, name_of(rig_name), taken)
        except BaseException:
            close(taken, but=self._locks)
            raise
        if self._place != place:
            self._withdraw()
            place.socket.unlink(missing_ok=True)
        close(self._locks, but=taken)
        self._locks, self._place = taken, place
        _point(place, ring_folder)
        ring_folder.chmod(0o750)
        return place

    def release(self) -> None:
        """Let the rig go."""
        self._withdraw()
        close(self._locks, but={})
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
            taken[path] = self._locks[path] if path in self._locks else locked(path)


@contextmanager
def claimed(rig_name: str, reached_by: Sequence[str], ring_folder: Path) -> Iterator[DaemonFiles]:
    """Hold a rig for this process, with one config. Raises as `Claim.take`."""
    with Claim() as claim:
        yield claim.take(rig_name, reached_by, ring_folder)


def _point(place: DaemonFiles, ring_folder: Path) -> None:
    """Link a place to its ring folder in one step; remove the one that a crash left."""
    left = place.ring_folder.readlink() if place.ring_folder.is_symlink() else None
    fresh = place.ring_folder.with_suffix(".next")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(ring_folder)
    fresh.replace(place.ring_folder)
    if left is not None and left != ring_folder and left.name.startswith(_RING_FOLDERS):
        shutil.rmtree(left, ignore_errors=True)
