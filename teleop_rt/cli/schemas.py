"""The JSON Schemas of the files and answers that this program reads and writes."""

from __future__ import annotations

import json
from typing import Any

from teleop_rt.cli.schema import SchemaName
from teleop_rt.config.rig import AxisConfig
from teleop_rt.config.schema import Parts, schema_of, schema_of_rig, schema_of_trial
from teleop_rt.config.trial import PlantConfig
from teleop_rt.diagnosis.answers.answer_keys import Answer, Problem
from teleop_rt.json_schema import schema_of_json
from teleop_rt.recordings.columns_file import ColumnsFile
from teleop_rt.trial.summary_keys import Summary
from teleop_rt_drivers.framed.format import BinaryFormat, TextFormat
from teleop_rt_drivers.registry import AXIS_SCHEMAS, PLANT_SCHEMAS


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
