"""Reports trouble with the link beside a master that was started alone.

A thread of its own prints: the loop never writes to a terminal, which may block.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

from teleop_rt.link.troubles import NOTHING_TROUBLE, SILENT_TROUBLE, TROUBLES
from teleop_rt.realtime.parent import Emit

_PERIOD_S = 0.5  # of the look at the link: an operator's patience, no load for the loop


class Ended(Protocol):
    """The part of `threading.Event` that ends the reports."""

    def wait(self, timeout: float) -> bool:
        """Wait for the end; return whether it has come."""


def report_link(code: Callable[[], int], emit: Emit, ended: Ended) -> None:
    """Report each new trouble, and the link's return after one, until the end.

    `code` returns the present trouble's place in TROUBLES, 0 without one. Silence is trouble only
    where the next look finds it, too: before a healthy link engages nothing has arrived either.
    """
    before = last = 0
    while not ended.wait(_PERIOD_S):
        now = code()
        lasts, last = now == last, now
        if now in {NOTHING_TROUBLE, SILENT_TROUBLE} and not lasts:
            continue
        if now != before:
            name, cause = TROUBLES[now] if now else (None, "the slave answers")
            with suppress(OSError):  # nobody reads it any more
                emit("link", trouble=name, cause=cause)
        before = now


@contextmanager
def link_reported(code: Callable[[], int], emit: Emit) -> Iterator[None]:
    """Report the link's changes while the function inside runs."""
    ended = threading.Event()
    thread = threading.Thread(target=report_link, args=(code, emit, ended), daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
