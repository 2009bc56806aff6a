"""NAME.columns.yaml beside a recording: which column plays which role, in which unit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, ValidationInfo, WithJsonSchema, field_validator

from teleop_rt.config.problems import problem_of
from teleop_rt.config.section import MOST, Section
from teleop_rt.config.yaml_file import ConfigError, Document, read_yaml
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.units import UNITS, factor_of

_FACTOR = r"^[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?$"


def _units_of(role: str) -> WithJsonSchema:
    """Return the schema of the unit of one role: a name that is known, or a factor."""
    return WithJsonSchema({"anyOf": [
        {"type": "string", "enum": list(UNITS[role])},
        {"type": "string", "pattern": _FACTOR},
        {"type": "number", "minimum": -MOST, "maximum": MOST},
        {"type": "null"},
    ]})  # fmt: skip


class Roles(Section):
    """Values by role."""

    def given(self) -> dict[str, Any]:
        """Return the roles that are given."""
        return self.model_dump(exclude_none=True)


class ColumnNames(Roles):
    """Which column plays which role; a minus before a name turns the column's sign."""

    time: str | None = Field(None, description="Column with time; without it give rate_hz.")
    position: str | None = Field(
        None, description="Column with position; it must rise towards the environment."
    )
    force: str | None = Field(
        None, description="Column with force; it must be positive when the tool presses."
    )
    velocity: str | None = Field(
        None, description="Column with a measured velocity; accepted, not used."
    )
    reference: str | None = Field(
        None, description="Column with the commanded position, by which parameters are checked."
    )
    surface: str | None = Field(None, description="Column with the surface's position, if known.")


class ColumnUnits(Roles):
    """Units of the columns, by name or as the factor to SI; else they are read from the header."""

    time: Annotated[str | float | None, _units_of("time")] = Field(
        None, description="Unit of time: s, ms, us, ns, min, or seconds per unit."
    )
    position: Annotated[str | float | None, _units_of("position")] = Field(
        None, description="Unit of position: m, mm, um, rad, deg, ..., or m (rad) per unit."
    )
    force: Annotated[str | float | None, _units_of("force")] = Field(
        None, description="Unit of force: N, mN, Nm, ..., or N (Nm) per unit."
    )
    velocity: Annotated[str | float | None, _units_of("velocity")] = Field(
        None, description="Unit of velocity: m/s, mm/s, deg/s, ..., or m/s (rad/s) per unit."
    )
    reference: Annotated[str | float | None, _units_of("reference")] = Field(
        None, description="Unit of the commanded position, as of position."
    )
    surface: Annotated[str | float | None, _units_of("surface")] = Field(
        None, description="Unit of the surface's position, as of position."
    )

    @field_validator("*")
    @classmethod
    def _known(cls, unit: str | float | None, of: ValidationInfo) -> str | float | None:
        if unit is not None:
            factor_of(str(of.field_name), unit)
        return unit


class ColumnsFile(Section):
    """How a table is laid out: NAME.columns.yaml beside NAME.csv, NAME.mat or NAME.npz."""

    columns: ColumnNames = Field(ColumnNames(), description="Which column plays which role.")
    units: ColumnUnits = Field(ColumnUnits(), description="Units of the columns.")
    rate_hz: float | None = Field(
        None, gt=0, le=1e9, description="Samples per second, where there is no column with time."
    )
    valid: str | None = Field(
        None,
        description="Column that is 0 where a sample is missing; one with an old time is, too.",
    )
    surface: float | None = Field(
        None,
        ge=-MOST,
        le=MOST,
        description="Position of the surface as the position column has it, where it is known.",
    )
    surface_deviation: float = Field(
        0.0,
        ge=0,
        le=MOST,
        description=(
            "Standard deviation of the surface, in the unit of the position column; those of "
            "`identify` and `replay` contain it."
        ),
    )
    force_lag_ms: float = Field(
        0.0,
        ge=-1000,
        le=1000,
        description="How late the force is known to come after the position; it is taken out.",
    )
    force_lag_deviation_ms: float = Field(
        0.0,
        ge=0,
        le=1000,
        description="Standard deviation of that lag; those of `identify` and `replay` contain it.",
    )


def load_columns(path: Path) -> ColumnsFile:
    """Return the layout in a file. Raises RecordingError with every problem in it."""
    try:
        document: Document = read_yaml(path)
        return ColumnsFile.model_validate(document.data)
    except ConfigError as error:
        raise RecordingError(str(error)) from None
    except ValidationError as error:
        problems = [problem_of(ColumnsFile, document, (), None, d) for d in error.errors()]
        raise RecordingError("\n".join(map(str, problems))) from None
