"""Commands to a daemon: found, asked, asked again, or refused with the next step."""

import json
import os
from threading import Thread

import pytest

from teleop_rt.service import client
from teleop_rt.service.client import DaemonError, find, request, request_reload
from teleop_rt.service.local_socket import bind
from teleop_rt.service.place import (
    Claim,
    claimed,
    refuse_commands,
)

pytestmark = pytest.mark.usefixtures("run_dir")


def test_a_run_is_reported_at_once_as_taking_no_commands_and_never_taken_for_the_daemon(
    ring_folder, tmp_path, monkeypatch
):
    asked = Passing()
    monkeypatch.setattr(client, "time", asked)
    with claimed("Run", ["can0"], ring_folder):
        refuse_commands(ring_folder)
        with pytest.raises(DaemonError, match=r"runs a trial on the rig 'run' and takes no comm"):
            request("status", None)
        assert asked.monotonic() == 0.0
        daemon = tmp_path / "teleop-rt-1-daemon"
        daemon.mkdir()
        with claimed("Daemon", ["can1"], daemon):
            assert find(None).name == "daemon"  # which is just starting


class Passing:
    """Time that passes only while a client waits; the daemon then executes its requests."""

    def __init__(self, *steps) -> None:
        self._steps = list(steps)
        self._now_s = 0.0

    def monotonic(self) -> float:
        return self._now_s

    def sleep(self, seconds: float) -> None:
        self._now_s += seconds
        if self._steps:
            self._steps.pop(0)()


@pytest.fixture
def own_ring_folder(tmp_path):
    folder = tmp_path / f"teleop-rt-{os.getpid()}-ab"
    folder.mkdir()
    return folder


class Served:
    """A control socket that answers each client as configured, or closes silently."""

    def __init__(self, place, *answers) -> None:
        self.heard = []
        self._answers = list(answers)
        self._listening = bind(place.socket)
        self._thread = Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        for answer in self._answers:
            client, _ = self._listening.accept()
            with client:
                self.heard.append(json.loads(client.recv(4096))["command"])
                client.sendall(answer)

    def end(self) -> None:
        self._thread.join()
        self._listening.close()


def test_a_daemon_without_a_command_server_is_distinguished_from_none(own_ring_folder, monkeypatch):
    monkeypatch.setattr(client, "time", Passing())
    result = f"process {os.getpid()} runs the rig 'bench-rig' but"
    with claimed("Bench rig", ["can0"], own_ring_folder), pytest.raises(DaemonError, match=result):
        request("status", None)
    with pytest.raises(DaemonError, match=r"no daemon is running here.*some seconds"):
        request("status", None)


def test_a_daemon_between_two_configs_is_waited_for(own_ring_folder, monkeypatch):
    starting, well = b'{"ok": false, "problem": "starting", "again": true}\n', b'{"ok": true}\n'
    with Claim() as claim:
        place = claim.take("Bench rig", ["can0"], own_ring_folder)
        own_ring_folder.rmdir()  # the rings of the config before
        after = own_ring_folder.with_name(f"teleop-rt-{os.getpid()}-cd")
        after.mkdir()
        served = []
        passing = Passing(
            lambda: claim.take("Bench rig", ["can0"], after),
            lambda: served.append(Served(place, b"", starting, well)),
        )
        monkeypatch.setattr(client, "time", passing)
        assert request("status", "Bench rig", os.getpid()) == {"ok": True}
        served[0].end()
        assert served[0].heard == ["status"] * 3


def test_a_run_beside_a_daemon_is_not_taken_for_one(ring_folder, own_ring_folder):
    with (
        claimed("Run", ["can0"], ring_folder),
        claimed("Daemon", ["can1"], own_ring_folder) as daemon,
    ):
        bind(daemon.socket).close()  # as between two configs
        assert find() == daemon
        assert find("Run").name == "run"


def test_a_command_whose_answer_is_lost_is_not_given_twice(own_ring_folder, monkeypatch):
    monkeypatch.setattr(client, "time", Passing())
    with claimed("Bench rig", ["can0"], own_ring_folder) as place:
        served = Served(place, b"")
        with pytest.raises(DaemonError, match="the daemon does not answer"):
            request("start", None)
        served.end()
    assert served.heard == ["start"]


def test_a_stop_whose_answer_is_lost_is_given_again(own_ring_folder, monkeypatch):
    """It does no harm twice, and a daemon that reloads breaks off whoever asks."""
    monkeypatch.setattr(client, "time", Passing())
    with claimed("Bench rig", ["can0"], own_ring_folder) as place:
        served = Served(place, b"", b'{"ok": true}\n')
        assert request("stop", None) == {"ok": True}
        served.end()
    assert served.heard == ["stop", "stop"]


def test_a_stop_that_nobody_takes_is_reported_with_what_stops_the_axis(
    own_ring_folder, monkeypatch
):
    """A command server that hangs takes connections in, for the kernel does so."""
    monkeypatch.setattr(client, "time", Passing())
    monkeypatch.setitem(client._TIMEOUT_S, "stop", 0.005)
    said = rf"`kill {os.getpid()}` \(`systemctl stop`\) stops"
    with (
        claimed("Bench rig", ["can0"], own_ring_folder) as place,
        bind(place.socket),
        pytest.raises(DaemonError, match=said),
    ):
        request("stop", None)


def test_a_stop_asks_a_command_server_that_hangs_for_10_to_12_seconds(own_ring_folder, monkeypatch):
    clock = Passing()

    def hang(_socket, patience_s: float) -> None:
        clock.sleep(patience_s)
        raise TimeoutError

    monkeypatch.setattr(client, "time", clock)
    monkeypatch.setattr(client, "connect", hang)
    with (
        claimed("Bench rig", ["can0"], own_ring_folder) as place,
        bind(place.socket),
        pytest.raises(DaemonError, match=rf"`kill {os.getpid()}`"),
    ):
        request("stop", None)
    assert 10.0 < clock.monotonic() <= 12.0


def test_a_reload_is_reported_once_the_daemon_runs_with_its_config(own_ring_folder, monkeypatch):
    monkeypatch.setattr(client, "time", Passing())
    before, after = (
        json.dumps({"ok": True, "status": {"folder": folder}}).encode() + b"\n"
        for folder in ("run", "run-2")
    )
    with claimed("Bench rig", ["can0"], own_ring_folder) as place:
        served = Served(place, before, before, b"", after)
        assert request_reload(None)["status"]["folder"] == "run-2"
        served.end()
    assert served.heard == ["reload", "status", "status", "status"]


def test_a_user_who_may_not_command_the_daemon_is_refused_at_once(own_ring_folder, monkeypatch):
    def refused(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(client, "connect", refused)
    with (
        claimed("Bench rig", ["can0"], own_ring_folder),
        pytest.raises(DaemonError, match="may not"),
    ):
        request("status", None)
