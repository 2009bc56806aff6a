"""Drivers of other packages, by the entry point `teleop_rt.drivers`.

A package names a `Driver` there; rigs then name it in `axis.driver`. A driver that cannot be
loaded, or whose name is taken, is reported only when a rig names it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from pydantic import ConfigDict, model_validator

from teleop_rt.axis import Axis
from teleop_rt.config.rig import AxisConfig, RigConfig
from teleop_rt_drivers.in_words import of_a_signal

GROUP = "teleop_rt.drivers"

OpenAxis = Callable[[Any, RigConfig, Callable[[], int]], Axis]
"""Makes the axis of a rig: its `axis` section, the rig, and the clock [ns] of its stamps."""


@dataclass(frozen=True, slots=True)
class Driver:
    """A package's driver: the schema of a rig's `axis` section, and the function that opens it."""

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
    except BaseException as error:
        if of_a_signal(error):
            raise
        return _unusable(point, f"{type(error).__name__}: {error}")
    if not isinstance(driver, Driver):
        return _unusable(point, f"{point.value} is no teleop_rt_drivers.foreign.Driver")
    return driver


def _unusable(point: EntryPoint, why: str) -> Driver:
    """Return a driver that refuses every rig that names it."""
    package = point.dist.name if point.dist is not None else point.value
    problem = f"the driver {point.name!r} of the package {package} cannot be loaded: {why}"

    class Refused(AxisConfig):
        """The section of a driver that cannot be loaded."""

        model_config = ConfigDict(extra="allow")

        @model_validator(mode="before")
        @classmethod
        def _refuse(cls, _: object) -> object:
            raise ValueError(problem)

    def open_axis(_: Any, __: RigConfig, ___: Callable[[], int]) -> Axis:
        raise AssertionError(problem)

    return Driver(Refused, open_axis)
