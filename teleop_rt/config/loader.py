"""Load a trial with its rig: one pass, every problem at once, each with its place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from teleop_rt.config.problems import follows_from_others, problems_of
from teleop_rt.config.rig import AxisConfig, RigConfig
from teleop_rt.config.section import Section, Units
from teleop_rt.config.trial import PlantConfig, TrialConfig
from teleop_rt.config.yaml_file import (
    OVERRIDE,
    ConfigError,
    ConfigProblem,
    Document,
    KeyPath,
    parse_scalar,
    read_yaml,
)
from teleop_rt.shipped import example, example_names, meant

FILES: tuple[tuple[str, ...], ...] = (("rig",), ("extended_model",), ("operator", "rig"))
"""Keys of a trial that may name a file in the place of their contents."""

AxisSchemas = Mapping[str, type[AxisConfig]]
PlantSchemas = Mapping[str, type[PlantConfig]]
Model = TypeVar("Model", bound=Section)


def load_trial(
    path: Path,
    axis_schemas: AxisSchemas,
    plant_schemas: PlantSchemas,
    overrides: Sequence[str] = (),
) -> TrialConfig:
    """Load a trial and the rig that it names (by a path relative to the trial file, or inline).

    `overrides` are `key.path=value`; a key below `rig.` overrides the rig.
    Raises ConfigError with every problem found in both files.
    """
    document = read_yaml(path)
    _require_mapping(document, path)
    if {"axis", "limits"} <= document.data.keys() and "rig" not in document.data:
        message = "is a rig: name a trial, whose key `rig` names this file"
        raise ConfigError([ConfigProblem(str(path), message)])
    files = tuple(f"{'.'.join(keys)}=" for keys in FILES)
    for override in overrides:
        if override.startswith(files):
            _override(document, override)
    for keys in FILES:
        _insert_file(document, path, keys)
    if isinstance(effects := document.data.get("effects_file"), str):
        document.data["effects_file"] = str((path.parent / effects).resolve())
    for override in overrides:
        if not override.startswith(files):
            _override(document, override)
    _place_operators_file(document, path)
    problems: list[ConfigProblem] = []
    _check_driver_sections(document, axis_schemas, plant_schemas, problems)
    trial = _validate(TrialConfig, document, (), _units(document), problems)
    if _units(document) is None:
        for cause in (": rig.units", ": rig", ""):  # without units no other key has its name
            if first := [problem for problem in problems if cause in str(problem)]:
                raise ConfigError(first)
    if problems:
        raise ConfigError(problems)
    assert trial is not None  # noqa: S101 - no problem was found, so it was built
    return trial


def load_rig(path: Path, axis_schemas: AxisSchemas) -> RigConfig:
    """Load a rig alone. Raises ConfigError with every problem found."""
    document = read_yaml(path)
    _require_mapping(document, path)
    document = Document(
        {"rig": document.data}, {("rig", *key): where for key, where in document.places.items()}
    )
    problems: list[ConfigProblem] = []
    _check_driver_sections(document, axis_schemas, {}, problems)
    rig = _validate(RigConfig, document, ("rig",), _units(document), problems)
    if problems:
        raise ConfigError(problems)
    assert rig is not None  # noqa: S101 - no problem was found, so it was built
    return rig


FORMAT = 1
"""The format of trials and rigs that this version reads; a file that names none is of this one."""


def _require_mapping(document: Document, path: Path) -> None:
    if not isinstance(document.data, dict):
        kinds = {"nothing": type(None), "a list": list | tuple, "text": str}
        held = [kind for kind, types in kinds.items() if isinstance(document.data, types)]
        found = "".join(held) or "one value"
        message = f"must contain keys and values (it contains {found}): name a trial or rig (YAML)"
        raise ConfigError([ConfigProblem(str(path), message)])
    found = document.data.get("format", FORMAT)
    if found != FORMAT:
        message = (
            f"format: this file is of format {found!r}, and this version of teleop-rt reads format "
            f"{FORMAT}: install the version that it was written for, or write a new file"
        )
        raise ConfigError([ConfigProblem(document.place(("format",)), message)])


def _insert_file(document: Document, path: Path, keys: tuple[str, ...]) -> None:
    """Replace the path that stands at a key by the file's contents, keeping their places."""
    holder, key = document.data, keys[-1]
    for outer in keys[:-1]:
        holder = holder.get(outer)
        if not isinstance(holder, dict):
            return
    named = holder.get(key)
    if not isinstance(named, str):
        return
    file = _file_named(document, path, keys, named)
    if key == "rig" and not _is_file(file) and named in example_names("rigs"):
        file = example("rigs", named)
    if not _is_file(file):
        message = f"{'.'.join(keys)}: no file {file}: give a path relative to the trial file"
        if document.place(keys).startswith(OVERRIDE):
            message += ", or to the folder where you are"
        if key == "rig" and file.name == named:
            message += f"; {meant(named, ('rigs',))}"
        raise ConfigError([ConfigProblem(document.place(keys), message)])
    loaded = read_yaml(file)
    _require_mapping(loaded, file)
    if key == "rig" and "rig" in loaded.data:
        message = (
            f"{'.'.join(keys)}: {file} is a trial, no rig: name the file that its key `rig` names"
        )
        raise ConfigError([ConfigProblem(document.place(keys), message)])
    holder[key] = loaded.data
    document.places.update({(*keys, *inner): where for inner, where in loaded.places.items()})


def _file_named(document: Document, path: Path, keys: tuple[str, ...], named: str) -> Path:
    """Return the file that a key names: relative to the trial, or of an override from here, too."""
    file = path.parent / named
    if document.place(keys).startswith(OVERRIDE) and _is_file(here := Path.cwd() / named):
        if _is_file(file) and not file.samefile(here):
            message = f"{'.'.join(keys)}: both {file} and {here}: give the whole path of one"
            raise ConfigError([ConfigProblem(document.place(keys), message)])
        return here
    return file


def _place_operators_file(document: Document, path: Path) -> None:
    """Give the operator's recording that an override names, from where one is, its whole path."""
    operator, keys = document.data.get("operator"), ("operator", "file")
    named = operator.get("file") if isinstance(operator, dict) else None
    if not isinstance(operator, dict) or not isinstance(named, str) or "$" in named:
        return
    if document.place(keys).startswith(OVERRIDE):
        file = _file_named(document, path, keys, named)
        operator["file"] = str(file) if _is_file(file) else named


def _is_file(path: Path) -> bool:
    """Return whether a path names a file; one that no file can have names none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _override(document: Document, override: str) -> None:
    dotted, separator, text = override.partition("=")
    if not separator or not dotted:
        raise ConfigError([ConfigProblem(OVERRIDE + override, "write key.path=value")])
    keys = dotted.split(".")
    section = document.data
    for depth, key in enumerate(keys[:-1]):
        if key not in section:  # it is in no file
            document.places[tuple(keys[: depth + 1])] = OVERRIDE + override
        section = section.setdefault(key, {})
        if not isinstance(section, dict):
            message = f"{'.'.join(keys[: depth + 1])} is a value: leave out the keys below it"
            raise ConfigError([ConfigProblem(OVERRIDE + override, message)])
    section[keys[-1]] = parse_scalar(text)
    path = tuple(keys)
    for place in [place for place in document.places if place[: len(path)] == path]:
        del document.places[place]
    document.places[path] = OVERRIDE + override


def _units(document: Document) -> Units | None:
    """Return the rig's units, which the keys of both files depend on; None where unusable."""
    rig = document.data.get("rig")
    try:
        return Units.model_validate(rig["units"]) if isinstance(rig, dict) else None
    except (ValidationError, KeyError):
        return None


def _check_driver_sections(
    document: Document,
    axis_schemas: AxisSchemas,
    plant_schemas: PlantSchemas,
    problems: list[ConfigProblem],
) -> None:
    """Validate the parts whose schema belongs to a driver, and put the models in their place."""
    units = _units(document)
    _check_device_section(document, axis_schemas, units, problems)
    rig = document.data.get("rig")
    axis = rig.get("axis") if isinstance(rig, dict) else None
    if not isinstance(rig, dict) or not isinstance(axis, dict):
        return
    driver = axis.get("driver")
    if not isinstance(driver, str) or driver not in axis_schemas:
        message = f"rig.axis.driver: {driver!r} is not one of: {', '.join(sorted(axis_schemas))}"
        problems.append(ConfigProblem(document.place(("rig", "axis", "driver")), message))
        del rig["axis"]
        document.data.pop("plant", None)
        return
    rig["axis"] = _validate(axis_schemas[driver], document, ("rig", "axis"), units, problems)
    if isinstance(document.data.get("plant"), dict):
        if driver not in plant_schemas:
            message = f"plant: the driver {driver!r} simulates nothing: remove this section"
            problems.append(ConfigProblem(document.place(("plant",)), message))
            del document.data["plant"]
            return
        document.data["plant"] = _validate(
            plant_schemas[driver], document, ("plant",), units, problems
        )


def _check_device_section(
    document: Document,
    axis_schemas: AxisSchemas,
    units: Units | None,
    problems: list[ConfigProblem],
) -> None:
    """Validate the axis of an operator's device, and put the model in its place."""
    operator = document.data.get("operator")
    rig = operator.get("rig") if isinstance(operator, dict) else None
    axis = rig.get("axis") if isinstance(rig, dict) else None
    if not isinstance(rig, dict) or not isinstance(axis, dict):
        return
    place = ("operator", "rig", "axis")
    schema = axis_schemas.get(str(axis.get("driver")))
    if schema is None:
        known = ", ".join(sorted(axis_schemas))
        message = f"operator.rig.axis.driver: {axis.get('driver')!r} is not one of: {known}"
        problems.append(ConfigProblem(document.place((*place, "driver")), message))
        del rig["axis"]
        return
    rig["axis"] = _validate(schema, document, place, units, problems)


def _validate(
    schema: type[Model],
    document: Document,
    path: KeyPath,
    units: Units | None,
    problems: list[ConfigProblem],
) -> Model | None:
    """Validate the data at `path`; problems go to the list, and None comes back."""
    data = document.data
    for key in path:
        data = data[key]
    try:
        return schema.model_validate(data, context={"units": units})
    except ValidationError as error:
        reported = {problem.where for problem in problems}
        details = error.errors()
        for detail in details:
            if follows_from_others(schema, units, detail, details):
                continue
            nested = detail["loc"] == ("plant",) or detail["loc"][-1:] == ("axis",)
            if not (nested and reported):
                problems += problems_of(schema, document, path, units, detail)
        return None


def dump(config: BaseModel, units: Units) -> Any:
    """Return a config as plain data with the keys of its file, every default filled in."""
    if not isinstance(config, Section):
        return config.model_dump(mode="json")
    quantities = config.quantities()
    plain: dict[str, Any] = {}
    for name in type(config).model_fields:
        key = quantities[name].key(name, units) if name in quantities else name
        plain[key] = _dump_value(getattr(config, name), units)
    return plain


def _dump_value(value: Any, units: Units) -> Any:
    if isinstance(value, BaseModel):
        return dump(value, units)
    if isinstance(value, list | tuple):
        return [_dump_value(item, units) for item in value]
    if isinstance(value, dict):
        return {key: _dump_value(item, units) for key, item in value.items()}
    return value
