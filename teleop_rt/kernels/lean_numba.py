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
_LOOKING = ("numba", "numba.np.arraymath", "numba.core.typing.cffi_utils")


def _load() -> None:
    """Load the parts of numba that detect other packages, as if these were not there."""
    modules = cast("dict[str, Any]", sys.modules)
    hidden = [name for name in _ONLY_LOOKED_FOR if name not in modules]
    modules.update(dict.fromkeys(hidden))  # Python takes None for a module that cannot be imported
    try:
        for name in _LOOKING:
            with suppress(ImportError):
                importlib.import_module(name)
    finally:
        for name in hidden:
            del modules[name]


_load()
import numba  # noqa: E402 - only now is it loaded leanly
from llvmlite import binding  # noqa: E402

__all__ = ["binding", "numba"]
