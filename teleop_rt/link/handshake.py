"""The handshake's packets: who may ask, who is answered, and a stranger's cost.

    Hello    header | Noise message 1 (rate, chain that it renews) | mac1 | mac2
    Welcome  header | Noise message 2 (rate, chain that it renews) | mac1
    Retry    header | nonce | sealed cookie

As in WireGuard (Donenfeld 2017, section 5.4.7): mac1 is made with the pre-shared key, so a packet
without it costs a hash and is never answered. Under load a Hello is answered by a cookie, made
from its sender's address; only who receives it there can send the mac2 that gets more work done.
The master sends one and the same Hello until it is answered. The slave keeps its grant as a
pending handshake and moves to it on the first data packet under its keys, which proves that the
master lives: a Hello played again costs an answer and never a session.
"""

from __future__ import annotations

import hashlib
import hmac
import os
from dataclasses import dataclass
from struct import Struct

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

from teleop_rt.link.budget import Budget, Budgets
from teleop_rt.link.codec import HEADER_BYTES, encode_header
from teleop_rt.link.keys import PeerKey, PeerKeys
from teleop_rt.link.messages import Header, Kind, MessageError
from teleop_rt.link.noise import DH_BYTES, TAG_BYTES, Initiator, NoiseError, Responder
from teleop_rt.link.session import Session
from teleop_rt.link.transport import Address

PROLOGUE = b"teleop-rt 5"
HANDSHAKES_PER_S = 25
"""Answered without a cookie; and so many again for each address that has shown one."""
RETRIES_PER_S = 500
"""Cookies sent to all addresses together, 10 us each; to one address, as many as handshakes."""
RETRIES_PER_HOST = 250
"""Cookies a second to all ports of one host, which cost it nothing: the others keep half."""
HASHES_PER_POLL = 256
"""Spent on strangers, 0.8 us each: with many keys a flood must not take the time of a tick."""
PENDING_WITHOUT_COOKIE = 4
"""Handshakes granted and not yet confirmed, without a cookie; a peer has one under way."""
MOST_PENDING = 16
"""With cookies; the oldest one is forgotten for a new one."""
PENDING_NS = 30_000_000_000
"""A granted handshake waits so long for its first packet: three round trips of the slowest link."""
COOKIE_NS = 60_000_000_000
"""A cookie's secret is renewed after this time; the previous one remains valid."""
_MAC_BYTES = _COOKIE_BYTES = 16  # of BLAKE2s, shortened to 128 bits
_NONCE_BYTES = 12  # of ChaCha20-Poly1305 (RFC 8439)
_PAYLOAD = Struct("<IQ")
_NOISE_BYTES = DH_BYTES + _PAYLOAD.size + TAG_BYTES
_HELLO_BYTES = HEADER_BYTES + _NOISE_BYTES + 2 * _MAC_BYTES
_WELCOME_BYTES = HEADER_BYTES + _NOISE_BYTES + _MAC_BYTES
_RETRY_BYTES = HEADER_BYTES + _NONCE_BYTES + _COOKIE_BYTES + TAG_BYTES


def _derived(psk: bytes, purpose: bytes) -> bytes:
    return hashlib.blake2s(PROLOGUE + b" " + purpose, key=psk).digest()


def _mac(key: bytes, data: bytes) -> bytes:
    return hashlib.blake2s(data, key=key, digest_size=_MAC_BYTES).digest()


class Caller:
    """The master's side of one handshake at a time."""

    def __init__(self, key: PeerKey) -> None:
        self._psk = key.secret
        self._peer = key.name
        self._mac_key = _derived(key.secret, b"mac")
        self._cookie_key = _derived(key.secret, b"cookie")
        self._initiator: Initiator | None = None
        self._cookie: bytes | None = None
        self._cookie_ns = 0

    def hello(self, rate_hz: int, continues: int, now_ns: int) -> bytes:
        """Return the packet that asks for a session, or for new keys of the chain `continues`."""
        if self._initiator is None:
            payload = _PAYLOAD.pack(rate_hz, continues)
            self._initiator = Initiator(self._psk, PROLOGUE, payload)
        packet = encode_header(Header(Kind.HELLO, 0, 0, now_ns)) + self._initiator.message
        packet += _mac(self._mac_key, packet)
        if self._cookie is not None and now_ns - self._cookie_ns > COOKIE_NS:
            self._cookie = None
        mac2 = bytes(_MAC_BYTES) if self._cookie is None else _mac(self._cookie, packet)
        return packet + mac2

    def forget(self) -> None:
        """Give the handshake under way up; the next call makes another key."""
        self._initiator = None

    def take_welcome(self, packet: bytes, rates_hz: tuple[int, int], now_ns: int) -> Session:
        """Return the session granted, once for each handshake. Raises MessageError."""
        if len(packet) != _WELCOME_BYTES:
            raise MessageError("length")
        clear, mac1 = packet[:-_MAC_BYTES], packet[-_MAC_BYTES:]
        if not hmac.compare_digest(mac1, _mac(self._mac_key, clear)):
            raise MessageError("authentication")
        if self._initiator is None:
            raise MessageError("late welcome")
        try:
            payload, keys = self._initiator.read(clear[HEADER_BYTES:])
        except NoiseError:
            raise MessageError("foreign welcome") from None
        self._initiator = None
        rate_hz, continues = _PAYLOAD.unpack(payload)
        _require_rate(rate_hz, rates_hz)
        return Session.of(keys, self._peer, now_ns, rate_hz, continues)

    def take_retry(self, packet: bytes, now_ns: int) -> None:
        """Keep the cookie that the slave demands. Raises MessageError."""
        if len(packet) != _RETRY_BYTES:
            raise MessageError("length")
        if self._initiator is None:
            raise MessageError("late welcome")
        nonce = packet[HEADER_BYTES : HEADER_BYTES + _NONCE_BYTES]
        aad = packet[:HEADER_BYTES] + self._initiator.message[:DH_BYTES]
        try:
            self._cookie = ChaCha20Poly1305(self._cookie_key).decrypt(
                nonce, packet[HEADER_BYTES + _NONCE_BYTES :], aad
            )
        except InvalidTag:
            raise MessageError("authentication") from None
        self._cookie_ns = now_ns


@dataclass(slots=True)
class PendingHandshake:
    """A handshake granted and not yet confirmed."""

    session: Session
    message: bytes
    peer: _Peer
    granted_ns: int
    address: Address | None


@dataclass(frozen=True, slots=True)
class _Peer:
    """Who may call, and the keys made of that one's."""

    key: PeerKey
    mac_key: bytes
    cookie_key: bytes


class Answerer:
    """The slave's side: answers those who hold a key, at a bounded cost."""

    def __init__(
        self, keys: PeerKeys, rate_hz: int, rates_hz: tuple[int, int], now_ns: int
    ) -> None:
        self._peers = [
            _Peer(key, _derived(key.secret, b"mac"), _derived(key.secret, b"cookie"))
            for key in keys
        ]
        self._rate_hz, self._rates_hz = rate_hz, rates_hz
        self.pending: dict[bytes, PendingHandshake] = {}
        self._strangers = Budget(HANDSHAKES_PER_S, now_ns)
        self._retries = Budget(RETRIES_PER_S, now_ns)
        self.retried = Budgets(HANDSHAKES_PER_S)
        self._hosts = Budgets(RETRIES_PER_HOST)
        self._shown = Budgets(HANDSHAKES_PER_S)
        self._secrets = [os.urandom(32), os.urandom(32)]
        self._secrets_ns = now_ns
        self.new_poll()

    def new_poll(self) -> None:
        """Allow the work of another handshake, and of so many hashes."""
        self._worked = False
        self._hashes_left = HASHES_PER_POLL

    def pending_of(self, session_id: int) -> PendingHandshake | None:
        """Return the handshake of this session that was granted and not yet confirmed."""
        for granted in self.pending.values():
            if granted.session.session_id == session_id:
                return granted
        return None

    def confirmed(self) -> None:
        """Forget all other grants: only one session is open."""
        self.pending.clear()

    def answer(
        self, header: Header, packet: bytes, sender: Address | None, chain: Session | None,
        now_ns: int, *, led: bool,
    ) -> bytes:  # fmt: skip
        """Return the answer to a Hello, a Welcome or a Retry. Raises MessageError.

        `chain` is the session that stands, whose keys the Hello may renew, and `led` says whether
        its master lives: one who goes on with another session was taken over, and gets none.
        """
        if len(packet) != _HELLO_BYTES:
            raise MessageError("length")
        peer = self._peer_of(packet)
        address = repr(sender).encode()
        ephemeral = packet[HEADER_BYTES : HEADER_BYTES + DH_BYTES]
        self._expire(now_ns)
        if not self._welcome_now(packet, address, ephemeral, now_ns):
            host = None if sender is None else sender[0]
            return self._retry(peer, address, host, ephemeral, now_ns)
        granted = self.pending.get(ephemeral)
        if granted is None:
            granted = self._grant(peer, packet, sender, chain, now_ns, led=led)
            self.pending[ephemeral] = granted
        welcome = encode_header(Header(Kind.WELCOME, 0, 0, now_ns, header.stamp_ns))
        welcome += granted.message
        return welcome + _mac(peer.mac_key, welcome)

    def _peer_of(self, packet: bytes) -> _Peer:
        clear, mac1 = packet[: -2 * _MAC_BYTES], packet[-2 * _MAC_BYTES : -_MAC_BYTES]
        for peer in self._peers:
            self._hashes_left -= 1
            if self._hashes_left < 0:
                raise MessageError("handshake rate")
            if hmac.compare_digest(mac1, _mac(peer.mac_key, clear)):
                return peer
        raise MessageError("authentication")

    def _welcome_now(self, packet: bytes, address: bytes, ephemeral: bytes, now_ns: int) -> bool:
        """Return whether a Hello is answered without a cookie first; raise where it must wait."""
        clear, mac2 = packet[:-_MAC_BYTES], packet[-_MAC_BYTES:]
        if any(mac2) and any(
            hmac.compare_digest(mac2, _mac(_mac(secret, address), clear))
            for secret in self._secrets
        ):
            if not self._shown.take(address, now_ns):
                raise MessageError("handshake rate")
            return True
        known = ephemeral in self.pending
        return self._strangers.take(now_ns) and (
            known or len(self.pending) < PENDING_WITHOUT_COOKIE
        )

    def _retry(
        self, peer: _Peer, address: bytes, host: str | None, ephemeral: bytes, now_ns: int
    ) -> bytes:
        if not (
            self.retried.take(address, now_ns)
            and self._hosts.take(host, now_ns)
            and self._retries.take(now_ns)
        ):
            raise MessageError("handshake rate")
        nonce = os.urandom(_NONCE_BYTES)
        clear = encode_header(Header(Kind.RETRY, 0, 0, now_ns))
        cookie = _mac(self._secrets[0], address)
        sealed = ChaCha20Poly1305(peer.cookie_key).encrypt(nonce, cookie, clear + ephemeral)
        return clear + nonce + sealed

    def _grant(
        self, peer: _Peer, packet: bytes, sender: Address | None, chain: Session | None,
        now_ns: int, *, led: bool,
    ) -> PendingHandshake:  # fmt: skip
        """Work a handshake: at most one in a poll, for it takes half a millisecond."""
        if self._worked:
            raise MessageError("handshake rate")
        self._worked = True
        try:
            noise = packet[HEADER_BYTES : HEADER_BYTES + _NOISE_BYTES]
            responder = Responder(peer.key.secret, PROLOGUE, noise)
            rate_hz, continues = _PAYLOAD.unpack(responder.payload)
            _require_rate(rate_hz, self._rates_hz)
            stands = chain is not None and (chain.chain_id, chain.peer) == (
                continues,
                peer.key.name,
            )
            if led and continues and not stands:
                raise MessageError("taken over")
            continues = continues if stands else 0
            message, keys = responder.answer(_PAYLOAD.pack(self._rate_hz, continues))
        except NoiseError:
            raise MessageError("authentication") from None
        if len(self.pending) >= MOST_PENDING:
            del self.pending[next(iter(self.pending))]
        session = Session.of(keys, peer.key.name, now_ns, rate_hz, continues)
        return PendingHandshake(session, message, peer, now_ns, sender)

    def _expire(self, now_ns: int) -> None:
        late = [
            ephemeral
            for ephemeral, granted in self.pending.items()
            if now_ns - granted.granted_ns > PENDING_NS
        ]
        for ephemeral in late:
            del self.pending[ephemeral]
        if now_ns - self._secrets_ns > COOKIE_NS:
            self._secrets = [os.urandom(32), self._secrets[0]]
            self._secrets_ns = now_ns


def _require_rate(rate_hz: int, rates_hz: tuple[int, int]) -> None:
    lowest, highest = rates_hz
    if not lowest <= rate_hz <= highest:
        raise MessageError("rate")
