"""Change values of a rig's file in place: comments, order and all else stay as they are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import yaml

from teleop_rt.config.loader import load_rig
from teleop_rt_drivers.calibration.weights import CalibrationError
from teleop_rt_drivers.placeholders import without_placeholders
from teleop_rt_drivers.registry import AXIS_SCHEMAS

KeyPath = tuple[str, ...]


def with_values(text: str, values: Mapping[KeyPath, float | str]) -> str:
    """Return the text with these values; a key that is missing is added to its section.

    Raises CalibrationError for a section that is not there.
    """
    for path, value in values.items():
        text = _with_value(text, path, as_written(value))
    return text


def as_written(value: float | str) -> str:
    """Return a value's text: a whole number as it is, another one with six digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _with_value(text: str, path: KeyPath, value: str) -> str:
    section = yaml.compose(text, yaml.SafeLoader)
    for key in path[:-1]:
        section = _child(section, key)
    if not isinstance(section, yaml.MappingNode):
        raise CalibrationError(f"the rig's file has no section {'.'.join(path[:-1])}: add it")
    old = _child(section, path[-1])
    if old is not None:
        begin = old.start_mark.index
        end = begin + len(text[begin : old.end_mark.index].rstrip())  # a section ends at the next
        return text[:begin] + value + text[end:]
    if section.flow_style:
        end = section.end_mark.index - 1
        return f"{text[:end]}, {path[-1]}: {value}{text[end:]}"
    first = section.value[0][0].start_mark
    indent = " " * first.column
    return f"{text[: first.index]}{path[-1]}: {value}\n{indent}{text[first.index :]}"


def _child(section: yaml.Node | None, key: str) -> yaml.Node | None:
    if not isinstance(section, yaml.MappingNode):
        return None
    found: yaml.Node | None = next(
        (value for name, value in section.value if name.value == key), None
    )
    return found


def rewrite(file: Path, values: Mapping[KeyPath, float]) -> Path:
    """Write the values into a rig's file, and return where the old one is kept.

    Nothing is changed where the rig would not be valid then. Raises CalibrationError, ConfigError.
    """
    text = file.read_text(encoding="utf-8")
    changed = without_placeholders(with_values(text, values), values)
    trial = file.with_name(f".{file.name}.calibrated")
    try:
        trial.write_text(changed, encoding="utf-8")
        load_rig(trial, AXIS_SCHEMAS)
        number = 1
        while (kept := file.with_name(f"{file.name}.{number}")).exists():
            number += 1
        kept.write_text(text, encoding="utf-8")
        trial.replace(file)
    finally:
        trial.unlink(missing_ok=True)
    return kept
