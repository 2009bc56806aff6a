"""A simulated rig and its daemon as processes of their own, as systemd starts them."""

from __future__ import annotations

import json
import os
import re
import secrets
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from teleop_rt.link.keys import generate_key
from teleop_rt.realtime.ring import RingReader
from teleop_rt.service.client import PATIENCE_S, DaemonError, ask
from teleop_rt.service.place import places
from teleop_rt.signals import SLAVE, columns
from teleop_rt.slave.faults import State
from teleop_rt_dev.paths import SILICONE

READY = b"READY=1"
USAGE = 2  # exit code of refused arguments
POLL_S = 0.02
"""Between two questions: without it a wait takes a whole core, which the daemon then lacks."""


def children(parent: int) -> list[int]:
    tasks = Path(f"/proc/{parent}/task/{parent}/children")
    return [int(pid) for pid in tasks.read_text().split()]


class Lab:
    """A simulated rig and its daemon, started as a lab starts them."""

    def __init__(self, folder: Path, *changes: str, trial: Path = SILICONE) -> None:
        self.folder = folder
        self.manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.manager.bind(str(folder / "notify"))
        self.manager.settimeout(0.0)
        credentials = folder / "credentials"
        credentials.mkdir()
        self.environment = os.environ | {
            "TELEOP_RT_RUN_DIR": str(folder / "run"),
            "NOTIFY_SOCKET": str(folder / "notify"),
            "WATCHDOG_USEC": "400000",
            "CREDENTIALS_DIRECTORY": str(credentials),
        }
        # Real-time tests share the machine: late ticks are another test's matter.
        self.channel = f"lab-{secrets.token_hex(4)}"  # hex alone may read as a number
        self.trial = [str(trial)]
        port = f"link.slave_port={20000 + secrets.randbelow(10000)}"
        for change in (f"rig.axis.bus.channel={self.channel}", port, *changes):
            self.trial += ["--set", change]
        self.processes: list[subprocess.Popen[str]] = []
        generate_key(credentials / "link.key")
        (credentials / "link.key").chmod(0o440)  # as systemd's access list shows

    def __enter__(self) -> Self:
        try:
            self.rig = self.start("sim")
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def start(self, name: str, *more: str) -> subprocess.Popen[str]:
        words = [name, *self.trial, "--out", str(self.folder / name), *more]
        process = subprocess.Popen(
            [sys.executable, "-m", "teleop_rt", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=self.environment,
        )
        self.processes.append(process)
        assert process.stdout is not None
        reported = process.stdout.readline()
        if reported == "" and process.wait() == USAGE:
            raise AssertionError(f"{name} did not start: {process.communicate()[1]}")
        assert reported in {f"{name}: ready\n", ""}, reported
        return process

    def restart(self) -> subprocess.Popen[str]:
        """Start the next daemon on the rig; it records into a folder of its own."""
        self.folder = self.folder / "next"
        self.folder.mkdir()
        return self.start("slave")

    def heard_while(self, command: str) -> list[bytes]:
        """Give a command; return the manager's messages, but for feeding, up to the next READY."""
        self.heard()
        with ThreadPoolExecutor(1) as asking:
            asked = asking.submit(self.call, command)
            reported: list[bytes] = []
            while READY not in reported:
                assert self.processes[-1].poll() is None
                reported += [one for one in self.heard() if one != b"WATCHDOG=1"]
                time.sleep(0.01)
            assert asked.result()[0] == 0
        return reported

    def call(self, *words: object) -> tuple[int, str, str]:
        done = subprocess.run(
            [sys.executable, "-m", "teleop_rt", *map(str, words)],
            capture_output=True,
            text=True,
            check=False,
            env=self.environment,
        )
        return done.returncode, done.stdout, done.stderr

    def status(self) -> dict[str, Any]:
        code, out, errors = self.call("status", "--json")
        assert code == 0, errors
        found: dict[str, Any] = json.loads(out)
        return found

    def settled(self) -> dict[str, Any]:
        """Return the status once a first sample has come, which is after the daemon is ready."""
        while (status := self.polled())["state"] in {"BOOT", "SELFTEST"}:
            time.sleep(POLL_S)
        return status

    def polled(self) -> dict[str, Any]:
        """Return the status as `teleop-rt status` does, without a process for each question."""
        last_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                answer = ask(places(self.environment)[0], "status")
                if answer["ok"]:
                    found: dict[str, Any] = answer["status"]
                    return found
            except (IndexError, DaemonError):
                if time.monotonic() > last_s:
                    raise
            time.sleep(POLL_S)

    def state(self) -> float:
        """Return the daemon's newest state; a daemon that has ended was armed before."""
        try:
            row = RingReader(places(self.environment)[0].ring_folder / "slave.ring").newest()
        except (IndexError, FileNotFoundError):
            return State.FAULT
        return State.BOOT if row is None else row[columns(SLAVE)["state"]]

    def helper(self, name: str) -> int | None:
        """Return the process id of the daemon's helper of this name, None while there is none."""
        for keeper in children(self.processes[-1].pid):
            words = Path(f"/proc/{keeper}/cmdline").read_bytes().split(b"\0")
            if name.encode() in words:
                return next(iter(children(keeper)), None)
        return None

    @contextmanager
    def page(self) -> Iterator[str]:
        """Serve the live page, which has to find this daemon by itself; give its address."""
        words = [sys.executable, "-m", "teleop_rt", "live", "--port", "0"]
        with subprocess.Popen(
            words, stdout=subprocess.PIPE, text=True, env=self.environment
        ) as server:
            try:
                assert server.stdout is not None
                reported = re.search(r"http://\S+", server.stdout.readline())
                assert reported is not None
                yield reported.group()
            finally:
                server.terminate()

    def heard(self) -> list[bytes]:
        messages = []
        while True:
            try:
                messages.append(self.manager.recv(200))
            except BlockingIOError:
                return messages

    def close(self) -> None:
        for process in self.processes:
            if process.poll() is None:
                process.terminate()
            process.communicate()
        self.manager.close()
