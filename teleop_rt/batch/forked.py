"""Calls on the cores of this machine, in processes forked from this one.

A forked process has the modules and compiled kernels of its parent, and starts in milliseconds. A
fresh one imports and loads them again, for 2.3 s of processor time.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextvars import Context
from typing import TypeVar

from teleop_rt.errors import ExpectedError
from teleop_rt.realtime.parent import end_with_parent

T = TypeVar("T")
R = TypeVar("R")


class WorkerLostError(ExpectedError):
    """A worker process ended while it worked: says what to do next."""

    code = 1

    def __init__(self, error: Exception) -> None:
        super().__init__(
            f"a worker process ended while it worked ({type(error).__name__}; out of memory?): try"
            " fewer with --jobs; with --out the same command goes on where it stopped"
        )


def as_finished(
    call: Callable[[T], R], items: Sequence[T], processes: int
) -> Iterator[tuple[int, R]]:
    """Call with each item; yield the item's index and its result as they finish, in any order.

    One process is this one. The call, the items and the results must pickle.

    Raises WorkerLostError where a process ends before its result.
    """
    count = min(processes, len(items))
    if count <= 1:
        yield from ((index, call(item)) for index, item in enumerate(items))
        return
    forking = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(count, forking, initializer=end_with_parent) as pool:
        indices = {pool.submit(_unheard, call, item): n for n, item in enumerate(items)}
        try:
            for future in as_completed(indices):
                yield indices.pop(future), future.result()
        except BrokenProcessPool as error:
            raise WorkerLostError(error) from None
        finally:
            pool.shutdown(cancel_futures=True)


def _unheard(call: Callable[[T], R], item: T) -> R:
    """Call without the parent's context: its listeners draw on a terminal that is the parent's."""
    return Context().run(call, item)
