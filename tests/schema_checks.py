"""Walks JSON Schemas, and changes files so that something is wrong with them."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import cache, partial
from typing import Any

from jsonschema import Draft202012Validator

from teleop_rt.cli.schema import SchemaName
from teleop_rt.cli.schemas import schema_named


@cache
def _validator(name: SchemaName) -> Draft202012Validator:
    return Draft202012Validator(schema_named(name))


def violations(name: SchemaName, printed: Any) -> list[str]:
    """Return where JSON that was printed departs from its schema, and how."""
    return [
        f"{error.json_path}: {error.message}" for error in _validator(name).iter_errors(printed)
    ]


def properties(schema: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield every property that a schema declares, with its path."""
    if isinstance(schema, dict):
        for key, value in schema.items():
            if key == "if":  # a condition declares no key
                continue
            if key == "properties":
                for name, body in value.items():
                    yield f"{path}.{name}", body
            yield from properties(value, path if key == "properties" else f"{path}.{key}")
    elif isinstance(schema, list):
        for item in schema:
            yield from properties(item, path)


LEAST, MOST = {"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"}


def unbounded(schema: Any, path: str = "") -> Iterator[str]:
    """Yield the path of every number that a schema declares without a bound on either side."""
    if isinstance(schema, list):
        for place, item in enumerate(schema):
            yield from unbounded(item, f"{path}.{place}")
    elif isinstance(schema, dict):
        named = schema.get("type", ())
        kinds = {named} if isinstance(named, str) else set(named)
        given = schema.keys()
        numeric = kinds & {"number", "integer"} and not given & {"const", "enum"}
        if numeric and not (given & LEAST and given & MOST):
            yield path
        for key in given - {"default", "const", "enum"}:
            yield from unbounded(schema[key], f"{path}.{key}")


def plain(data: Any) -> Any:
    """Return YAML data as JSON has it: sequences as lists."""
    if isinstance(data, dict):
        return {key: plain(value) for key, value in data.items()}
    return [plain(item) for item in data] if isinstance(data, list | tuple) else data


def mutations(data: Any) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield how to make the data with one change: a key gone, new, of another unit; an odd value.

    Only those that are made cost a copy of the whole.
    """
    for path in _paths(data):
        holder = _at(data, path[:-1])
        value = holder[path[-1]]
        where = ".".join(map(str, path))
        for name, other in _others(value):
            yield f"{where} = {name}", partial(_with, data, path, other)
        if not isinstance(holder, dict):
            continue
        key = str(path[-1])
        yield f"{where} removed", partial(_with, data, path, None, remove=True)
        other_key = key.replace("_m", "_rad") if "_m" in key else f"{key}_x"
        yield f"{where} renamed {other_key}", partial(_renamed, data, path, other_key, value)


def _renamed(data: Any, path: tuple[Any, ...], key: str, value: Any) -> Any:
    changed = _with(data, path, None, remove=True)
    _at(changed, path[:-1])[key] = value
    return changed


def _others(value: Any) -> Iterator[tuple[str, Any]]:
    yield "text", "sixty"
    yield "null", None
    yield "true", True
    yield "list", [value]
    yield "mapping", {"unknown": 1}
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield "negative", -abs(value) - 1
        yield "zero", 0
        yield "huge", 10**9
        yield "fraction", value + 0.5


def _paths(data: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    if path:
        yield path
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items if isinstance(data, dict | list) else ():
        if isinstance(value, dict | list):
            yield from _paths(value, (*path, key))
        else:
            yield (*path, key)


def _at(data: Any, path: tuple[str | int, ...]) -> Any:
    for key in path:
        data = data[key]
    return data


def _with(data: Any, path: tuple[str | int, ...], value: Any, *, remove: bool = False) -> Any:
    changed = deepcopy(data)
    holder = _at(changed, path[:-1])
    if remove:
        del holder[path[-1]]
    else:
        holder[path[-1]] = value
    return changed
