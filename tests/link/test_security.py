from __future__ import annotations

from pathlib import Path

import pytest
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from hypothesis import given
from hypothesis import strategies as st

from teleop_rt.link.messages import HEADER_BYTES, MessageError
from teleop_rt.link.security import (
    REPLAY_WINDOW,
    Cipher,
    KeyFileError,
    ReplayWindow,
    Session,
    generate_key,
    load_key,
)


def test_a_generated_key_is_private_and_can_be_loaded(tmp_path: Path) -> None:
    path = tmp_path / "link.key"
    generate_key(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert len(load_key(path)) == 32
    with pytest.raises(KeyFileError, match="exists"):
        generate_key(path)


def test_a_key_that_others_may_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "link.key"
    generate_key(path)
    path.chmod(0o640)
    with pytest.raises(KeyFileError, match="chmod 600"):
        load_key(path)


@pytest.mark.parametrize("text", ["", "zz" * 32, "00" * 31, "00" * 33, "é" * 32])
def test_a_file_that_holds_no_key_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "link.key"
    path.write_text(text, encoding="utf-8")
    path.chmod(0o600)
    with pytest.raises(KeyFileError, match=r"link\.key"):
        load_key(path)


def test_a_missing_key_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="keygen"):
        load_key(tmp_path / "none.key")


def test_both_sides_derive_the_same_session_and_one_key_per_direction() -> None:
    master = Session.derive(b"k" * 32, b"m" * 32, b"s" * 32, "master")
    slave = Session.derive(b"k" * 32, b"m" * 32, b"s" * 32, "slave")
    other = Session.derive(b"k" * 32, b"m" * 32, b"t" * 32, "slave")
    clear = bytes(HEADER_BYTES)
    sealed = master.outgoing.seal(clear, b"body", 1)
    assert master.session_id == slave.session_id != other.session_id
    assert slave.incoming.open(sealed, 1) == b"body"
    for wrong in (slave.outgoing, other.incoming):
        with pytest.raises(MessageError, match="authentication"):
            wrong.open(sealed, 1)


def test_a_packet_is_sealed_by_chacha20_poly1305_with_the_counter_as_nonce() -> None:
    clear = bytes(range(HEADER_BYTES))
    sealed = Cipher(b"k" * 32).seal(clear, b"body", 0x0102)
    nonce = bytes(4) + (0x0102).to_bytes(8, "little")
    assert ChaCha20Poly1305(b"k" * 32).decrypt(nonce, sealed[HEADER_BYTES:], clear) == b"body"


@given(st.lists(st.integers(1, 3 * REPLAY_WINDOW), max_size=300))
def test_the_replay_window_accepts_no_number_twice(numbers: list[int]) -> None:
    window, accepted = ReplayWindow(), set()
    for number in numbers:
        expected = number not in accepted and number > max(accepted, default=0) - REPLAY_WINDOW
        try:
            window.check(number)
        except MessageError:
            assert not expected
            continue
        assert expected
        window.add(number)
        accepted.add(number)
    assert window.count == len(accepted)
