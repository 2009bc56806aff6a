import os
import subprocess
import sys

import pytest

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.realtime import rig_locks
from teleop_rt.realtime.histogram import TimingHistograms
from teleop_rt.realtime.rig_locks import (
    BusyError,
    PlaceError,
    devices_held,
    name_of,
    run_folder,
    simulation_held,
)
from teleop_rt.realtime.ring_folder import describe, new_ring_folder, publish
from teleop_rt.service import place
from teleop_rt.service.client import DaemonError, find
from teleop_rt.service.commands import lines, show
from teleop_rt.service.local_socket import bind
from teleop_rt.service.mailbox import CommandBox
from teleop_rt.service.place import Claim, claimed, places
from teleop_rt_dev.paths import SILICONE
from teleop_rt_drivers import registry

pytestmark = pytest.mark.usefixtures("run_dir")


@pytest.fixture
def own_ring_folder(tmp_path):
    folder = tmp_path / f"teleop-rt-{os.getpid()}-ab"
    folder.mkdir()
    return folder


def test_a_rig_is_held_by_one_process_and_the_second_one_names_it(ring_folder):
    with claimed("Bench rig", ["can0", "/dev/ttyS1"], ring_folder):
        for name, devices in (("Bench rig", ["can0"]), ("A copy", ["/dev/ttyS1", "can1"])):
            with pytest.raises(BusyError, match=f"in use by process {os.getpid()}, which holds"):
                claimed(name, devices, ring_folder).__enter__()
        with (
            claimed("Bench rig", ["can1"], ring_folder),
            claimed("Another rig", ["can2"], ring_folder),
        ):
            names = [place.name for place in places()]
            assert names == ["another-rig", "bench-rig-2", "bench-rig"]
    assert places() == []
    with claimed("Bench rig", ["can0"], ring_folder) as place:
        assert place.name == "bench-rig"


def test_what_a_killed_daemon_left_is_no_obstacle(ring_folder, run_dir):
    script = (
        "import os, signal, sys; from pathlib import Path\n"
        "from teleop_rt.service.place import claimed\n"
        "claim = claimed('Bench rig', ['can0'], Path(sys.argv[1])); place = claim.__enter__()\n"
        "place.socket.touch(); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", script, ring_folder], check=False)
    (left,) = places()
    assert left.socket.exists()
    assert len(list(run_dir.glob("teleop-rt-can0-*.lock"))) == 1
    other = ring_folder.with_name("teleop-rt-2-def")
    other.mkdir()
    with claimed("Bench rig", ["can0"], other) as place:
        assert place.ring_folder.readlink() == other
        assert not place.socket.exists()
        assert not ring_folder.exists()


def test_the_run_folder_is_the_chosen_one_systemds_the_users_or_a_temporary_one(tmp_path):
    assert str(run_folder({"TELEOP_RT_RUN_DIR": "/a", "RUNTIME_DIRECTORY": "/b"})) == "/a"
    assert str(run_folder({"RUNTIME_DIRECTORY": "/b", "XDG_RUNTIME_DIR": "/c"})) == "/b"
    assert str(run_folder({"XDG_RUNTIME_DIR": "/c"})) == "/c/teleop-rt"
    assert run_folder({}).name == f"teleop-rt-{os.getuid()}"


def test_a_rigs_name_becomes_a_file_name():
    assert name_of("Simulated CANopen rig (2)") == "simulated-canopen-rig-2"
    assert name_of("../..") == "rig"
    assert len(name_of("x" * 300)) == 60


def test_the_socket_is_for_owner_and_group_however_long_its_path(tmp_path):
    folder = tmp_path / ("long" * 40)
    folder.mkdir()
    with bind(folder / "a.socket"):
        assert (folder / "a.socket").stat().st_mode & 0o777 == 0o660


def test_no_daemon_and_several_daemons_are_reported_with_the_next_step(ring_folder):
    with pytest.raises(DaemonError, match="start one with `teleop-rt slave"):
        find(None)
    with claimed("One", ["can0"], ring_folder), claimed("Two", ["can1"], ring_folder):
        with pytest.raises(DaemonError, match="choose one with --rig, one of: one, two"):
            find(None)
        assert find("Two").name == "two"
        with pytest.raises(DaemonError, match="of the rig 'Three'"):
            find("Three")
        with pytest.raises(DaemonError, match=r"of process 2 is"):
            find(None, 2)


TRY_TO_WRITE = """
import os, sys
from pathlib import Path
os.setgroups([])
os.setgid(int(sys.argv[2])); os.setuid(65534)
reached = []
for path in sorted(Path(sys.argv[1]).iterdir()) if os.access(sys.argv[1], os.R_OK) else ():
    try:
        os.close(os.open(path, os.O_RDWR))
    except PermissionError:
        continue
    reached.append(path.name)
try:
    (Path(sys.argv[1]) / "made").touch()
except PermissionError:
    print(reached)
"""


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be another user")
@pytest.mark.parametrize("group", [0, 65534], ids=["of the group", "another user"])
def test_no_other_user_writes_to_a_daemons_shared_memory(group):
    before = os.umask(0)  # the daemon's user may have the laxest one
    try:
        with new_ring_folder() as ring_folder, claimed("rig", [], ring_folder):
            publish(ring_folder, "/slave", [])
            describe(ring_folder, {})
            TimingHistograms(ring_folder, create=True)
            CommandBox(ring_folder, create=True)
            assert len(list(ring_folder.iterdir())) >= 5
            argv = [sys.executable, "-c", TRY_TO_WRITE, str(ring_folder), str(group)]
            tried = subprocess.run(argv, capture_output=True, text=True, check=True)
    finally:
        os.umask(before)
    assert tried.stdout == "[]\n"


def trap_of(kind, path, victim):
    if kind == "link":
        path.symlink_to(victim)
    elif kind == "second name":
        path.hardlink_to(victim)
    else:
        os.mkfifo(path, 0o644)


@pytest.mark.parametrize("kind", ["link", "second name", "pipe"])
def test_a_lock_that_leads_elsewhere_is_refused_and_what_it_leads_to_stays(
    ring_folder, run_dir, tmp_path, kind
):
    """Locks lie in everybody's folder: another user can put files with their names there."""
    with claimed("Bench rig", ["can0"], ring_folder):
        (lock,) = run_dir.glob("teleop-rt-can0-*.lock")
    lock.unlink()
    victim = tmp_path / "link.key"
    victim.write_text("a key of ours")
    trap_of(kind, lock, victim)
    with pytest.raises(PlaceError, match="cannot lock this rig"):
        claimed("Bench rig", ["can0"], ring_folder).__enter__()
    assert victim.read_text() == "a key of ours"
    lock.unlink()
    with claimed("Bench rig", ["can0"], ring_folder):
        pass


ANOTHERS = pytest.param(
    "another's", marks=pytest.mark.skipif(os.getuid() != 0, reason="only root can give files away")
)


@pytest.mark.parametrize("trap", [ANOTHERS, "everybody's", "link"])
def test_a_folder_that_another_user_made_under_our_name_gets_no_daemon_and_no_command(
    ring_folder, tmp_path, monkeypatch, trap
):
    """In /tmp anybody can make it first, and list daemons that do not exist."""
    for name in ("TELEOP_RT_RUN_DIR", "RUNTIME_DIRECTORY", "XDG_RUNTIME_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(rig_locks.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(rig_locks, "_LOCKS", tmp_path)
    monkeypatch.setattr(place, "_SERVICE", tmp_path / "service")
    folder = tmp_path / f"teleop-rt-{os.getuid()}"
    with claimed("Bench rig", ["can0"], ring_folder):
        assert [one.name for one in places()] == ["bench-rig"]
    if trap == "link":
        folder.rename(tmp_path / "elsewhere")
        folder.symlink_to(tmp_path / "elsewhere")
    elif trap == "everybody's":
        folder.chmod(0o777)
    else:
        os.chown(folder, 4321, -1)
    left = tmp_path / f"teleop-rt-{os.getpid()}-kept"
    left.mkdir()
    (folder / "bench-rig.rings").symlink_to(left)
    assert places() == []
    with pytest.raises(PlaceError, match="another user made this folder"):
        claimed("Bench rig", ["can0"], ring_folder).__enter__()
    assert left.exists()


def test_a_folder_that_cannot_be_written_is_refused_with_the_next_step(
    ring_folder, tmp_path, monkeypatch
):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TELEOP_RT_RUN_DIR", str(tmp_path / "file" / "run"))
    with pytest.raises(PlaceError, match="Not a directory; name another folder in TEL"):
        claimed("Bench rig", ["can0"], ring_folder).__enter__()


def test_a_read_only_disk_is_reported_with_the_next_step(ring_folder, run_dir, monkeypatch):
    def refused(*_args, **_options):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("pathlib.Path.touch", refused)
    with pytest.raises(PlaceError, match=f"{run_dir}.*Read-only file system.*TELEOP_RT_RUN_DIR"):
        claimed("Bench rig", ["can0"], ring_folder).__enter__()


def test_a_daemon_of_another_version_is_reported_by_both_versions(ring_folder, capsys):
    old = {"rig": "r", "state": "RUN", "trial": "t", "pid": 1, "version": "0.0.1"}
    with pytest.raises(DaemonError, match=r"the daemon is teleop-rt 0\.0\.1 and this is .*--json"):
        show(old, lines)
    assert capsys.readouterr().out == ""


def test_a_rig_stays_held_and_found_from_one_config_to_the_next(ring_folder, own_ring_folder):
    with Claim() as claim:
        first = claim.take("Bench rig", ["can0", "can1"], ring_folder)
        second = claim.take("Other name", ["can1", "can2"], own_ring_folder)
        assert (first.name, second.name) == ("bench-rig", "other-name")
        assert [place.name for place in places()] == ["other-name"]
        with claimed("Bench rig", ["can0"], ring_folder), pytest.raises(BusyError):
            claim.take("Bench rig", ["can0"], ring_folder)
        assert [place.name for place in places()] == ["other-name"]
        for held in ("can1", "can2"):
            with pytest.raises(BusyError):
                claimed("A copy", [held], ring_folder).__enter__()
    with claimed("Bench rig", ["can1", "can2"], ring_folder) as place:
        assert place.name == "bench-rig"


def test_a_bus_is_simulated_once_beside_the_daemon_that_uses_it(call, tmp_path):
    folder = f"rig.axis.folder={tmp_path}/ports"
    rig = ("--set", "rig=../rigs/simulated_serial.yaml", "--set", folder)
    reached_by = registry.reached_by(load_trial_file(SILICONE, [*rig[1::2]]).rig)
    with simulation_held(reached_by), devices_held(reached_by):
        code, _, error = call("sim", SILICONE, *rig, "--out", tmp_path / "sim")
    assert code == 2
    assert f"this rig is simulated already, by process {os.getpid()}, which holds" in error
    assert not (tmp_path / "sim").exists()
