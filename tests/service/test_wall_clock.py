"""Nothing that decides about motion asks the wall clock, which anybody's time server may set."""

import ast
from pathlib import Path

import pytest

import teleop_rt

PACKAGE = Path(teleop_rt.__file__).parent
DECIDING = ("link", "master", "service", "slave", "realtime")
WALL = {"time", "time_ns", "now", "utcnow", "today", "CLOCK_REALTIME", "gmtime", "localtime"}


def wall_clock_of(source: str) -> list[str]:
    """Return a source's names from the modules time and datetime that a jump changes."""
    return [
        f"line {node.lineno}: {node.attr}"
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Attribute)
        and node.attr in WALL
        and isinstance(node.value, ast.Name)
        and node.value.id in {"time", "datetime", "date"}
    ]


@pytest.mark.parametrize("part", DECIDING)
def test_a_jump_of_the_wall_clock_reaches_no_decision(part):
    files = sorted((PACKAGE / part).rglob("*.py"))
    assert len(files) > 5
    assert {str(one): found for one in files if (found := wall_clock_of(one.read_text()))} == {}


def test_a_use_of_the_wall_clock_is_found():
    source = "import time\nsince = time.time()\nlater = time.monotonic_ns()\n"
    assert wall_clock_of(source) == ["line 2: time"]
