"""Compile numeric kernels with numba, cached on disk only where that can be had."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def _writable(folder: Path) -> bool:
    """Tell whether a file can be created in `folder`, making the folder if needed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def cache_allowed(source: Path) -> bool:
    """Tell whether numba can keep a compiled cache for functions of the file `source`.

    `njit(cache=True)` raises at *import* when it finds no writable folder, which would keep
    the daemon from starting on a read-only system; so numba's own search order is tried first.
    """
    if configured := os.environ.get("NUMBA_CACHE_DIR"):
        return _writable(Path(configured))
    user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    return _writable(source.parent / "__pycache__") or _writable(user_cache)


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` with `numba.njit`, without fast-math, keeping its static type.

    Floating point stays IEEE (no fast-math): the guards against not-a-number depend on it.
    """
    source = Path(function.__code__.co_filename)
    compiled = numba.njit(cache=cache_allowed(source), error_model="numpy")(function)
    return cast("Callable[P, R]", compiled)
