"""A test asserts through a private name only where nothing public shows it, and says why."""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
PUBLIC = {"_repr_html_", "_replace", "_fields", "_asdict"}
"""Names that Jupyter and `namedtuple` declare as theirs."""


def is_private(node: ast.AST) -> bool:
    """Return whether an expression reads a private attribute of something else."""
    return (
        isinstance(node, ast.Attribute)
        and node.attr.startswith("_")
        and not node.attr.startswith("__")
        and node.attr not in PUBLIC
        and not (isinstance(node.value, ast.Name) and node.value.id in {"self", "cls"})
    )


def without_reason(text: str) -> list[str]:
    """Return the assertions through private names that have no comment in or above them."""
    lines = text.splitlines()
    found = []
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Assert) or not any(map(is_private, ast.walk(node))):
            continue
        around = lines[max(node.lineno - 2, 0) : node.end_lineno]
        if not any("  # " in line or line.lstrip().startswith("# ") for line in around):
            found.append(f"{node.lineno}: {lines[node.lineno - 1].strip()}")
    return found


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("assert axis._count == 3", 1),
        ("assert len(axis._peers) == 1  # memory: nothing public shows it", 0),
        ("# Nothing public shows it.\nassert axis._peers == []", 0),
        ("assert self._count == answer._repr_html_()", 0),
        ("axis._count = 3", 0),
    ],
)
def test_an_assertion_through_a_private_name_needs_a_reason(text, count):
    assert len(without_reason(text)) == count


def test_every_assertion_through_a_private_name_has_its_reason():
    found = {
        path.relative_to(TESTS).as_posix(): problems
        for path in sorted(TESTS.rglob("*.py"))
        if (problems := without_reason(path.read_text()))
    }
    assert not found
