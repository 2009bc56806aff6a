"""Compile the kernels of a tick before anything moves, with a second process beside this one."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.context import ForkProcess
from pathlib import Path
from types import FrameType
from typing import Any, cast

import numba

from teleop_rt.estimation import cycle
from teleop_rt.estimation import state as index
from teleop_rt.estimation.layout import Whole
from teleop_rt.estimation.pair_kernels import NO_PAIRS
from teleop_rt.interrupts import INTERRUPTED, INTERRUPTS
from teleop_rt.kernels.jit import kernel_folder, load_compiler

_type_of = cast("Callable[[Any], Any]", numba.typeof)
_STATE = _type_of(index.new_state()[0])
_FORK = multiprocessing.get_context("fork")  # loaded modules are not loaded again
_VECTOR, _MATRIX = numba.float64[::1], numba.float64[:, ::1]
_SAMPLES = (_VECTOR, _VECTOR, numba.boolean[::1])
_GRID = numba.int64[::1]
_PAIRED = _type_of(NO_PAIRS)
_SAMPLE = (numba.float64, numba.float64, numba.int64, numba.boolean)
_TRACE = (_MATRIX, numba.float64[:, :, ::1], numba.uint8[:, ::1])


def is_compiled(whole: Whole) -> bool:
    """Return whether the kernels of a tick are in the cache, or there is no cache."""
    mark = _mark(whole)
    return mark is None or mark.exists()


def compile_ticks(
    whole: Whole,
    here: Callable[[], object] = lambda: None,
    beside: Callable[[], object] = lambda: None,
) -> None:
    """Compile the kernels of a tick into the cache, and `here` their callers.

    A second process compiles `beside` it kernels without the tick. Must be called while this
    process has one thread.
    """
    load_compiler()
    gc.freeze()  # the collector takes a tenth of the time, to visit objects that stay loaded
    second = _FORK.Process(target=beside)
    with _ended_at_once(second):
        second.start()
        try:
            cast("Any", cycle.run_ticks).compile(types_of_ticks(whole))
            here()
        finally:
            second.join()
    if (mark := _mark(whole)) is not None:
        mark.touch()


def types_of_ticks(whole: Whole) -> tuple[Any, ...]:
    """Return the types of arguments for which the kernel of a tick is compiled."""
    how = (numba.int64, numba.boolean, _type_of(whole))
    return (_STATE, *_SAMPLES, *_TRACE, _GRID, _PAIRED, *how, *_SAMPLE)


@contextmanager
def _ended_at_once(second: ForkProcess) -> Iterator[None]:
    """Let a signal end this process and the second one while they compile, with one line.

    An exception would not do: the compiler calls back into Python, where it is lost.
    """
    this = os.getpid()

    def leave(_number: int, _frame: FrameType | None) -> None:
        if os.getpid() == this:
            if second.pid is not None:
                second.kill()
            print("interrupted: run again, compiled kernels are kept", file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)

    before = [signal.signal(number, leave) for number in INTERRUPTS]
    try:
        yield
    finally:
        for number, handler in zip(INTERRUPTS, before, strict=True):
            signal.signal(number, handler)


def _mark(whole: Whole) -> Path | None:
    """Return the file that says that all is compiled; it lies and ages with the tick's kernels."""
    folder = kernel_folder(Path(cycle.__file__))
    return None if folder is None else folder / f"compiled-{'lean' if whole is None else 'whole'}"
