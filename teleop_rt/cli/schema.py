"""The command that prints the JSON Schema of what this program reads and writes."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import Annotated, Any

import typer

from teleop_rt.config import PlantConfig
from teleop_rt.config_rig import AxisConfig
from teleop_rt.config_schema import Parts, schema_of, schema_of_rig, schema_of_trial
from teleop_rt.diagnosis.answer_keys import Answer, Problem
from teleop_rt.diagnosis.columns_file import ColumnsFile
from teleop_rt.json_schema import schema_of_json
from teleop_rt.trial.summary_keys import Summary
from teleop_rt_drivers.framed.format import BinaryFormat, TextFormat
from teleop_rt_drivers.registry import AXIS_SCHEMAS, PLANT_SCHEMAS


class SchemaName(StrEnum):
    """What has a schema: files that are read, and JSON that is printed."""

    TRIAL = "trial"
    RIG = "rig"
    COLUMNS = "columns"
    FORMAT = "format"
    ANSWER = "answer"
    SUMMARY = "summary"


def schema(
    name: Annotated[
        SchemaName, typer.Argument(help="trial, rig, columns, format, answer, summary")
    ],
) -> None:
    """Print the JSON Schema of a YAML file that is read, or of the JSON that is printed."""
    print(as_text(name), end="")


def as_text(name: SchemaName) -> str:
    """Return a schema as the text of its file."""
    return json.dumps(schema_named(name), indent=1, ensure_ascii=False) + "\n"


def schema_named(name: SchemaName) -> dict[str, Any]:
    """Return a schema by its name."""
    match name:
        case SchemaName.TRIAL:
            return schema_of_trial(_parts())
        case SchemaName.RIG:
            return schema_of_rig(_parts())
        case SchemaName.COLUMNS:
            return schema_of(ColumnsFile)
        case SchemaName.FORMAT:
            return schema_of(BinaryFormat, TextFormat)
        case SchemaName.ANSWER:
            return schema_of_json(Answer | Problem)
        case SchemaName.SUMMARY:
            return schema_of_json(Summary)


def _parts() -> Parts:
    """Return the sections that drivers extend, with all their kinds."""
    plants = dict.fromkeys(PLANT_SCHEMAS.values())
    return {AxisConfig: tuple(AXIS_SCHEMAS.values()), PlantConfig: tuple(plants)}
