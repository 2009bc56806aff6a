"""Keys and sealing: a pre-shared key, session keys from salts of both sides, no replay.

ChaCha20-Poly1305 (RFC 8439) with 64-bit counters as nonces, one key per direction and session;
keys by HKDF-SHA256 (RFC 5869). A handshake packet has a key of its own, made from its sender's
salt, so that no key ever sees one nonce twice.
"""

from __future__ import annotations

import os
import secrets
import stat
from dataclasses import dataclass
from pathlib import Path
from struct import Struct

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from teleop_rt.errors import ExpectedError
from teleop_rt.link.messages import HEADER_BYTES, MessageError

KEY_BYTES = 32
TAG_BYTES = 16
REPLAY_WINDOW = 1024
_NONCE = Struct("<4xQ")
_CREDENTIALS = "CREDENTIALS_DIRECTORY"


class KeyFileError(ExpectedError):
    """The key file cannot be used: says which, why and what to do next."""


def generate_key(path: Path) -> None:
    """Write a new pre-shared key to `path` with mode 0600; an existing file is refused."""
    try:
        path.touch(mode=0o600, exist_ok=False)
    except OSError as error:
        raise KeyFileError(f"{path}: cannot create the key file: {error.strerror}") from error
    path.write_text(secrets.token_hex(KEY_BYTES) + "\n", encoding="ascii")


def default_key() -> Path:
    """Return the key that systemd gives a service (LoadCredential). Raises KeyFileError."""
    folder = os.environ.get(_CREDENTIALS)
    if not folder:
        raise KeyFileError("no key: name a key file with --key; `teleop-rt keygen` makes one")
    return Path(folder) / "link.key"


def _open_to_others(path: Path, mode: int) -> int:
    """Return the bits of a mode by which others may read; a credential is guarded by its folder.

    systemd gives the service's user its credentials through an access list, which shows as the
    group's right to read.
    """
    folder = os.environ.get(_CREDENTIALS)
    credential = bool(folder) and path.parent == Path(str(folder))
    return mode & (0o007 if credential else 0o077)


def load_key(path: Path) -> bytes:
    """Read a pre-shared key [32 bytes, written as hexadecimal]; raises KeyFileError."""
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        text = path.read_bytes()
    except OSError as error:
        raise KeyFileError(
            f"{path}: cannot read the key: {error.strerror}; make one with `teleop-rt keygen`"
        ) from error
    if _open_to_others(path, mode):
        raise KeyFileError(f"{path}: others may read this key (mode {mode:04o}); chmod 600 it")
    try:
        key = bytes.fromhex(text.decode("ascii"))
    except ValueError as error:
        raise KeyFileError(f"{path}: not a key: 64 hexadecimal digits are expected") from error
    if len(key) != KEY_BYTES:
        raise KeyFileError(f"{path}: a key of {len(key)} bytes; {KEY_BYTES} are expected")
    return key


def derive(key: bytes, salt: bytes, purpose: bytes, length: int = KEY_BYTES) -> bytes:
    """Return `length` bytes derived from `key` for one purpose (HKDF, RFC 5869)."""
    return HKDF(SHA256(), length, salt, b"teleop-rt 1 " + purpose).derive(key)


class Cipher:
    """Seals packets of one direction under one key; the sequence number is the nonce."""

    def __init__(self, key: bytes) -> None:
        self._aead = ChaCha20Poly1305(key)

    def seal(self, clear: bytes, body: bytes, sequence: int) -> bytes:
        """Return `clear | sealed body | tag`; `clear` is authenticated."""
        return clear + self._aead.encrypt(_NONCE.pack(sequence), body, clear)

    def open(self, packet: bytes, sequence: int, clear_bytes: int = HEADER_BYTES) -> bytes:
        """Return the body of a packet; raises MessageError where it does not verify."""
        if len(packet) < clear_bytes + TAG_BYTES:
            raise MessageError("length")
        try:
            return self._aead.decrypt(
                _NONCE.pack(sequence), packet[clear_bytes:], packet[:clear_bytes]
            )
        except InvalidTag:
            raise MessageError("authentication") from None


class ReplayWindow:
    """Remembers the sequence numbers seen, so that none is accepted twice."""

    def __init__(self) -> None:
        self._seen = [0] * REPLAY_WINDOW
        self.newest = 0
        self.count = 0

    @property
    def missing(self) -> int:
        """How many numbers up to the newest have not come."""
        return self.newest - self.count

    def check(self, sequence: int) -> None:
        """Raise MessageError for a number seen before, or too old to tell."""
        if sequence <= self.newest - REPLAY_WINDOW:
            raise MessageError("too old")
        if sequence == 0 or self._seen[sequence % REPLAY_WINDOW] == sequence:
            raise MessageError("replay")

    def add(self, sequence: int) -> None:
        """Remember a number; only those of verified packets may come here."""
        self._seen[sequence % REPLAY_WINDOW] = sequence
        if sequence > self.newest:  # noqa: PLR1730 - max() costs more than all the rest of this
            self.newest = sequence
        self.count += 1


@dataclass(slots=True)
class Session:
    """The keys, counters and replay window of one session, seen from one side."""

    session_id: int
    peer_salt: bytes
    own_salt: bytes
    outgoing: Cipher
    incoming: Cipher
    window: ReplayWindow
    sequence: int = 0

    @classmethod
    def derive(cls, key: bytes, master_salt: bytes, slave_salt: bytes, role: str) -> Session:
        """Return the session of these two salts, seen from `role` (master or slave)."""
        material = derive(key, master_salt + slave_salt, b"session", 2 * KEY_BYTES + 8)
        from_master = Cipher(material[:KEY_BYTES])
        from_slave = Cipher(material[KEY_BYTES : 2 * KEY_BYTES])
        is_master = role == "master"
        return cls(
            session_id=int.from_bytes(material[2 * KEY_BYTES :], "little"),
            peer_salt=slave_salt if is_master else master_salt,
            own_salt=master_salt if is_master else slave_salt,
            outgoing=from_master if is_master else from_slave,
            incoming=from_slave if is_master else from_master,
            window=ReplayWindow(),
        )

    def next_sequence(self) -> int:
        """Return the number of the next packet to send; it is used once."""
        self.sequence += 1
        return self.sequence
