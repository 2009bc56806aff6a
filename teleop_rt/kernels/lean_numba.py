"""Load numba without the packages that it only detects: a daemon needs none of them.

numba loads scipy to read its version, coverage to report compiled lines to it, BLAS and cffi to
detect them; together that is a fifth of a daemon's start-up time.
"""

from __future__ import annotations

import importlib
import sys
from contextlib import suppress
from typing import Any, cast

_ONLY_LOOKED_FOR = ("scipy", "scipy.linalg.cython_blas", "cffi", "coverage")
_LOOKS_AT_ONCE = ("numba", "numba.core.typing.cffi_utils")
_LOOKS_TO_COMPILE = "numba.np.arraymath"


def _load(*names: str) -> None:
    """Load parts of numba that detect other packages, as if these were not there."""
    modules = cast("dict[str, Any]", sys.modules)
    hidden = [name for name in _ONLY_LOOKED_FOR if name not in modules]
    modules.update(dict.fromkeys(hidden))  # Python takes None for a module that cannot be imported
    try:
        for name in names:
            with suppress(ImportError):
                importlib.import_module(name)
    finally:
        for name in hidden:
            del modules[name]


_load(*_LOOKS_AT_ONCE)
import numba  # noqa: E402 - only now is it loaded leanly
from llvmlite import binding  # noqa: E402
from numba.core import cpu  # noqa: E402

_Context: Any = cpu.CPUContext
_load_registries = _Context.load_additional_registries


def _load_registries_leanly(context: Any) -> None:
    """Load what the compiler knows of Python and numpy; who only loads compiled code does not."""
    if _LOOKS_TO_COMPILE not in sys.modules:
        _load(_LOOKS_TO_COMPILE)
    _load_registries(context)


_Context.load_additional_registries = _load_registries_leanly

__all__ = ["binding", "numba"]
