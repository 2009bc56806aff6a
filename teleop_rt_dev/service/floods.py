"""A flood of the link or of the control socket: a process that `stop_lab` runs beside."""

from __future__ import annotations

import contextlib
import secrets
import socket
import sys
from collections.abc import Iterator
from itertools import islice

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


if __name__ == "__main__":
    flood = {"link": _send_datagrams, "socket": _connect_and_talk}[sys.argv[1]](sys.argv[2])
    for _ in islice(flood, 100):
        pass
    print("under way", flush=True)
    for _ in flood:
        pass
