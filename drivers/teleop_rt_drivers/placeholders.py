"""The list in a rig's file of the values that are still those of an example."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Any

import yaml

KeyPath = tuple[str, ...]

OF_DEVICES = re.compile(
    r"(?:(?:node|motor|servo|host)_)?id|motor|eds|pole_pairs|ratio|counts|mass|torque_lag|offset"
    r"|(?:scale|torque_constant|current_max|torque_max|mass|torque_lag|offset)_\w+"
)
"""Keys below `axis` whose values are a device's own, or its mechanics'."""
SECTIONS = ("sensors", "limits", "device")
"""Sections of which every value is a rig's own."""
HEAD = "placeholders:   # still an example's: put in your own value, then remove the key here\n"
ITEM = "  - "


def with_placeholders(text: str, *, port_known: bool = False) -> str:
    """Return a rig's text with the list of its placeholders, before the section of the axis.

    `port_known` where the force sensor's port is the rig's own.
    """
    paths = [path for path in _paths(yaml.safe_load(text)) if not (port_known and is_port(path))]
    listed = "".join(f"{ITEM}{'.'.join(path)}\n" for path in paths)
    return text.replace("\naxis:\n", f"\n{HEAD}{listed}\naxis:\n", 1)


def without_placeholders(text: str, known: Collection[KeyPath]) -> str:
    """Return a rig's text whose list lacks these keys, and is gone where none is left."""
    for path in known:
        text = text.replace(f"\n{ITEM}{'.'.join(path)}\n", "\n", 1)
    return text if f"{HEAD}{ITEM}" in text else text.replace(f"{HEAD}\n", "", 1)


def is_port(path: KeyPath) -> bool:
    """Return whether a key names the file of a sensor's serial port."""
    return path[-3:-2] == ("ports",) and path[-1] == "device"


def _paths(rig: dict[str, Any]) -> Iterator[KeyPath]:
    """Give the keys of a rig whose values are a device's or a rig's own, in the file's order."""
    for name, section in rig.items():
        for path in _leaves(section, (name,)):
            if "daemon" in path:
                continue
            own = OF_DEVICES.fullmatch(path[-1]) or path[-2:-1] == ("identity",)
            own = own or is_port(path)
            if name in SECTIONS or (name == "axis" and own):
                yield path


def _leaves(value: object, path: KeyPath) -> Iterator[KeyPath]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, (*path, str(key)))
    else:
        yield path
