"""How long a stop takes from its request to the drive's order, while the daemon is kept busy."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from teleop_rt.realtime.state_file import found
from teleop_rt.service.client import ask
from teleop_rt.service.keeper import SUFFIX
from teleop_rt.service.local_socket import connect
from teleop_rt.service.place import DaemonFiles, places
from teleop_rt_dev.paths import SILICONE, TRIALS
from teleop_rt_dev.service.lab import Lab
from teleop_rt_drivers.canopen.cia402 import ENABLE_OPERATION
from teleop_rt_drivers.unix_bus import UnixBus

RATE_HZ = 200  # slower than the shipped 1 kHz: a machine under a flood misses few ticks
ORDER, SYNC = 0x230, 0x80
"""The CAN ids of the drive's commands and of SYNC, which begins each tick, on the simulated rig."""
PATIENCE_S = 10.0  # for one frame or answer, on a busy machine too
BOMB = "\n".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}' if n else 'x'] * 9)}]" for n in range(9))

Busy = Callable[["StopLab"], Iterator[None]]


@dataclass(frozen=True, slots=True)
class StopTime:
    """From the request of a stop to the frame that orders it, as the sender stamped it.

    For `waited_ticks` of them no core was free for the command server, or for who asked.
    """

    seconds: float
    ticks: int
    waited_ticks: float


class StopLab:
    """A daemon of its own trial file, armed before each stop."""

    def __init__(self, folder: Path) -> None:
        self.trial = folder / "trial.yaml"
        rig = TRIALS.parent / "rigs" / "simulated_canopen.yaml"
        self._good = SILICONE.read_text().replace("../rigs/simulated_canopen.yaml", str(rig))
        self.trial.write_text(self._good)
        self.lab = Lab(folder, f"rig.rate_hz={RATE_HZ}", trial=self.trial)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run the rig and its daemon."""
        with self.lab as lab:
            lab.start("slave")
            lab.settled()
            yield

    @property
    def place(self) -> DaemonFiles:
        """Where the daemon takes commands."""
        return places(self.lab.environment)[0]

    @property
    def port(self) -> int:
        """The port at which the slave listens."""
        (change,) = (one for one in self.lab.trial if one.startswith("link.slave_port="))
        return int(change.partition("=")[2])

    def ask(self, *commands: str) -> list[socket.socket]:
        """Ask without waiting for an answer, which comes by the sockets."""
        asked = []
        for command in commands:
            one = connect(self.place.socket, PATIENCE_S)
            one.sendall(json.dumps({"command": command}).encode() + b"\n")
            asked.append(one)
        return asked

    def checks(self) -> list[int]:
        """Return the processes that check this trial now."""
        found = []
        for entry in Path("/proc").glob("[0-9]*/cmdline"):
            try:
                words = entry.read_bytes().split(b"\0")
            except OSError:
                continue
            if b"check" in words and str(self.trial).encode() in words:
                found.append(int(entry.parent.name))
        return found

    @property
    def server(self) -> int:
        """The process of the command server."""
        state = found(self.place.ring_folder / f"commands{SUFFIX}")
        assert state is not None
        return int(state["helper"]["pid"])

    def stop_while(self, busy: Busy) -> StopTime:
        """Arm, keep the daemon busy, stop, and return how long the drive's order took."""
        while not ask(self.place, "arm")["ok"]:  # a machine that held the loop up
            ask(self.place, "reset")
        with UnixBus(self.lab.channel) as bus:
            while _order(bus) != ENABLE_OPERATION:
                pass
            with contextmanager(busy)(self):
                while bus.recv(0) is not None:
                    pass
                server, asking = self.server, os.getpid()
                before_s, asked_s = _waited_s(server) + _waited_s(asking), time.time()
                stopping = self.ask("stop")
                waited_s = _waited_s(asking) - before_s
                seconds, ticks = _await_order(bus, asked_s)
                waited_s += _waited_s(server)
            for one in stopping:
                assert b'"ok": true' in one.makefile("rb").readline()
                one.close()
        self.trial.unlink(missing_ok=True)
        self.trial.write_text(self._good)
        return StopTime(seconds, ticks, waited_s * RATE_HZ)

    def check_of(self, text: str | None, reloads: int) -> Iterator[None]:
        """Let so many reloads wait for the check of a trial; without text it is a pipe."""
        self.trial.unlink()
        if text is None:
            os.mkfifo(self.trial)
        else:
            self.trial.write_text(text)
        asked = self.ask(*["reload"] * reloads)
        while not self.checks():
            time.sleep(0.001)
        yield
        for one in asked:
            one.close()


def _order(bus: UnixBus) -> int:
    while True:
        message = bus.recv(PATIENCE_S)
        assert message is not None, "the daemon commands nothing"
        if message.arbitration_id == ORDER:
            return int.from_bytes(message.data[:2], "little")


def _waited_s(process: int) -> float:
    """Return for how long a process was ready to run without a core; 0 where Linux counts none."""
    try:
        return 1e-9 * int(Path(f"/proc/{process}/schedstat").read_text().split()[1])
    except FileNotFoundError:
        return 0.0


def _await_order(bus: UnixBus, asked_s: float) -> tuple[float, int]:
    ticks = 0
    while (message := bus.recv(PATIENCE_S)) is not None:
        late_s = message.timestamp - asked_s
        ticks += message.arbitration_id == SYNC and late_s > 0
        ordered = message.arbitration_id == ORDER and late_s > 0
        if ordered and int.from_bytes(message.data[:2], "little") != ENABLE_OPERATION:
            return late_s, ticks
    raise AssertionError("the drive never got a stop")


def idle(_: StopLab) -> Iterator[None]:
    yield


def checking(lab: StopLab) -> Iterator[None]:
    yield from lab.check_of(lab._good, 1)


def checking_five(lab: StopLab) -> Iterator[None]:
    yield from lab.check_of(lab._good, 5)


def bomb(lab: StopLab) -> Iterator[None]:
    yield from lab.check_of(BOMB, 2)


def pipe(lab: StopLab) -> Iterator[None]:
    yield from lab.check_of(None, 5)


def hanging_check(lab: StopLab) -> Iterator[None]:
    """Freeze the check of a reload: it needs no processor time, so that no limit ends it."""
    waiting = lab.check_of(lab._good, 1)
    next(waiting)
    frozen = lab.checks()
    for process in frozen:
        os.kill(process, signal.SIGSTOP)
    yield
    for process in frozen:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
    next(waiting, None)


def link_flood(lab: StopLab) -> Iterator[None]:
    """Datagrams of any content at the slave's port, as many as a process can send."""
    with _flood("link", str(lab.port)):
        yield


def socket_flood(lab: StopLab) -> Iterator[None]:
    """Clients that connect, ask, talk nonsense and stay."""
    with _flood("socket", str(lab.place.socket)):
        yield


def slow_clients(lab: StopLab) -> Iterator[None]:
    """Two hundred clients, each of which sends a byte now and then."""
    with _flood("slow", str(lab.place.socket)):
        yield


def reload_storm(lab: StopLab) -> Iterator[None]:
    """Reloads one after another, while pipes, devices, links and huge files replace the trial."""
    with _flood("reload", str(lab.place.socket), str(lab.trial)):
        yield


@contextmanager
def _flood(kind: str, *where: str) -> Iterator[None]:
    """Run a flood beside: within the process that measures it would take its time, too."""
    words = [sys.executable, str(Path(__file__).with_name("floods.py")), kind, *where]
    with subprocess.Popen(words, stdout=subprocess.PIPE) as flooding:
        try:
            assert flooding.stdout is not None
            assert flooding.stdout.readline()
            yield
        finally:
            flooding.kill()


BUSY: dict[str, Busy] = {
    "nothing else": idle,
    "a reload checks its config": checking,
    "five reloads wait": checking_five,
    "two reloads of a YAML bomb": bomb,
    "five reloads of a pipe": pipe,
    "a check of a reload hangs": hanging_check,
    "a flood on the link": link_flood,
    "a flood on the socket": socket_flood,
    "200 slow clients": slow_clients,
    "reloads, files swapped under them": reload_storm,
}
