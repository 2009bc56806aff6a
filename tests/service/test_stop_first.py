"""Stop outruns everything: checks, other commands, floods; and nothing is done unasked."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from daemon_world import DaemonWorld

from teleop_rt.service import config_check, server
from teleop_rt.service.config_check import ConfigCheck
from teleop_rt.service.connections import MOST_CLIENTS, Connections
from teleop_rt.service.local_socket import bind, connect
from teleop_rt.service.mailbox import ALIVE_NS, Command, CommandBox, Reply
from teleop_rt.slave.faults import State


class Endless:
    """A check that hangs until it is ended."""

    ended = 0

    def __init__(self, _description: object) -> None:
        self.running = True

    def end(self) -> None:
        Endless.ended += 1
        self.running = False

    def problem(self) -> str:
        return "it hung"


@pytest.fixture
def running(tmp_path):
    """A daemon whose axis follows the master."""
    world = DaemonWorld(tmp_path)
    world.until(State.DISARMED)
    world.ask("arm")
    world.ask("start")
    world.until(State.RUN)
    return world


def result(answering, ticks=lambda: None) -> dict:
    while True:
        try:
            next(answering)
        except StopIteration as done:
            return done.value
        ticks()


def test_a_stop_does_not_wait_for_a_check_that_hangs_or_for_five_commands(running, monkeypatch):
    monkeypatch.setattr(server, "ConfigCheck", Endless)
    asked = [running.server.handle(b'{"command": "reload"}')]
    asked += [running.server.handle(b'{"command": "%s"}' % name) for name in (b"arm", b"start") * 3]
    for one in asked:
        next(one)
    stop = running.server.handle(b'{"command": "stop"}')
    next(stop)
    assert running.ticks(1) is State.DISARMED
    assert result(stop, lambda: running.ticks(1))["status"]["state"] == "DISARMED"
    Endless.running = False
    asked[0].close()
    assert Endless.ended
    for one in asked[1:]:
        assert "a stop came" in result(one)["problem"]
    assert running.ticks(100) is State.DISARMED
    assert not running.rig.drive.powered


def test_an_arm_asked_before_a_stop_and_not_seen_is_dropped(running):
    running.ask("stop")
    box = CommandBox(running.ring_folder)
    number = box.request(Command.ARM)
    stop = box.ask_to_stop()
    assert running.ticks(1) is State.DISARMED
    assert box.has_stopped(stop)
    assert box.reply(number) is Reply.STOPPED
    assert running.ticks(200) is State.DISARMED


def test_an_arm_left_behind_by_a_killed_server_is_not_carried_out(running, monkeypatch):
    running.ask("stop")
    box = CommandBox(running.ring_folder)
    number = box.request(Command.ARM)  # the loop is away; the server that asked is killed
    later = box._words[4] + 1  # its deadline, which the loop reads from the same place
    monkeypatch.setattr(
        "teleop_rt.service.mailbox.time", SimpleNamespace(monotonic_ns=lambda: later)
    )
    assert running.ticks(200) is State.DISARMED
    assert box.reply(number) is Reply.TOO_LATE
    assert not running.rig.drive.powered


def test_a_request_counts_while_its_server_looks_after_it(tmp_path, monkeypatch):
    loop = CommandBox(tmp_path, create=True)
    box = CommandBox(tmp_path)
    now = SimpleNamespace(ns=10**12)
    monkeypatch.setattr(
        "teleop_rt.service.mailbox.time", SimpleNamespace(monotonic_ns=lambda: now.ns)
    )
    box.request(Command.RESET)
    for _ in range(10):
        now.ns += ALIVE_NS
        box.keep_alive()
    assert loop.poll() is Command.RESET


class ServedSocket:
    """A control socket with clients, and their requests."""

    def __init__(self, folder) -> None:
        self.place = folder / "control"
        self.asked: list[bytes] = []
        self.listening = bind(self.place)
        self.connections = Connections(self.handle, self.listening)

    def end(self, clients: list[socket.socket]) -> None:
        for one in clients:
            one.close()
        while self.connections.clients:
            self.connections.serve_once(0.0)
        self.listening.close()

    def handle(self, request):
        self.asked.append(request)
        if request == b"slow":
            while True:
                yield
        return {"asked": request.decode()}

    def client(self, *words: bytes) -> socket.socket:
        one = connect(self.place, 1.0)
        for word in words:
            one.sendall(word)
        return one


def test_a_stop_is_taken_in_at_once_among_silent_talkative_and_slow_clients(tmp_path):
    served = ServedSocket(tmp_path)
    clients = []
    for kind in (b"", b"half", b"slow\n") * 30:
        clients.append(served.client(kind) if kind else served.client())
        served.connections.serve_once(0.0)
    served.connections.serve_once(0.0)
    assert served.asked.count(b"slow") == 30
    stopping = served.client(b"stop\n")
    served.connections.serve_once(0.0)
    served.connections.serve_once(0.0)
    assert served.asked[-1] == b"stop"
    assert stopping.recv(100) == b'{"asked": "stop"}\n'
    served.end([*clients, stopping])


def test_a_stop_overtakes_requests_that_were_accepted_before_it(tmp_path):
    served = ServedSocket(tmp_path)
    clients = [served.client(b"status\n") for _ in range(40)]
    clients.append(served.client(b"stop\n"))
    served.connections.serve_once(0.0)
    assert served.asked[0] == b"stop"
    while len(served.asked) < len(clients):
        served.connections.serve_once(0.0)
    assert served.asked.count(b"status") == 40
    served.end(clients)


def test_more_clients_than_there_is_room_for_drop_the_longest_silent_one(tmp_path):
    served = ServedSocket(tmp_path)
    clients = []
    for _ in range(260):
        clients.append(served.client())
        served.connections.serve_once(0.0)
    assert len(served.connections.clients) <= 200
    clients.append(served.client(b"stop\n"))
    served.connections.serve_once(0.0)
    served.connections.serve_once(0.0)
    assert served.asked == [b"stop"]
    served.end(clients)


CROWD = """
import socket, sys
crowd = []
for _ in range(260):
    one = socket.socket(socket.AF_UNIX)
    one.connect(sys.argv[1])
    crowd.append(one)
sys.stdin.read()
"""


def test_a_process_that_takes_every_place_takes_none_of_another_process(tmp_path):
    served = ServedSocket(tmp_path)
    first = served.client()  # connected, and about to send its command
    served.connections.serve_once(0.0)
    words = [sys.executable, "-c", CROWD, str(served.place)]
    with subprocess.Popen(words, stdin=subprocess.PIPE) as crowd:
        while len(served.connections.clients) < MOST_CLIENTS:
            served.connections.serve_once(0.01)
        for _ in range(100):
            served.connections.serve_once(0.001)
        first.sendall(b"stop\n")
        served.connections.serve_once(0.0)
        assert served.asked == [b"stop"]
        assert first.recv(100) == b'{"asked": "stop"}\n'
        assert len(served.connections.clients) <= MOST_CLIENTS
        assert crowd.stdin is not None
        crowd.stdin.close()
    served.end([first])


def test_a_check_that_hangs_is_ended_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(config_check, "LONGEST_S", 1.0)
    check = ConfigCheck({"trial_file": str(tmp_path / "trial.yaml"), "overrides": []})
    os.kill(check.process.pid, signal.SIGSTOP)
    while check.running:
        os.sched_yield()
    assert "more than 1 s" in check.problem()
    check.end()


def test_a_check_has_bounds_of_time_and_memory_and_is_what_ends_where_there_is_none_left(tmp_path):
    trial = tmp_path / "trial.yaml"
    trial.write_text("{}")
    check = ConfigCheck({"trial_file": str(trial), "overrides": []})
    process = Path(f"/proc/{check.process.pid}")
    limits = {line[:26].strip(): line[26:].split()[:2] for line in limits_of(process)}
    first = (process / "oom_score_adj").read_text().strip()
    check.end()
    assert limits["Max cpu time"] == [str(config_check.CPU_S)] * 2
    assert limits["Max address space"] == [str(config_check.MOST_BYTES)] * 2
    assert first == config_check.ENDED_FIRST
    assert Path("/proc/self/oom_score_adj").read_text().strip() != first


def limits_of(process: Path) -> list[str]:
    return (process / "limits").read_text().splitlines()
