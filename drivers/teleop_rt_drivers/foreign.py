"""Drivers of other packages, by the entry point `teleop_rt.drivers`.

A package names a `Driver` there; rigs then name it in `axis.driver`. One that cannot be loaded, or
that has a name of ours, is told where a rig names it, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from pydantic import ConfigDict, model_validator

from teleop_rt.axis import Axis
from teleop_rt.config_rig import AxisConfig, RigConfig

GROUP = "teleop_rt.drivers"

OpenAxis = Callable[[Any, RigConfig, Callable[[], int]], Axis]
"""Makes the axis of a rig: its `axis` section, the rig, and the clock [ns] of its stamps."""


@dataclass(frozen=True, slots=True)
class Driver:
    """What a package gives: the schema of a rig's `axis` section, and what opens such an axis."""

    schema: type[AxisConfig]
    open_axis: OpenAxis


def foreign_drivers(ours: set[str]) -> dict[str, Driver]:
    """Return the drivers of other packages by name; `ours` are names that are taken."""
    found: dict[str, Driver] = {}
    for point in entry_points(group=GROUP):
        if point.name in ours:
            continue
        found[point.name] = _load(point)
    return found


def _load(point: EntryPoint) -> Driver:
    try:
        driver = point.load()
    except Exception as error:  # noqa: BLE001 - whatever another's module raises
        return _unusable(point, f"{type(error).__name__}: {error}")
    if not isinstance(driver, Driver):
        return _unusable(point, f"{point.value} is no teleop_rt_drivers.foreign.Driver")
    return driver


def _unusable(point: EntryPoint, why: str) -> Driver:
    """Return a driver that refuses every rig that names it."""
    package = point.dist.name if point.dist is not None else point.value
    told = f"the driver {point.name!r} of the package {package} cannot be loaded: {why}"

    class Refused(AxisConfig):
        """The section of a driver that cannot be loaded."""

        model_config = ConfigDict(extra="allow")

        @model_validator(mode="before")
        @classmethod
        def _refuse(cls, _: object) -> object:
            raise ValueError(told)

    def open_axis(_: Any, __: RigConfig, ___: Callable[[], int]) -> Axis:
        raise AssertionError(told)

    return Driver(Refused, open_axis)
