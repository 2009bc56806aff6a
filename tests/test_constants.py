"""Each numeric constant of a module has a word: its unit, meaning or source, and why that size."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("teleop_rt", "drivers/teleop_rt_drivers")
NAMED_BY_UNIT = {"NS_PER_MS", "NS_PER_S"}
"""Their names say all."""


def is_number(node):
    if isinstance(node, ast.UnaryOp):
        node = node.operand
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def constant(node):
    """Return the first name of an assignment to constants, None for another statement."""
    if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
        return None
    target = node.targets[0] if isinstance(node, ast.Assign) else node.target
    names = target.elts if isinstance(target, ast.Tuple) else [target]
    first = getattr(names[0], "id", "")
    return first if first.strip("_").isupper() else None


def numeric(node):
    """Return whether a statement gives numbers to constants."""
    if constant(node) is None:
        return False
    values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
    return all(map(is_number, values))


def headed(lines, body, place):
    """Return whether a comment stands above this row of numbers, without a blank line between."""
    first = body[place].lineno
    for before in reversed(body[:place]):
        if not numeric(before) or before.end_lineno != first - 1:
            break
        first = before.lineno
    return first > 1 and lines[first - 2].startswith("#")


def documented(body, place):
    """Return whether a docstring stands below this row of numbers."""
    for before, after in zip(body[place:], body[place + 1 :], strict=False):
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            return True
        if not numeric(after) or after.lineno != before.end_lineno + 1:
            break
    return False


def bare(source):
    """Return (line, name) of each numeric constant without a comment or a docstring.

    A comment above heads a row of numbers up to the next blank line or other statement; a
    docstring below belongs to all numbers directly above it.
    """
    lines, body = source.splitlines(), ast.parse(source).body
    return [
        (node.lineno, constant(node))
        for place, node in enumerate(body)
        if numeric(node)
        and constant(node) not in NAMED_BY_UNIT
        and "#" not in lines[node.end_lineno - 1]
        and not headed(lines, body, place)
        and not documented(body, place)
    ]


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("A = 3\n", ["A"]),
        ("x = f(1)\n_B, C = 0x10, -2.0\n\n", ["_B"]),
        ("# Registers.\nA = 3\nB = 4\n\nC = 5\n", ["C"]),
        ('A = 3\n"""Samples."""\nB = 4  # s\n', []),
        ("# A table.\nx = f(1)\nA = 3\n", ["A"]),
        ("A = 3\nB = 4  # s\n", ["A"]),
        ("NAME = 'x'\nlower = 3\nON = True\n", []),
    ],
)
def test_a_constant_without_a_word_is_found(source, names):
    assert [name for _, name in bare(source)] == names


@pytest.mark.parametrize("package", PACKAGES)
def test_each_numeric_constant_has_a_word(package):
    found = [
        f"{path.relative_to(ROOT)}:{line}: {name}: give unit and meaning, and why this size"
        for path in sorted((ROOT / package).rglob("*.py"))
        if not path.is_symlink()
        for line, name in bare(path.read_text(encoding="utf-8"))
    ]
    assert not found, "\n".join(found)
