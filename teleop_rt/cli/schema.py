"""The command that prints a JSON Schema: its arguments alone, which a shell completes at once."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class SchemaName(StrEnum):
    """Names of the schemas: files that are read, and JSON that is printed."""

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
    """Print the JSON Schema of an input file (YAML) or of a command's JSON output."""
    from teleop_rt.cli.schemas import as_text  # noqa: PLC0415 - loads drivers and compilers

    print(as_text(name), end="")
