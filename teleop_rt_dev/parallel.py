"""Independent calls on the cores of this machine, with a bar for whoever watches."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from joblib import Parallel

from teleop_rt.batch.bar import bar

T = TypeVar("T")
Delayed = tuple[Callable[..., T], tuple[Any, ...], dict[str, Any]]
"""A call as joblib's `delayed` packs it."""


def in_order(what: str, calls: Iterable[Delayed[T]], jobs: int) -> list[T]:
    """Return the results of all calls in their order; `jobs` as joblib counts them, -1 for all."""
    waiting, found = list(calls), []
    with bar(what) as shown:
        shown(0, len(waiting))
        for result in Parallel(n_jobs=jobs, return_as="generator")(waiting):
            found.append(result)
            shown(len(found), len(waiting))
    return found
