"""Calls on the cores of this machine, in processes forked from this one.

A forked process has the modules and compiled kernels of its parent, and starts in milliseconds. A
fresh one imports and loads them again, for 2.3 s of processor time.
"""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator, Sequence, Set
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import Context
from multiprocessing.process import BaseProcess
from types import FrameType
from typing import TypeVar

from teleop_rt.errors import ExpectedError
from teleop_rt.realtime.parent import end_with_parent

T = TypeVar("T")
R = TypeVar("R")


class WorkerLostError(ExpectedError):
    """A worker process ended while it worked; the message gives the next step."""

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

    Raises WorkerLostError where a process ends before its result, KeyboardInterrupt after one.
    """
    count = min(processes, len(items))
    if count <= 1:
        yield from ((index, call(item)) for index, item in enumerate(items))
        return
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("fork"), initializer=_obey)
    with _interrupts_end_all_but(others) as interrupts:
        try:
            indices = {pool.submit(_unheard, call, item): n for n, item in enumerate(items)}
            if interrupts:  # perhaps before there was a worker to end
                _end_all_but(others)
            for future in as_completed(indices):
                yield indices.pop(future), future.result()
        except BaseException as error:  # a fault does not wait for running cases
            _end_all_but(others)
            if isinstance(error, BrokenProcessPool) and not interrupts:
                raise WorkerLostError(error) from None
            if not interrupts:
                raise
        finally:
            pool.shutdown(cancel_futures=True)
    if interrupts:
        raise KeyboardInterrupt


def _end_all_but(others: Set[BaseProcess]) -> None:
    for worker in set(multiprocessing.active_children()) - others:
        worker.terminate()


@contextmanager
def _interrupts_end_all_but(others: Set[BaseProcess]) -> Iterator[list[int]]:
    """Let an interrupt end the workers, and give those that came, in the main thread.

    The pool finds its workers gone and ends by itself. An exception that is raised anywhere in it
    could leave one of its locks taken for ever. Where interrupts are ignored, they stay so.
    """
    came: list[int] = []
    heard = threading.current_thread() is threading.main_thread()
    if not heard or signal.getsignal(signal.SIGINT) in {signal.SIG_IGN, None}:
        yield came
        return

    def end(number: int, _: FrameType | None) -> None:
        came.append(number)
        _end_all_but(others)

    before = signal.signal(signal.SIGINT, end)
    try:
        yield came
    finally:
        signal.signal(signal.SIGINT, before)


def _obey() -> None:
    """Leave interrupts to the parent, which ends this process, and end with it in any case."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    end_with_parent()


def _unheard(call: Callable[[T], R], item: T) -> R:
    """Call without the parent's context: its listeners draw on a terminal that is the parent's."""
    return Context().run(call, item)
