"""Calls on the cores of this machine, in processes forked from this one.

A forked process has the modules and compiled kernels of its parent, and starts in milliseconds. A
fresh one imports and loads them again, for 2.3 s of processor time.
"""

from __future__ import annotations

import multiprocessing
import signal
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
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("fork"), initializer=_obey)
    try:
        indices = {pool.submit(_unheard, call, item): n for n, item in enumerate(items)}
        for future in as_completed(indices):
            yield indices.pop(future), future.result()
    except BaseException as error:  # an interrupt or a fault does not wait for what is under way
        for worker in set(multiprocessing.active_children()) - others:
            worker.terminate()
        if isinstance(error, BrokenProcessPool):
            raise WorkerLostError(error) from None
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _obey() -> None:
    """Leave interrupts to the parent, which ends this process, and end with it in any case."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    end_with_parent()


def _unheard(call: Callable[[T], R], item: T) -> R:
    """Call without the parent's context: its listeners draw on a terminal that is the parent's."""
    return Context().run(call, item)
