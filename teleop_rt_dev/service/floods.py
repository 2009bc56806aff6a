"""A flood of the link or of the control socket: a process that `stop_lab` runs beside."""

from __future__ import annotations

import contextlib
import os
import secrets
import socket
import sys
import time
from collections.abc import Callable, Iterator
from itertools import cycle, islice
from pathlib import Path

SLOW_CLIENTS, PENDING_RELOADS = 200, 20
HUGE_BYTES = 10 << 30  # of a config: a hole, which takes no disk, but would fill the memory
PAUSE_S = 0.001  # between blows: the flood is the daemon's load, not the machine's
CLIENTS = 20
"""That are left open at a time, while others come."""


def _send_datagrams(port: str) -> Iterator[None]:
    packets = [secrets.token_bytes(size) for size in (0, 1, 40, 76, 120, 400, 1400)]
    packets += [bytes([first]) + packets[4][1:] for first in range(1, 9)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        while True:
            for packet in packets:
                wire.sendto(packet, ("127.0.0.1", int(port)))
            yield


def _connected(place: str) -> socket.socket:
    one = socket.socket(socket.AF_UNIX)
    one.settimeout(1.0)
    one.connect(place)
    return one


def _connect_and_talk(place: str) -> Iterator[None]:
    kept: list[socket.socket] = []
    said = (b'{"command": "status"}\n', b"nonsense", b"{}\n")
    while True:
        for words in said:
            with contextlib.suppress(OSError):  # the server drops the longest silent one
                kept.append(_connected(place))
                kept[-1].sendall(words)
        while len(kept) > CLIENTS:
            kept.pop(0).close()
        yield


def _talk_slowly(place: str) -> Iterator[None]:
    """Each of many clients sends a byte now and then; half of them never read an answer."""
    words = b'{"command": "status"}\n'
    kept: list[tuple[socket.socket, int]] = []
    while True:
        with contextlib.suppress(OSError):
            if len(kept) < SLOW_CLIENTS:
                kept.append((_connected(place), 0))
                # A socket with a time limit waits that long for an answer, whatever recv is given.
                kept[-1][0].settimeout(0.0)
        for number, (one, sent) in enumerate(kept):
            try:
                one.sendall(words[sent : sent + 1] or b" ")
                if number % 2:
                    one.recv(4096)
            except BlockingIOError:
                pass
            except OSError:  # dropped: another comes
                one.close()
            kept[number] = one, sent + 1
        kept = [(one, sent) for one, sent in kept if one.fileno() >= 0]
        time.sleep(PAUSE_S)
        yield


def _reload_and_swap(place: str, trial: str) -> Iterator[None]:
    """Ask for reloads, while the file of the trial is another one each time."""
    path, other = Path(trial), Path(f"{trial}.other")
    good = path.read_bytes()
    pending: list[socket.socket] = []
    for kind in cycle(("good", "cut", "pipe", "loop", "missing", "huge", "device", "noise")):
        other.unlink(missing_ok=True)
        match kind:
            case "pipe":
                os.mkfifo(other)
            case "loop":
                other.symlink_to(path)  # which becomes this link itself
            case "device":
                other.symlink_to("/dev/zero")
            case "huge":
                with other.open("wb") as stream:
                    stream.truncate(HUGE_BYTES)  # a hole
            case _:
                content = {"cut": good[: len(good) // 2], "noise": secrets.token_bytes(1000)}
                other.write_bytes(content.get(kind, good))
        if kind == "missing":
            path.unlink(missing_ok=True)
        else:
            other.replace(path)
        with contextlib.suppress(OSError):
            pending.append(_connected(place))
            pending[-1].sendall(b'{"command": "reload"}\n')
        while len(pending) > PENDING_RELOADS:
            pending.pop(0).close()
        time.sleep(PAUSE_S)
        yield


FLOODS: dict[str, Callable[..., Iterator[None]]] = {
    "link": _send_datagrams,
    "socket": _connect_and_talk,
    "slow": _talk_slowly,
    "reload": _reload_and_swap,
}

if __name__ == "__main__":
    flood = FLOODS[sys.argv[1]](*sys.argv[2:])
    for _ in islice(flood, 100):
        pass
    print("under way", flush=True)
    for _ in flood:
        pass
