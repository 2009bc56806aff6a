"""Compile the kernels of a tick before anything moves, with a second process beside this one."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numba

from teleop_rt.estimation import cycle, sensing
from teleop_rt.estimation import state as c
from teleop_rt.estimation.layout import Whole
from teleop_rt.jit import kernel_folder

_type_of = cast("Callable[[Any], Any]", numba.typeof)
_STATE = _type_of(c.new_state()[0])
_SAMPLE = (numba.float64, numba.float64, numba.boolean)


def is_compiled(whole: Whole) -> bool:
    """Return whether the kernels of a tick are in the cache, or no cache can be had."""
    mark = _mark(whole)
    return mark is None or mark.exists()


def compile_ticks(whole: Whole) -> None:
    """Compile the kernels of a tick into the cache; nothing is run.

    Each half of the tick is compiled by a process of its own, and `tick` then finds both in the
    cache. A kernel that both halves use is compiled twice, to the same code.
    """
    program = [sys.executable, "-m", __name__]
    with subprocess.Popen(program, stdin=subprocess.DEVNULL):  # noqa: S603 - our own
        _compile(cycle.estimate, _STATE.dtype, _type_of(whole))
    _compile(cycle.tick, _STATE, *_SAMPLE, _type_of(whole))
    if (mark := _mark(whole)) is not None:
        mark.touch()


def _compile(kernel: Any, *types: Any) -> None:
    kernel.compile(types)


def _mark(whole: Whole) -> Path | None:
    """Return the file that says that all is compiled; it lies and ages with the tick's kernels."""
    folder = kernel_folder(Path(cycle.__file__))
    return None if folder is None else folder / f"compiled-{'lean' if whole is None else 'whole'}"


if __name__ == "__main__":
    _compile(sensing.sense, _STATE.dtype, *_SAMPLE)
