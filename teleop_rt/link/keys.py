"""Key files: a key that both sides share, and keys of operators by name beside it.

A file holds one key a line: 64 hexadecimal digits are the shared key, and a name before them makes
it an operator's own. The rig's file lists everybody who may lead it, an operator's file holds one
line; an operator is revoked by removing the line (a service reads its copy of the file from its
start: restart it). Empty lines and `#` comments are allowed.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
from pathlib import Path
from typing import NamedTuple

from teleop_rt.errors import ExpectedError
from teleop_rt.outputs import refuse_existing

KEY_BYTES = 32
"""Of a pre-shared key: 256 bits, as ChaCha20 takes."""
SHARED = "shared"
"""The name of the holder of the key without a name."""
MOST_KEYS = 64
"""Operators of one slave: each key costs a hash for each Hello."""
MOST_BYTES = 64 * 1024
"""Of a key file: a device, or a recording named by mistake, is no such file."""
"""Each costs a stranger's packet one hash (1 us)."""
FEWEST_VALUES = 8
"""So many different bytes a key must have; of 10^30 random keys none has fewer."""
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,32}")
_CREDENTIALS = "CREDENTIALS_DIRECTORY"


class KeyFileError(ExpectedError):
    """The key file cannot be used; the message names it, the cause and the next step."""


class PeerKey(NamedTuple):
    """A pre-shared key [32 bytes] and the name of who holds it."""

    name: str
    secret: bytes


PeerKeys = tuple[PeerKey, ...]


def shared_key(secret: bytes) -> PeerKeys:
    """Return the keys of a side that knows this shared key alone."""
    return (PeerKey(SHARED, secret),)


def generate_key(path: Path, operator: str | None = None) -> None:
    """Write a new key to `path` with mode 0600, with the operator's name if it is one's own.

    Raises OutputError for a file that exists, KeyFileError for an invalid name.
    """
    if operator is not None and (_NAME.fullmatch(operator) is None or operator == SHARED):
        raise KeyFileError(
            f"{operator!r} is not a valid name: use up to 32 letters, digits, . _ or -"
        )
    refuse_existing([path])
    key = secrets.token_hex(KEY_BYTES)
    try:
        path.touch(mode=0o600, exist_ok=False)
    except OSError as error:
        folder = path.parent
        reason = "the folder takes no new files" if folder.is_dir() else error.strerror
        raise KeyFileError(
            f"{path}: cannot create the key file: {reason}: name a file in a folder of yours"
        ) from error
    try:
        path.write_text(f"{key if operator is None else f'{operator} {key}'}\n", "ascii")
    except OSError as error:
        path.unlink()  # a full disk keeps an empty file, which is no key
        raise KeyFileError(f"{path}: cannot write the key: {error.strerror}: make room") from error


def default_key() -> Path:
    """Return the key that systemd gives a service (LoadCredential). Raises KeyFileError."""
    folder = os.environ.get(_CREDENTIALS)
    if not folder:
        raise KeyFileError("no key: name a key file with --key; `teleop-rt keygen` makes one")
    return Path(folder) / "link.key"


def load_keys(path: Path) -> PeerKeys:
    """Read the keys of a file, in its order. Raises KeyFileError."""
    text = _private(path)
    try:
        lines = text.decode("ascii").splitlines()
    except ValueError:
        raise KeyFileError(f"{path}: not a key: 64 hexadecimal digits are expected") from None
    keys = tuple(
        _peer_key(words, f"{path}:{number}")
        for number, line in enumerate(lines, 1)
        if (words := line.partition("#")[0].split())
    )
    return _distinct(keys, path)


def load_own_key(path: Path) -> PeerKeys:
    """Read the one key of an operator's side. Raises KeyFileError where there are several."""
    keys = load_keys(path)
    if len(keys) != 1:
        raise KeyFileError(
            f"{path}: contains {len(keys)} keys: give the master a file with its own alone"
        )
    return keys


def _peer_key(words: list[str], where: str) -> PeerKey:
    name = SHARED if len(words) == 1 else words[0]
    if len(words) > 2 or _NAME.fullmatch(name) is None or (len(words) == 2 and name == SHARED):
        raise KeyFileError(
            f"{where}: not a key: write 64 hexadecimal digits, after a name or alone"
        )
    try:
        secret = bytes.fromhex(words[-1])
    except ValueError:
        raise KeyFileError(f"{where}: not a key: 64 hexadecimal digits are expected") from None
    if len(secret) != KEY_BYTES:
        raise KeyFileError(f"{where}: a key of {len(secret)} bytes; {KEY_BYTES} are expected")
    if len(set(secret)) < FEWEST_VALUES:
        raise KeyFileError(
            f"{where}: this key is not random, anybody could guess it: "
            "make one with `teleop-rt keygen`"
        )
    return PeerKey(name, secret)


def _distinct(keys: PeerKeys, path: Path) -> PeerKeys:
    if not 0 < len(keys) <= MOST_KEYS:
        raise KeyFileError(f"{path}: contains {len(keys)} keys: 1 to {MOST_KEYS} are expected")
    for what, values in (("name", [key.name for key in keys]), ("key", [k.secret for k in keys])):
        if len(set(values)) < len(values):
            raise KeyFileError(
                f"{path}: a {what} is listed twice: give each operator one of its own"
            )
    return keys


def _private(path: Path) -> bytes:
    """Return the keys of a file; the file that is checked is the one that is read.

    systemd gives the service's user its credentials through an access list, which shows as the
    group's right to read; such a file is guarded by its folder. Raises KeyFileError.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # no pipe is awaited
        try:
            if problem := _problem_of(path, os.fstat(descriptor)):
                raise KeyFileError(f"{path}: {problem}")
            return os.read(descriptor, MOST_BYTES)
        finally:
            os.close(descriptor)
    except (OSError, ValueError) as error:
        raise KeyFileError(
            f"{path}: cannot read the key: {getattr(error, 'strerror', error)}; make one with"
            " `teleop-rt keygen`"
        ) from error


def _problem_of(path: Path, found: os.stat_result) -> str:
    """Return why a file guards no key, or nothing."""
    folder, mode = os.environ.get(_CREDENTIALS), stat.S_IMODE(found.st_mode)
    credential = bool(folder) and path.parent == Path(str(folder))
    if not stat.S_ISREG(found.st_mode) or found.st_size > MOST_BYTES:
        return f"is no key file: a file of up to {MOST_BYTES} bytes is one"
    if mode & (0o007 if credential else 0o077):
        return f"others may read this key (mode {mode:04o}); chmod 600 it"
    if not credential and found.st_uid not in {0, os.geteuid()}:
        return (
            f"belongs to another user (number {found.st_uid}), who knows this key and may change "
            "it: make one of your own with `teleop-rt keygen`"
        )
    return ""
