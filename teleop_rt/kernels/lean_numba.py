"""Load numba without the packages that it only detects: a daemon needs none of them.

numba loads scipy to read its version, coverage to report compiled lines to it, BLAS and cffi to
detect them; together that is a fifth of a daemon's start-up time.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

_ONLY_DETECTED = ("scipy", "scipy.linalg.cython_blas", "cffi", "coverage")
_DETECTING = ("numba", "numba.core.typing.cffi_utils")
_DETECTING_LATER = "numba.np.arraymath"
"""Loaded by the compiler, and by compiled code that refers to it; a daemon's does not."""


@contextmanager
def undetected() -> Iterator[None]:
    """Let numba's modules that are loaded meanwhile find no package that they only detect."""
    modules = cast("dict[str, Any]", sys.modules)
    late = _DETECTING_LATER not in modules
    hidden = [name for name in _ONLY_DETECTED if late and name not in modules]
    modules.update(dict.fromkeys(hidden))  # Python takes None for a module that cannot be imported
    try:
        yield
    finally:
        for name in hidden:
            del modules[name]


with undetected():
    for _name in _DETECTING:
        importlib.import_module(_name)

import numba  # noqa: E402 - only now is it loaded leanly
from llvmlite import binding  # noqa: E402
from numba.core import cpu  # noqa: E402

_Context: Any = cpu.CPUContext
_load_registries = _Context.load_additional_registries


def _load_registries_leanly(context: Any) -> None:
    """Load the compiler's knowledge of Python and numpy: loading compiled code needs none."""
    with undetected():
        importlib.import_module(_DETECTING_LATER)
    _load_registries(context)


_Context.load_additional_registries = _load_registries_leanly

__all__ = ["binding", "numba", "undetected"]
