"""Records that kernels work on, declared by the annotations of a class."""

from __future__ import annotations

from typing import Any

import numpy as np

_KINDS = {"int": np.int64, "float": np.float64}


def record_type(fields: type) -> np.dtype[Any]:
    """Return the type of a record with the annotated `int` and `float` fields, 8 bytes each."""
    kinds = [(name, _KINDS[kind]) for name, kind in fields.__annotations__.items()]
    return np.dtype((np.record, np.dtype(kinds)))
