"""Compile numeric kernels with numba, cached on disk only where that can be had.

Numba looks only at a kernel's own file to decide whether its cached code is current, though that
code holds every other kernel and constant that it uses. So each file's kernels are cached in a
folder named after the contents of that file and of all of ours that it imports, directly or not:
after an upgrade nothing stale can run.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")

_IMPORT = re.compile(
    rb"^(?:from\s+(teleop_rt[\w.]*)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+(teleop_rt[\w.]*))",
    re.MULTILINE,
)
_KEPT_S = 30 * 24 * 3600.0
_ONLY_LOOKED_FOR = ("scipy.linalg.cython_blas", "cffi")
_LOOKING = ("numba.np.arraymath", "numba.core.typing.cffi_utils")


def _load_numba() -> None:
    """Load the parts of numba that look whether BLAS and cffi are there, as if they were not.

    No kernel needs them here, and to load both takes a fifth of what a daemon takes to start.
    """
    modules = cast("dict[str, Any]", sys.modules)
    hidden = [name for name in _ONLY_LOOKED_FOR if name not in modules]
    modules.update(dict.fromkeys(hidden))  # Python takes None for a module that cannot be had
    try:
        for name in _LOOKING:
            with suppress(ImportError):
                importlib.import_module(name)
    finally:
        for name in hidden:
            del modules[name]


_load_numba()


def _writable(folder: Path) -> bool:
    """Tell whether a file can be created in `folder`, making the folder if needed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@functools.cache
def sources_of(file: Path) -> frozenset[Path]:
    """Return `file` and all files of our packages that it imports, directly or not."""
    found: set[Path] = set()
    waiting = [file]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += _imported(path)
    return frozenset(found)


def _imported(file: Path) -> Iterator[Path]:
    for match in _IMPORT.finditer(file.read_bytes()):
        module = (match[1] or match[3]).decode()
        names = re.findall(r"[A-Za-z_]\w*", (match[2] or b"").decode())
        for name in (module, *(f"{module}.{name}" for name in names)):
            if (path := _file_of(name)) is not None:
                yield path


@functools.cache
def _file_of(module: str) -> Path | None:
    """Return the file of a module of ours without importing it; None if it is no module."""
    package, *rest = module.split(".")
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return None
    place = Path(spec.origin).parent.joinpath(*rest)
    candidates = (place.with_suffix(".py"), place / "__init__.py")
    return next((path for path in candidates if path.is_file()), None)


@functools.cache
def fingerprint(file: Path) -> str:
    """Return a name for the contents of all `sources_of` a file, and the version of numba."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(sources_of(file)):
        digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def cache_root(environment: Mapping[str, str]) -> Path | None:
    """Return the folder below which compiled kernels lie; None where nothing can be written.

    That is NUMBA_CACHE_DIR, else below XDG_CACHE_HOME, else below ~/.cache. What has not been
    used for a month is removed.
    """
    user_cache = environment.get("XDG_CACHE_HOME") or "~/.cache"
    named = environment.get("NUMBA_CACHE_DIR") or f"{user_cache}/teleop-rt"
    root = Path(named).expanduser()
    if not _writable(root):
        return None
    for folder in root.glob("kernels-*"):
        if time.time() - folder.stat().st_mtime > _KEPT_S:
            shutil.rmtree(folder, ignore_errors=True)
    return root


_ROOT = cache_root(os.environ)
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` with `numba.njit`, without fast-math, keeping its static type.

    A kernel allocates nothing: it writes into arrays that it is given. So it is compiled without
    numba's memory management (`_nrt`), whose reference counts of every row and slice took half of
    the bank's tick, and numba refuses one that does allocate.
    Floating point stays IEEE (no fast-math): the guards against not-a-number depend on it. The
    cache is asked for only where a folder can be written, for `njit(cache=True)` without one
    raises at import and would keep the daemon from starting on a read-only system.
    """
    source = Path(function.__code__.co_filename)
    cached = _ROOT is not None and source.is_file()
    if cached:
        folder = cast("Path", _ROOT) / f"kernels-{fingerprint(source)}"
        folder.mkdir(exist_ok=True)
        os.utime(folder)
        _numba_config().CACHE_DIR = str(folder)
    compiled = numba.njit(cache=cached, **_OPTIONS)(function)
    return cast("Callable[P, R]", compiled)


def inlined_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` into each kernel that calls it, where constant arguments unroll its loops.

    It costs compile time at every place of call: for the few innermost kernels only.
    """
    compiled = numba.njit(inline="always", **_OPTIONS)(function)
    return cast("Callable[P, R]", compiled)


def _numba_config() -> Any:
    """Return numba's settings, which it reads when a kernel asks for its cache."""
    return numba.config
