"""Read YAML as people mean it, remembering the line of every key.

PyYAML follows YAML 1.1: `1e3` is text, `on` is true, `12:30` is 750 and the second of two equal
keys wins in silence. Here `1e3` is a number, `on` and `12:30` are text (which the schema then
refuses where it wants something else), and a key given twice is an error.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from teleop_rt.errors import ExpectedError

KeyPath = tuple[str | int, ...]

OVERRIDE = "--set "
"""Beginning of the place of a value from the command line."""


@dataclass(frozen=True, slots=True)
class ConfigProblem:
    """One problem of a config: its place, the problem, what to do."""

    where: str
    message: str

    def __str__(self) -> str:
        return f"{self.where}: {self.message}"


class ConfigError(ExpectedError):
    """A config that cannot be used; carries every problem found."""

    def __init__(self, problems: list[ConfigProblem]) -> None:
        super().__init__("\n".join(map(str, problems)))
        self.problems = problems


@dataclass(slots=True)
class Document:
    """A YAML file as plain data (sequences as tuples), with the place of every key."""

    data: Any
    places: dict[KeyPath, str] = field(default_factory=dict)

    def place(self, path: KeyPath) -> str:
        """Return `file:line` of a key path, or of its nearest parent that was written down."""
        for length in range(len(path), -1, -1):
            if (found := self.places.get(path[:length])) is not None:
                return found
        return "?"

    def origin(self, paths: Sequence[KeyPath]) -> str:
        """Return the places of keys that contradict each other: the first, and the overrides.

        A file was most likely right without the command line's values for them or below them.
        """
        given = {
            where: None
            for key, where in self.places.items()
            if where.startswith(OVERRIDE) and any(key[: len(path)] == path for path in paths)
        }
        first = self.place(paths[0])
        if not given or first in given:
            return first
        return f"{', '.join(given)} (with {first})"


MOST_BYTES = 256 * 1024
"""Of a file; the largest shipped one has 6 kB, and a megabyte takes ten seconds to parse."""
MOST_NODES = 10_000
"""Keys, values and items, with aliases written out: ten aliases of ten are a hundred nodes."""
DEEPEST = 40
"""Nesting of a file: Python's own recursion ends not far beyond."""

_TOO_MUCH = (
    f"holds more than {MOST_NODES} values, with its aliases, or is nested deeper than {DEEPEST}:"
    " give a trial or a rig, not its data"
)
_CORE = "tag:yaml.org,2002:"
_CORE_TAGS = {f"{_CORE}{name}" for name in ("map", "seq", "str", "null", "bool", "int", "float")}
"""Of YAML 1.2; other tags would make dates, sets or objects, which no schema here has."""


_CHECK = "check blanks after colons, brackets, quotes and indentation in this line and those above"

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Characters that control a terminal when the text is printed; tab and line end do not."""


class ConfigLoader(yaml.SafeLoader):
    """SafeLoader with the scalars of YAML 1.2's core schema."""

    # An own table: without it, resolvers would be added to those of YAML 1.1.
    yaml_implicit_resolvers = {}  # noqa: RUF012 - declared so by PyYAML
    composed = 0

    def fetch_flow_collection_start(self, token: type[yaml.Token]) -> None:
        """Refuse brackets that are nested too deep: the scanner's time grows with their square."""
        super().fetch_flow_collection_start(token)
        if self.flow_level > DEEPEST:
            raise yaml.MarkedYAMLError(problem=_TOO_MUCH, problem_mark=self.get_mark())

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Refuse a file with too many values, before its time is spent."""
        self.composed += 1
        if self.composed > MOST_NODES:
            raise yaml.MarkedYAMLError(problem=_TOO_MUCH, problem_mark=self.get_mark())
        return super().compose_node(parent, index)


for _tag, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
):
    ConfigLoader.add_implicit_resolver(f"{_CORE}{_tag}", re.compile(f"^(?:{_pattern})$"), _first)


def _int(_: ConfigLoader, node: yaml.ScalarNode) -> int:
    return int(node.value, 16 if node.value.startswith("0x") else 10)


def _float(_: ConfigLoader, node: yaml.ScalarNode) -> float:
    return float(node.value.replace(".inf", "inf").replace(".nan", "nan").lower())


ConfigLoader.add_constructor(f"{_CORE}int", _int)
ConfigLoader.add_constructor(f"{_CORE}float", _float)


def parse_scalar(text: str) -> Any:
    """Read one value as it would be read in a file (for `--set key.path=value`)."""
    return _read(text, "--set").data


def read_yaml(path: Path) -> Document:
    """Read a file. Raises ConfigError for a missing file, bad syntax or a key given twice."""
    try:
        with open(path, "rb", opener=_without_waiting) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise ConfigError([ConfigProblem(str(path), "is a pipe or a device: give a file")])
            data = file.read(MOST_BYTES + 1)
        text = data.decode("utf-8")
    except FileNotFoundError:
        raise ConfigError([ConfigProblem(str(path), "no such file: check the path")]) from None
    except UnicodeDecodeError:
        raise ConfigError(
            [ConfigProblem(str(path), "is not text: give a YAML file in UTF-8")]
        ) from None
    except OSError as error:
        reason = f"cannot be read: {error.strerror}: give a YAML file that this user may read"
        raise ConfigError([ConfigProblem(str(path), reason)]) from None
    if len(data) > MOST_BYTES:
        reason = f"is larger than {MOST_BYTES // 1024} kB: give a trial or a rig, not its data"
        raise ConfigError([ConfigProblem(str(path), reason)])
    return _read(text, str(path))


def _without_waiting(path: str, flags: int) -> int:
    """Open a file; of a pipe nobody may ever come to write."""
    return os.open(path, flags | os.O_NONBLOCK)


def _read(text: str, name: str) -> Document:
    loader: ConfigLoader | None = None
    try:
        loader = ConfigLoader(text)
        node = loader.get_single_node()
        document = Document(None, {(): f"{name}:1"})
        if node is not None:
            building = _Building(loader, name, document.places)
            document.data = building.build(node, ())
            if building.problems:
                raise ConfigError(building.problems)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        what = error.problem or "is not valid YAML"
        raise ConfigError(
            [ConfigProblem(f"{name}:{line}", f"YAML syntax: {what}; {_CHECK}")]
        ) from None
    except yaml.YAMLError as error:
        raise ConfigError([ConfigProblem(name, f"YAML syntax: {error}; {_CHECK}")]) from None
    except (ValueError, RecursionError, TypeError) as error:
        raise ConfigError(
            [ConfigProblem(name, f"cannot be read as YAML: {error}; {_CHECK}")]
        ) from None
    finally:
        if loader is not None:
            loader.dispose()
    return document


class _Building:
    """Turns nodes into plain data, noting the line of each key, keys given twice and tags."""

    def __init__(self, loader: ConfigLoader, name: str, places: dict[KeyPath, str]) -> None:
        self._loader = loader
        self._name = name
        self._places = places
        self._nodes = 0
        self.problems: list[ConfigProblem] = []

    def build(self, node: yaml.Node, path: KeyPath) -> Any:
        """Return the data of a node; mistakes are added to `problems`."""
        where = f"{self._name}:{node.start_mark.line + 1}"
        self._nodes += 1
        if self._nodes > MOST_NODES or len(path) > DEEPEST:
            raise ConfigError([ConfigProblem(where, _TOO_MUCH)])
        if node.tag not in _CORE_TAGS:
            self.problems.append(
                ConfigProblem(where, f"the tag {node.tag} is not understood: remove it")
            )
            return None
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path)
        if isinstance(node, yaml.SequenceNode):
            for index, item in enumerate(node.value):
                self._places[(*path, index)] = f"{self._name}:{item.start_mark.line + 1}"
            return tuple(self.build(item, (*path, n)) for n, item in enumerate(node.value))
        try:
            value = self._loader.construct_object(node, deep=True)
        except (ValueError, LookupError):  # `!!int x`, `!!bool maybe`
            self.problems.append(
                ConfigProblem(
                    where, f"{node.value!r:.80} is no value of its tag: remove one of the two"
                )
            )
            return None
        if isinstance(value, str) and _CONTROL.search(value):
            self.problems.append(ConfigProblem(where, "contains a control character: remove it"))
        return value

    def _mapping(self, node: yaml.MappingNode, path: KeyPath) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value if isinstance(key_node, yaml.ScalarNode) else None
            where = f"{self._name}:{key_node.start_mark.line + 1}"
            if key is None:
                self.problems.append(
                    ConfigProblem(where, "a key must be plain text: write it without brackets")
                )
                continue
            if key in mapping:
                self.problems.append(ConfigProblem(where, f"key {key!r} is given twice: keep one"))
            if _CONTROL.search(key):
                self.problems.append(
                    ConfigProblem(where, "a key contains a control character: remove it")
                )
                continue
            self._places[(*path, key)] = where
            mapping[key] = self.build(value_node, (*path, key))
        return mapping
