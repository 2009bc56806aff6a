"""The Noise handshake NNpsk0, by the Noise Protocol Framework, revision 34 (Perrin 2018).

    Noise_NNpsk0_25519_ChaChaPoly_SHA256
      -> psk, e
      <- e, ee

Both ends prove that they hold the pre-shared key. The keys of a session come from ephemeral keys
of both ends, so that a nonce is used once by construction, and old traffic stays secret when the
pre-shared key is lost. The names of methods and states are the specification's.
"""

from __future__ import annotations

import hashlib
import hmac
from struct import Struct

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

PROTOCOL = b"Noise_NNpsk0_25519_ChaChaPoly_SHA256"
Body = bytes | memoryview
KEY_BYTES = DH_BYTES = 32  # of X25519 (RFC 7748)
TAG_BYTES = 16
"""Of ChaCha20-Poly1305 (RFC 8439), whose key has the size of an X25519 key."""
pack_nonce = Struct("<4xQ").pack
"""The 12 bytes of a nonce, from its number."""
NONCE_BYTES, NONCE_NUMBER_AT = 12, 4
"""Size of a nonce, and where its number is."""
X25519PrivateKey.generate()  # loads cryptography's backend now, not with a loop's first handshake


class NoiseError(ValueError):
    """A handshake message or a packet that does not verify."""


class CipherState:
    """A key and its nonces; packets say their own nonce (section 11.4, out-of-order transport)."""

    def __init__(self, key: bytes) -> None:
        self.aead = ChaCha20Poly1305(key)

    def encrypt(self, nonce: int, ad: bytes, plaintext: Body) -> bytes:
        """Return ciphertext and tag; `nonce` must be new for this key."""
        return self.aead.encrypt(pack_nonce(nonce), plaintext, ad)

    def decrypt(self, nonce: int, ad: bytes, ciphertext: bytes) -> bytes:
        """Return the plaintext. Raises NoiseError where it does not verify."""
        try:
            return self.aead.decrypt(pack_nonce(nonce), ciphertext, ad)
        except InvalidTag:
            raise NoiseError("the packet does not verify") from None


class _SymmetricState:
    """Chaining key, handshake hash and the handshake's cipher (section 5.2)."""

    def __init__(self, prologue: bytes) -> None:
        self.h = hashlib.sha256(PROTOCOL).digest()  # the name is longer than a hash
        self._ck = self.h
        self._cipher: CipherState | None = None
        self._nonce = 0
        self.mix_hash(prologue)

    def mix_hash(self, data: bytes) -> None:
        self.h = hashlib.sha256(self.h + data).digest()

    def mix_key(self, material: bytes) -> None:
        self._ck, key = _hkdf(self._ck, material, 2)
        self._initialize_key(key)

    def mix_key_and_hash(self, material: bytes) -> None:
        self._ck, mixed, key = _hkdf(self._ck, material, 3)
        self.mix_hash(mixed)
        self._initialize_key(key)

    def encrypt_and_hash(self, plaintext: bytes) -> bytes:
        ciphertext = self._keyed().encrypt(self._nonce, self.h, plaintext)
        self._nonce += 1
        self.mix_hash(ciphertext)
        return ciphertext

    def decrypt_and_hash(self, ciphertext: bytes) -> bytes:
        plaintext = self._keyed().decrypt(self._nonce, self.h, ciphertext)
        self._nonce += 1
        self.mix_hash(ciphertext)
        return plaintext

    def split(self) -> tuple[CipherState, CipherState]:
        first, second = _hkdf(self._ck, b"", 2)
        return CipherState(first), CipherState(second)

    def _initialize_key(self, key: bytes) -> None:
        self._cipher, self._nonce = CipherState(key), 0

    def _keyed(self) -> CipherState:
        assert self._cipher is not None  # noqa: S101 - psk0 mixes a key before any payload
        return self._cipher


class Initiator:
    """The end that calls: one message out, one in, and the handshake is used up."""

    def __init__(
        self,
        psk: bytes,
        prologue: bytes,
        payload: bytes,
        ephemeral: X25519PrivateKey | None = None,
    ) -> None:
        """Write the first message, in `message`; `ephemeral` is the system's unless a test's."""
        self._ephemeral: X25519PrivateKey | None = ephemeral or X25519PrivateKey.generate()
        self._state = _SymmetricState(prologue)
        self._state.mix_key_and_hash(psk)
        public = _mix_ephemeral(self._state, self._ephemeral.public_key().public_bytes_raw())
        self.message = public + self._state.encrypt_and_hash(payload)

    def read(self, message: bytes) -> tuple[bytes, SessionKeys]:
        """Return payload and keys of the second message; a handshake gives keys once.

        Raises NoiseError where the message does not verify: then another may still do.
        """
        if self._ephemeral is None:
            raise NoiseError("this handshake has given its keys")
        state = _copy(self._state)
        payload = _answered(state, self._ephemeral, message)
        self._ephemeral = None
        sending, receiving = state.split()
        return payload, SessionKeys(sending, receiving, state.h)


class SessionKeys:
    """Result of a handshake: a cipher for each direction, and the hash that names the session."""

    __slots__ = ("handshake_hash", "receiving", "sending")

    def __init__(self, sending: CipherState, receiving: CipherState, h: bytes) -> None:
        self.sending, self.receiving, self.handshake_hash = sending, receiving, h


class Responder:
    """The end that answers: `payload` of the first message, then `answer`."""

    def __init__(self, psk: bytes, prologue: bytes, message: bytes) -> None:
        """Read the first message. Raises NoiseError where it does not verify."""
        if len(message) < DH_BYTES + TAG_BYTES:
            raise NoiseError("too short")
        self._remote = message[:DH_BYTES]
        self._state = _SymmetricState(prologue)
        self._state.mix_key_and_hash(psk)
        _mix_ephemeral(self._state, self._remote)
        self.payload = self._state.decrypt_and_hash(message[DH_BYTES:])

    def answer(
        self, payload: bytes, ephemeral: X25519PrivateKey | None = None
    ) -> tuple[bytes, SessionKeys]:
        """Return the second message and the keys. Raises NoiseError for a peer's useless key."""
        own = ephemeral or X25519PrivateKey.generate()
        public = _mix_ephemeral(self._state, own.public_key().public_bytes_raw())
        self._state.mix_key(_dh(own, self._remote))
        message = public + self._state.encrypt_and_hash(payload)
        receiving, sending = self._state.split()
        return message, SessionKeys(sending, receiving, self._state.h)


def _answered(state: _SymmetricState, ephemeral: X25519PrivateKey, message: bytes) -> bytes:
    """Return the payload of the second message. Raises NoiseError."""
    if len(message) < DH_BYTES + TAG_BYTES:
        raise NoiseError("too short")
    remote = _mix_ephemeral(state, message[:DH_BYTES])
    state.mix_key(_dh(ephemeral, remote))
    return state.decrypt_and_hash(message[DH_BYTES:])


def _mix_ephemeral(state: _SymmetricState, public: bytes) -> bytes:
    """Process the token e in a handshake with a pre-shared key (section 9.2)."""
    state.mix_hash(public)
    state.mix_key(public)
    return public


def _copy(state: _SymmetricState) -> _SymmetricState:
    """Return a state of its own: a message that does not verify leaves the original as it was."""
    copied = object.__new__(_SymmetricState)
    copied.__dict__.update(state.__dict__)
    return copied


def _dh(private: X25519PrivateKey, public: bytes) -> bytes:
    try:
        return private.exchange(X25519PublicKey.from_public_bytes(public))
    except ValueError:  # a point of low order, whose product is zero
        raise NoiseError("the peer's key is of no use") from None


def _hkdf(chaining_key: bytes, material: bytes, outputs: int) -> list[bytes]:
    """Return two or three keys (section 4.3)."""
    temp = hmac.digest(chaining_key, material, "sha256")
    keys = [hmac.digest(temp, b"\x01", "sha256")]
    while len(keys) < outputs:
        keys.append(hmac.digest(temp, keys[-1] + bytes([len(keys) + 1]), "sha256"))
    return keys
