"""A packet on its way out, for kernels: its header and nonce are written, then it is sent."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import bound, kernel
from teleop_rt.kernels.record import record_type
from teleop_rt.link import codec
from teleop_rt.link.intake import PEER_STAMP, PEER_STAMP_TAKEN, put_whole
from teleop_rt.link.noise import NONCE_BYTES, NONCE_NUMBER_AT
from teleop_rt.link.statistics import SENT
from teleop_rt.link.transport import MAX_DATAGRAM
from teleop_rt.realtime.system_calls import send_bytes_to

if TYPE_CHECKING:
    from teleop_rt.link.transport import UdpTransport

    Whole = NDArray[np.int64]
    Bytes = NDArray[np.uint8]

_HEADER_BYTES, _KIND_AT = codec.HEADER_BYTES, codec.KIND_AT
_SESSION_AT, _SEQUENCE_AT = codec.SESSION_AT, codec.SEQUENCE_AT
_STAMP_AT, _ECHO_AT, _HELD_AT = codec.STAMP_AT, codec.ECHO_AT, codec.HELD_AT


class OutgoingFields:
    """Fields of a packet on its way out: the socket, where it lies, and where its peer's name."""

    descriptor: int
    packet: int
    name: int


_OUTGOING = record_type(OutgoingFields)
StoredOutgoing = NDArray[np.record]


class Outgoing:
    """A packet to be sent over a socket from an end whose words are `link`, and its `statistics`'.

    `write_head` counts it and writes its header, `clear`, and its `nonce`; `send_sealed` sends it
    with a body.
    """

    def __init__(self, udp: UdpTransport, link: Whole, statistics: Whole) -> None:
        packet, nonce = np.zeros(MAX_DATAGRAM, np.uint8), np.zeros(NONCE_BYTES, np.uint8)
        packet[: codec.VERSION_AT] = np.frombuffer(codec.MAGIC, np.uint8)
        packet[codec.VERSION_AT] = codec.VERSION
        self.clear, self.nonce = packet.data[:_HEADER_BYTES], nonce.data
        stored: StoredOutgoing = np.zeros(1, _OUTGOING)
        fields = cast("OutgoingFields", stored[0])
        fields.descriptor, fields.packet = udp.descriptor, packet.ctypes.data
        fields.name = udp.peer_name.ctypes.data
        self.write_head = bound(write_head, (packet, nonce, link, statistics), 0, 0, 0, 0)
        self.send_sealed = bound(send_sealed, (stored, packet, udp.peer_name), b"")


@kernel
def write_head(
    packet: Bytes,
    nonce: Bytes,
    link: Whole,
    statistics: Whole,
    kind: int,
    session: int,
    sequence: int,
    now_ns: int,
) -> None:
    """Count one more packet of this kind and session, and write its header and nonce."""
    statistics[SENT] += 1
    packet[_KIND_AT] = kind
    put_whole(packet, _SESSION_AT, session)
    put_whole(packet, _SEQUENCE_AT, sequence)
    put_whole(packet, _STAMP_AT, now_ns)
    put_whole(packet, _ECHO_AT, link[PEER_STAMP])
    put_whole(packet, _HELD_AT, now_ns - link[PEER_STAMP_TAKEN])
    put_whole(nonce, NONCE_NUMBER_AT, sequence)


@kernel
def send_sealed(stored: StoredOutgoing, packet: Bytes, name: Bytes, sealed: bytes) -> bool:
    """Send the packet of the header written last, with this body; return whether it went.

    It does not where the peer's address is no number: a name is looked up by the system.
    """
    out: Any = stored[0]
    if name[0] == 0:
        return False
    length = len(sealed)
    for at in range(length):
        packet[_HEADER_BYTES + at] = sealed[at]
    return send_bytes_to(out.descriptor, out.packet, _HEADER_BYTES + length, out.name) == 0
