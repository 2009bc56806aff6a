"""Write the JSON Schemas that the shipped YAML files name, after a change of keys."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from teleop_rt.cli.schema import SchemaName
from teleop_rt.cli.schemas import as_text
from teleop_rt_dev.paths import CONFIG, ROOT

FORMATS = ROOT / "drivers" / "teleop_rt_drivers" / "formats"
FILES = {
    SchemaName.TRIAL: CONFIG / "schema" / "trial.schema.json",
    SchemaName.RIG: CONFIG / "schema" / "rig.schema.json",
    SchemaName.COLUMNS: CONFIG / "schema" / "columns.schema.json",
    SchemaName.FORMAT: FORMATS / "format.schema.json",
}


def main(arguments: Sequence[str]) -> int:
    """Write each schema to its file."""
    argparse.ArgumentParser(prog="teleop-rt-dev schemas", description=__doc__).parse_args(arguments)
    for name, file in FILES.items():
        file.write_text(as_text(name), encoding="utf-8")
    return 0
