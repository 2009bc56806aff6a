"""The handshake: salts and rates of both sides, each packet authenticated by the shared key.

The master sends Hello with its salt until a Welcome echoes that salt. The slave keeps what it
granted as a candidate and moves to it only on the first data packet under its keys, which
proves that the master lives: a replayed Hello thus costs an answer and never a session.
"""

from __future__ import annotations

from teleop_rt.link.messages import (
    HEADER_BYTES,
    SALT_BYTES,
    Header,
    Hello,
    Kind,
    MessageError,
    Welcome,
    decode,
    encode,
    encode_header,
    kind_of,
)
from teleop_rt.link.security import Cipher, derive

_CLEAR_BYTES = HEADER_BYTES + SALT_BYTES


def _cipher(key: bytes, salt: bytes, kind: Kind) -> Cipher:
    return Cipher(derive(key, salt, kind.name.encode()))


def seal_handshake(
    key: bytes, message: Hello | Welcome, salt: bytes, sequence: int, stamp_ns: int
) -> bytes:
    """Return a handshake packet under the key made from its sender's `salt`.

    `sequence` must be new for each packet of this salt: it is the nonce.
    """
    header = Header(kind_of(message), 0, sequence, stamp_ns)
    clear = encode_header(header) + salt
    return _cipher(key, salt, header.kind).seal(clear, encode(message), sequence)


def open_handshake(key: bytes, header: Header, packet: bytes) -> tuple[Hello | Welcome, bytes]:
    """Return message and sender's salt of a handshake packet; raises MessageError."""
    salt = packet[HEADER_BYTES:_CLEAR_BYTES]
    body = _cipher(key, salt, header.kind).open(packet, header.sequence, _CLEAR_BYTES)
    message = decode(header.kind, body)
    if not isinstance(message, Hello | Welcome):
        raise MessageError("kind")
    return message, salt
