"""Functions of diagnosis replaced or watched while a record is diagnosed, wherever imported."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

import numpy as np

import teleop_rt as library
import teleop_rt.diagnosis as package

Function = Callable[..., Any]
Call = tuple[Function, tuple[Any, ...], dict[str, Any]]


def always(value: Any) -> Function:
    """Return a function that returns the value, whatever it is given."""
    return lambda *_, **__: value


def modules() -> list[Any]:
    """Return all modules of diagnosis."""
    names = (m.name for m in pkgutil.walk_packages(package.__path__, package.__name__ + "."))
    return [importlib.import_module(name) for name in names]


@contextmanager
def instead(path: str, replacing: Callable[[Function], Function]) -> Iterator[None]:
    """Put `replacing(function)` in the place of `module:function`, wherever it was imported."""
    module, _, name = path.partition(":")
    owner: Any = importlib.import_module(f"{package.__name__}.{module}")
    *classes, name = name.split(".")
    for part in classes:
        owner = getattr(owner, part)
    function = getattr(owner, name)
    others = [m for m in modules() if getattr(m, name, None) is function]
    for place in (owner, *others):
        setattr(place, name, replacing(function))
    forget()
    try:
        yield
    finally:
        for place in (owner, *others):
            setattr(place, name, function)
        forget()


@contextmanager
def scaled(path: str, factor: float) -> Iterator[None]:
    """Multiply the constant `module:NAME` of `teleop_rt` by a factor; a count stays whole."""
    module, _, name = path.partition(":")
    owner = importlib.import_module(f"{library.__name__}.{module}")
    value = getattr(owner, name)
    setattr(owner, name, round(factor * value) if isinstance(value, int) else factor * value)
    forget()
    try:
        yield
    finally:
        setattr(owner, name, value)
        forget()


def forget() -> None:
    """Clear the caches of diagnosis: they were made with another gate."""
    for module in modules():
        for value in vars(module).values():
            if hasattr(value, "cache_clear"):
                value.cache_clear()


def differs(result: Any, plain: Any) -> bool:
    """Return whether a gate did other than its replacement would have done."""
    if isinstance(result, list):
        return len(result) != len(plain)
    if isinstance(result, (bool, float, np.ndarray)):
        return bool(np.any(result != plain))
    return result is not plain


def watched(without: Function, acted: list[bool]) -> Callable[[Function], Function]:
    """Return a wrapper by which a gate notes whether it did anything."""

    def watching(function: Function) -> Function:
        @wraps(function)
        def gate(*arguments: Any, **keys: Any) -> Any:
            result = function(*arguments, **keys)
            if not acted and differs(result, without(*arguments, **keys)):
                acted.append(True)
            return result

        return gate

    return watching


def kept(calls: list[Call]) -> Callable[[Function], Function]:
    """Return a wrapper by which a judgement notes its arguments."""

    def keeping(function: Function) -> Function:
        @wraps(function)
        def judgement(*arguments: Any, **keys: Any) -> Any:
            calls.append((function, arguments, keys))
            return function(*arguments, **keys)

        return judgement

    return keeping
