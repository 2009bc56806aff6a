"""The control socket and its clients, none of which can hold up another, or a stop."""

from __future__ import annotations

import contextlib
import json
import selectors
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

LONGEST_REQUEST = 4096
"""Bytes of a request; a longer one is refused."""
POLL_S = 0.002
"""Period at which a request that waits for the loop is checked."""
_CLIENT_TIMEOUT_S = 2.0
"""Time for a client to send its request: then its place is given to others."""
MOST_CLIENTS = 200
"""Below the usual limit of 1024 descriptors; beyond it one of the client with most is dropped."""
_TURN_S = 0.002
"""Work on other requests before new ones are looked at: a stop waits no longer than this."""

STOP = b"stop"
"""Text of a request that is begun as it is accepted: forty requests for status take 50 ms."""

_CREDENTIALS = struct.Struct("3i")

Answer = dict[str, Any]
Answering = Generator[None, None, Answer]
Handle = Callable[[bytes], Answering]


@dataclass(slots=True)
class _Client:
    since_s: float
    process: int
    received: bytes = b""
    answering: Answering | None = None


def _process_of(peer: socket.socket) -> int:
    """Return the process that connected, by the kernel's word."""
    process, _, _ = _CREDENTIALS.unpack(
        peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    )
    return int(process)


class Connections:
    """Takes requests in, and gives each its answer when it is there.

    `handle` starts to answer a request: its work up to the first pause is done at once.
    """

    def __init__(self, handle: Handle, listening: socket.socket) -> None:
        self._handle = handle
        self._selector = selectors.DefaultSelector()
        listening.settimeout(0.0)
        self._selector.register(listening, selectors.EVENT_READ, None)
        self.clients: dict[socket.socket, _Client] = {}

    def serve_once(self, timeout_s: float) -> None:
        """Take in requests, go on with answers, and drop clients that stay silent."""
        waiting = any(client.answering for client in self.clients.values())
        for key, _ in self._selector.select(POLL_S if waiting else timeout_s):
            peer: Any = key.fileobj
            if key.data is None:
                self._accept(peer)
            else:
                self._take(peer)
        self._answer()
        late_s = time.monotonic() - _CLIENT_TIMEOUT_S
        for peer, client in list(self.clients.items()):
            if client.answering is None and client.since_s < late_s:
                self._drop(peer)

    def _accept(self, listening: socket.socket) -> None:
        for _ in range(MOST_CLIENTS):
            try:
                peer, _ = listening.accept()
            except OSError:
                return
            peer.settimeout(0.0)
            self._selector.register(peer, selectors.EVENT_READ, "client")
            self.clients[peer] = _Client(time.monotonic(), _process_of(peer))
            self._take(peer)
            if len(self.clients) > MOST_CLIENTS:
                self._drop(self._one_too_many())

    def _one_too_many(self) -> socket.socket:
        """Return the longest silent client of the process with the most: a flood drops its own."""
        count = Counter(client.process for client in self.clients.values())
        (process, _), *_ = count.most_common(1)
        of_it = [peer for peer, client in self.clients.items() if client.process == process]
        silent = (peer for peer in of_it if self.clients[peer].answering is None)
        return next(silent, of_it[0])

    def _take(self, peer: socket.socket) -> None:
        client = self.clients.get(peer)
        if client is None:
            return
        try:
            data = peer.recv(LONGEST_REQUEST)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if client.answering is not None:
            if not data:
                self._drop(peer)
            return
        request = client.received = client.received + data
        if b"\n" in request or len(request) >= LONGEST_REQUEST:
            client.answering = self._handle(request.partition(b"\n")[0])
            if STOP in request:  # any other request waits for its turn
                self._go_on(peer, client)
        elif not data:
            self._drop(peer)

    def _answer(self) -> None:
        """Go on with every answer, for a while; those not reached come first next time."""
        until_s = time.monotonic() + _TURN_S
        for peer, client in list(self.clients.items()):
            if client.answering is None:
                continue
            self._go_on(peer, client)
            if time.monotonic() > until_s:
                return

    def _go_on(self, peer: socket.socket, client: _Client) -> None:
        assert client.answering is not None  # noqa: S101 - given by both callers
        try:
            next(client.answering)
        except StopIteration as done:
            with contextlib.suppress(OSError):
                peer.sendall(json.dumps(done.value).encode() + b"\n")
            self._drop(peer)
            return
        self.clients[peer] = self.clients.pop(peer)  # to the end of the turn

    def _drop(self, peer: socket.socket) -> None:
        client = self.clients.pop(peer)
        if client.answering is not None:
            client.answering.close()
        self._selector.unregister(peer)
        peer.close()
