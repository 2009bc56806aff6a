from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from teleop_rt.link.keys import MOST_BYTES, KeyFileError, generate_key, load_keys, load_own_key
from teleop_rt.outputs import OutputError

ALICE, BOB = "a0b1c2d3e4f5" * 5 + "0102", "ffeeddccbbaa" * 5 + "0102"


def test_a_generated_key_is_private_and_can_be_loaded(tmp_path: Path) -> None:
    path = tmp_path / "link.key"
    generate_key(path)
    assert path.stat().st_mode & 0o777 == 0o600
    ((name, secret),) = load_keys(path)
    assert (name, len(secret)) == ("shared", 32)
    with pytest.raises(OutputError, match="already exists"):
        generate_key(path)


def test_a_key_that_others_may_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "link.key"
    generate_key(path)
    path.chmod(0o640)
    with pytest.raises(KeyFileError, match="chmod 600"):
        load_keys(path)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a file away")
def test_a_key_that_belongs_to_another_user_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "link.key"
    generate_key(path)
    os.chown(path, 4321, -1)
    with pytest.raises(KeyFileError, match="belongs to another user"):
        load_keys(path)
    monkeypatch.setattr(os, "geteuid", lambda: 4321)
    assert load_keys(path)
    os.chown(path, 0, -1)
    assert load_keys(path), "root's, as systemd's credentials are"
    monkeypatch.setattr(os, "geteuid", lambda: 4322)
    os.chown(path, 4321, -1)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    assert load_keys(path), "a credential is guarded by its folder"


def test_a_key_that_is_swapped_after_a_look_at_it_is_read_as_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, other = tmp_path / "link.key", tmp_path / "other.key"
    generate_key(path)
    expected = load_keys(path)
    generate_key(other)
    other.chmod(0o644)

    def swapping(look: Callable[..., os.stat_result]) -> Callable[..., os.stat_result]:
        def looked(*given: object) -> os.stat_result:
            found = look(*given)
            if os.path.lexists(other):
                other.replace(path)
            return found

        return looked

    monkeypatch.setattr(os, "fstat", swapping(os.fstat))
    monkeypatch.setattr(Path, "stat", swapping(Path.stat))
    assert load_keys(path) == expected


@pytest.mark.parametrize("text", ["", "zz" * 32, "00" * 31, "00" * 33, "é" * 32])
def test_a_file_that_holds_no_key_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "link.key"
    path.write_text(text, encoding="utf-8")
    path.chmod(0o600)
    with pytest.raises(KeyFileError, match=r"link\.key"):
        load_keys(path)


def test_what_is_no_plain_small_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "link.key", 0o600)
    private(tmp_path / "long.key", "a" * (MOST_BYTES + 1))
    for path in (tmp_path / "link.key", tmp_path / "long.key", Path("/dev/zero"), tmp_path):
        with pytest.raises(KeyFileError, match="is no key file"):
            load_keys(path)


def test_a_missing_key_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="keygen"):
        load_keys(tmp_path / "none.key")


def private(path: Path, text: str) -> Path:
    path.write_text(text, encoding="ascii")
    path.chmod(0o600)
    return path


def test_operators_have_keys_of_their_own_beside_the_shared_one(tmp_path: Path) -> None:
    shared, alice = tmp_path / "link.key", tmp_path / "alice.key"
    generate_key(shared)
    generate_key(alice, "alice")
    with shared.open("a", encoding="ascii") as file:
        file.write(f"# may lead\n{alice.read_text(encoding='ascii')}\n")
    keys = load_keys(shared)
    assert [key.name for key in keys] == ["shared", "alice"]
    assert load_own_key(alice) == keys[1:]
    with pytest.raises(KeyFileError, match="2 keys"):
        load_own_key(shared)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("00" * 32, "guess"),
        ("5a" * 32, "guess"),
        (f"alice {ALICE}\nalice {BOB}", "name is listed twice"),
        (f"alice {ALICE}\nbob {ALICE}", "key is listed twice"),
        (f"a/b {ALICE}", "not a key"),
        (f"alice bob {ALICE}", "not a key"),
        (f"shared {ALICE}", "not a key"),
        ("# nobody\n", "0 keys"),
    ],
)
def test_a_list_that_would_let_the_wrong_ones_in_is_refused(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(KeyFileError, match=message):
        load_keys(private(tmp_path / "link.key", text))


@pytest.mark.parametrize("name", ["", "shared", "a b", "x" * 33, "\u00e9"])
def test_an_operator_without_a_plain_name_gets_no_key(tmp_path: Path, name: str) -> None:
    with pytest.raises(KeyFileError, match="not a valid name"):
        generate_key(tmp_path / "some.key", name)
    assert not (tmp_path / "some.key").exists()
