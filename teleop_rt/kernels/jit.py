"""Compile numeric kernels with numba, cached on disk only if there is a folder.

Numba looks only at place, time and size of a kernel's own file to decide whether its cached code is
current, though that code holds every other kernel and constant that it uses. So each file's kernels
are cached in a folder named after the contents of that file and of all of ours that it imports,
directly or not, after numba, Python and the processor: nothing stale or foreign can run, and equal
code in two folders (a clone, an installed wheel) is compiled once. Code that checks every index is
kept apart from code that does not.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np

from teleop_rt.kernels.lean_numba import binding, numba

# isort: split
from teleop_rt.kernels.inner import Cache, Kernel

P = ParamSpec("P")
R = TypeVar("R")

_IMPORT = re.compile(
    rb"^(?:from\s+(teleop_rt[\w.]*)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+(teleop_rt[\w.]*))",
    re.MULTILINE,
)
_KEPT_S = 30 * 24 * 3600.0
"""Age [s] at which another version's cache is deleted: a month."""


def load_compiler() -> None:
    """Load the modules of numba's first kernel now: a process that forks does it for all."""
    from numba.core.registry import cpu_target  # noqa: PLC0415 - only who forks pays for it here

    cast("Any", cpu_target.target_context).refresh()


def _writable(folder: Path) -> bool:
    """Return whether a file can be created in `folder`, making the folder if needed."""
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
            waiting += _read(path)[1]
    return frozenset(found)


@functools.cache
def _read(file: Path) -> tuple[bytes, frozenset[Path]]:
    """Return the digest of a file's contents, and the files of our packages that it imports."""
    content = file.read_bytes()
    found = set()
    for match in _IMPORT.finditer(content):
        module = (match[1] or match[3]).decode()
        found.add(place := _file_of(module))
        if place is None or place.name == "__init__.py":  # the name may be a module's, too
            names = re.findall(r"[A-Za-z_]\w*", (match[2] or b"").decode())
            found |= {_file_of(f"{module}.{name}") for name in names}
    imported = frozenset(path for path in found if path is not None)
    return hashlib.sha256(content).digest(), imported


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
def machine() -> str:
    """Return the dependencies of compiled code beside its source.

    That is numba, Python, the processor, and whether NUMBA_BOUNDSCHECK asks for checked indices.
    """
    own, features = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    config = _numba_config()
    processor = (config.CPU_NAME or own, config.CPU_FEATURES or features)
    checked = bool(config.BOUNDSCHECK)
    return repr((numba.__version__, sys.implementation.cache_tag, *processor, checked))


@functools.cache
def fingerprint(file: Path) -> str:
    """Return a name for the contents of all `sources_of` a file, and for the `machine`.

    Files of our packages count by their place within the package, others by their place on the
    disk: their own imports are not followed.
    """
    digest = hashlib.sha256(machine().encode())
    for path in sorted(sources_of(file), key=_name_of):
        digest.update(_name_of(path).encode() + b"\0" + _read(path)[0])
    return digest.hexdigest()[:16]


@functools.cache
def _name_of(file: Path) -> str:
    """Return `package/module.py` of a file of our packages, the absolute path of any other."""
    folder, above = _resolved(file.parent)
    place = folder / file.name
    return str(place) if above is None else place.relative_to(above).as_posix()


@functools.cache
def _resolved(folder: Path) -> tuple[Path, Path | None]:
    """Return a folder without links, and the folder above our package in which it lies, if any."""
    inner = outer = folder.resolve()
    while (outer / "__init__.py").is_file():
        if outer.name.startswith("teleop_rt") and not (outer.parent / "__init__.py").is_file():
            return inner, outer.parent
        outer = outer.parent
    return inner, None


def kernel_folder(file: Path) -> Path | None:
    """Return the folder of a file's compiled kernels; None where nothing can be written."""
    return None if _ROOT is None else _ROOT / f"kernels-{fingerprint(file)}"


class KernelLocator:
    """The folder of a file's kernels in numba's cache, and the check that they are current.

    numba uses it instead of its own locators, which compare the time of the file.
    """

    def __init__(self, file: Path, line: int) -> None:
        self._file, self._line = file, line

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> KernelLocator:
        """Return the locator of a function's kernel."""
        return cls(Path(file), function.__code__.co_firstlineno)

    def ensure_cache_path(self) -> None:
        """Make the folder and renew its date: unused folders are removed by age."""
        folder = Path(self.get_cache_path())
        folder.mkdir(exist_ok=True)
        os.utime(folder)

    def get_cache_path(self) -> str:
        """Return the folder of the file's kernels."""
        return str(kernel_folder(self._file))

    def get_source_stamp(self) -> str:
        """Return the values that must be equal for a cached kernel to be current."""
        return fingerprint(self._file)

    def get_disambiguator(self) -> str:
        """Return a text that distinguishes kernels of one name in one file."""
        return str(self._line)


def cache_root(environment: Mapping[str, str]) -> Path | None:
    """Return the folder below which compiled kernels lie; None where nothing can be written.

    That is NUMBA_CACHE_DIR, else below XDG_CACHE_HOME, else below ~/.cache. Kernels that were not
    used for a month are removed.
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
_LOCATOR = f"{__name__}.{KernelLocator.__name__}"
_OPTIONS: dict[str, Any] = {
    "nopython": True,
    "boundscheck": None,  # as NUMBA_BOUNDSCHECK says
    "error_model": "numpy",
    "_nrt": False,
}


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` with `numba.njit`, without fast-math, keeping its static type.

    A kernel allocates nothing: it writes into arrays that it is given. So it is compiled without
    numba's memory management (`_nrt`), whose reference counts of every row and slice took half of
    the bank's tick, and numba refuses one that does allocate. Kernels that call it take its inner
    flavour in (`inner.py`).
    Floating point stays IEEE (no fast-math): the guards against not-a-number depend on it. The
    cache is asked for only where a folder can be written, for `njit(cache=True)` without one
    raises at import and would keep the daemon from starting on a read-only system. Nor is a file
    cached that was run and not imported, as a user's effects are: a cached kernel is loaded by the
    name of its module, and such a file may be written again while its process runs.
    """
    imported = function.__module__ in sys.modules
    cached = _ROOT is not None and imported and Path(function.__code__.co_filename).is_file()
    return _compiled(function, cached=cached)


def _compiled(function: Callable[P, R], *, cached: bool, **options: Any) -> Callable[P, R]:
    config = _numba_config()
    if config.DISABLE_JIT:
        return function
    compiled = Kernel(function, targetoptions=_OPTIONS | options)
    if cached:
        fingerprint(Path(function.__code__.co_filename))  # now: it may change before its first call
        compiled.keep_in(_cache_of)
    return cast("Callable[P, R]", compiled)


def _cache_of(function: Callable[..., Any]) -> Cache:
    config = _numba_config()
    before, config.CACHE_LOCATOR_CLASSES = config.CACHE_LOCATOR_CLASSES, _LOCATOR
    try:
        return Cache(function)
    finally:
        config.CACHE_LOCATOR_CLASSES = before


def bound(
    function: Callable[..., R], arrays: tuple[Any, ...], *example: object
) -> Callable[..., R]:
    """Return a kernel bound to its first arguments, compiled for further ones like the example's.

    A kernel that Python calls finds the types of its arguments out each time, which takes longer
    than many a step within a tick. Code that is called without that reads an array of other
    dimensions beyond its end, so all arrays are bound here, alone or in named tuples, where their
    types are taken; None replaces those of an optional part. The arguments of each call are
    checked by type alone: numbers, flags and bytes. Raises TypeError for an array in the example.
    """
    if any(isinstance(one, np.ndarray) for one in example):
        raise TypeError("a kernel's arrays are bound, they do not come with each call")
    if _numba_config().DISABLE_JIT:
        return functools.partial(function, *arrays)
    compiled = cast("Any", function)
    types = tuple(map(compiled.typeof_pyval, (*arrays, *example)))
    return functools.partial(compiled.compile(types), *arrays)


def inlined_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` into each kernel that calls it, where constant arguments unroll its loops.

    It costs compile time at every place of call: for the few innermost kernels only.
    """
    return _compiled(function, cached=False, forceinline=True)


def shared(function: Callable[P, R]) -> Callable[P, R]:
    """Let kernels call a function that stays plain Python where Python calls it.

    It becomes part of each kernel that calls it, so it is cached with those.
    """
    plain: Callable[P, R] = numba.extending.register_jitable(function)
    return plain


def _numba_config() -> Any:
    """Return numba's settings, which it reads when a kernel asks for its cache and is compiled."""
    return numba.config
