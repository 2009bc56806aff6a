"""Independent calls on the cores of this machine, with a bar for whoever watches."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from operator import call
from typing import TypeVar

from teleop_rt.batch.bar import bar
from teleop_rt.batch.forked import as_finished

T = TypeVar("T")


def in_order(what: str, calls: Iterable[Callable[[], T]], jobs: int) -> list[T]:
    """Return the results of all calls in their order, computed by `jobs` processes; -1 for all."""
    waiting = list(calls)
    found: dict[int, T] = {}
    with bar(what) as shown:
        shown(0, len(waiting))
        processes = jobs if jobs > 0 else os.cpu_count() or 1
        for index, result in as_finished(call, waiting, processes):
            found[index] = result
            shown(len(found), len(waiting))
    return [found[index] for index in range(len(waiting))]
