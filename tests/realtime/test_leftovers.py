"""Leftovers of killed processes in shared memory are removed by the next one that starts."""

import errno
import os
import subprocess

import pytest

from teleop_rt.realtime import ring_folder as ring_folder_module
from teleop_rt.realtime.leftovers import alive, owner
from teleop_rt.realtime.ring_folder import SharedMemoryError, new_ring_folder, publish
from teleop_rt.signals import SLAVE


def test_a_new_ring_folder_removes_those_of_processes_that_have_ended_and_no_others(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(ring_folder_module, "shared_folder", lambda: tmp_path)
    with subprocess.Popen(["/bin/true"]) as process:
        process.wait()
    ended, kept = process.pid, tmp_path / "kept"
    names = (f"teleop-rt-{os.getpid()}-ab", "teleop-rt-notes", f"other-{ended}-ab", "kept")
    for name in (f"teleop-rt-{ended}-ab", *names):
        (tmp_path / name).mkdir()
        (tmp_path / name / "slave.ring").touch()
    (tmp_path / f"teleop-rt-{ended}-link").symlink_to(kept)
    with new_ring_folder() as ring_folder:
        there = {path.name for path in tmp_path.iterdir() if path.is_dir()}
        assert there >= {*names, ring_folder.name}
        assert f"teleop-rt-{ended}-ab" not in there
    assert (kept / "slave.ring").exists()
    assert not ring_folder.exists()


def test_a_process_is_distinguished_from_one_that_has_ended_and_from_a_name_that_names_none():
    assert alive(os.getpid())
    assert alive(1)
    assert owner("teleop-rt-12-ab", "teleop-rt-") == 12
    for name in ("teleop-rt-012-ab", "teleop-rt-12", "teleop-rt--ab", "other-12-ab"):
        assert owner(name, "teleop-rt-") is None


def test_shared_memory_that_is_full_or_cannot_be_written_is_reported_with_what_gives_more(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(ring_folder_module, "shared_folder", lambda: tmp_path / "gone")
    with (
        pytest.raises(
            SharedMemoryError, match=r"gone: .*: No such file or directory; `df -h .*256m"
        ),
        new_ring_folder(),
    ):
        pytest.fail("there is no place for it")

    def refuse(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", refuse)
    with pytest.raises(SharedMemoryError, match="No space left on device; `df -h"):
        publish(tmp_path, "/slave", SLAVE)
