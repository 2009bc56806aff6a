"""Draw the path from the command `run` to a tick, and the order of packages, into CONTRIBUTING.md.

Each line of the path is a function, its file and the first sentence of its docstring. Raises
SystemExit where a function no longer mentions the one that follows: then PATH below is corrected.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise
from typing import NamedTuple

from teleop_rt_dev.path.order import order
from teleop_rt_dev.paths import ROOT

CONTRIBUTING = ROOT / "CONTRIBUTING.md"
BEGIN, END = "<!-- path -->\n", "<!-- end of path -->\n"
ORDER_BEGIN, ORDER_END = "<!-- order -->\n", "<!-- end of order -->\n"

Function = ast.FunctionDef | ast.AsyncFunctionDef


class Step(NamedTuple):
    """A function on the path: `name` may be Class.method."""

    file: str
    name: str


PATH = (
    Step("cli/running.py", "run"),
    Step("cli/whole_run.py", "run_and_print"),
    Step("cli/whole_run.py", "_run"),
    Step("trial/run_processes.py", "run_processes"),
    Step("cli/side_mains.py", "run_side"),
    Step("cli/side_mains.py", "_serve"),
    Step("trial/process_main.py", "slave_main"),
    Step("service/daemon.py", "Daemon.run"),
    Step("service/daemon.py", "Daemon.serve"),
    Step("service/daemon.py", "Daemon.cycle"),
    Step("slave/slave.py", "Slave.cycle"),
)
"""From the command line to the tick; the last step is shown with its phases."""


@cache
def _functions(file: str) -> dict[str, Function]:
    """Return the functions of a module of the package by name, methods as Class.method."""
    tree = ast.parse((ROOT / "teleop_rt" / file).read_text(encoding="utf-8"))
    found: dict[str, Function] = {}
    for node in tree.body:
        if isinstance(node, Function):
            found[node.name] = node
        if isinstance(node, ast.ClassDef):
            methods = (one for one in node.body if isinstance(one, Function))
            found |= {f"{node.name}.{one.name}": one for one in methods}
    return found


def _mentioned(function: Function) -> Iterator[str]:
    """Yield every name and attribute in a function, in the order of the text."""
    named = (node for node in ast.walk(function) if isinstance(node, ast.Name | ast.Attribute))
    for node in sorted(named, key=lambda node: (node.lineno, node.col_offset)):
        yield node.id if isinstance(node, ast.Name) else node.attr


def _function(step: Step) -> Function:
    try:
        return _functions(step.file)[step.name]
    except (KeyError, FileNotFoundError):
        raise SystemExit(f"teleop_rt/{step.file} has no {step.name}: correct PATH") from None


def _summary(function: Function) -> str:
    """Return the first sentence of a docstring."""
    text = (ast.get_docstring(function) or "").partition("\n")[0]
    return text.partition("; ")[0].partition(": ")[0].rstrip(".")


def _phases(step: Step) -> list[str]:
    """Return the methods of its own object that a method calls, each once, in order."""
    calls = [one.func for one in ast.walk(_function(step)) if isinstance(one, ast.Call)]
    own = [
        one
        for one in calls
        if isinstance(one, ast.Attribute)
        and isinstance(one.value, ast.Name)
        and one.value.id == "self"
    ]
    own.sort(key=lambda one: (one.lineno, one.col_offset))
    return list(dict.fromkeys(one.attr for one in own))


def picture() -> str:
    """Return the path as lines of text, each step a little further in than the one before."""
    for step, following in pairwise(PATH):
        if following.name.rpartition(".")[2] not in _mentioned(_function(step)):
            raise SystemExit(
                f"teleop_rt/{step.file}: {step.name} no longer leads to {following.name}:"
                " correct PATH"
            )
    drawn = [(f"{' ' * depth}{step.name}", step.file, _summary(_function(step)))
             for depth, step in enumerate(PATH)]  # fmt: skip
    name, file, meaning = drawn[-1]
    drawn[-1] = (name, file, f"{meaning}: {', '.join(_phases(PATH[-1]))}")
    width = [max(len(line[column]) for line in drawn) for column in (0, 1)]
    return "\n".join(
        f"    {name:{width[0]}}  {file:{width[1]}}  {meaning}".rstrip()
        for name, file, meaning in drawn
    )


def drawn(text: str) -> str:
    """Return a text with both pictures in their places."""
    for begin, drawing, end in ((BEGIN, picture(), END), (ORDER_BEGIN, order(), ORDER_END)):
        before, _, rest = text.partition(begin)
        text = f"{before}{begin}\n{drawing}\n\n{end}{rest.partition(end)[2]}"
    return text


def main(arguments: Sequence[str]) -> int:
    """Print the path, and write both pictures into CONTRIBUTING.md."""
    argparse.ArgumentParser(prog="teleop-rt-dev path", description=__doc__).parse_args(arguments)
    text = CONTRIBUTING.read_text(encoding="utf-8")
    CONTRIBUTING.write_text(drawn(text), encoding="utf-8")
    print(f"{picture()}\n\nfiles below teleop_rt/; also written into {CONTRIBUTING.name}")
    return 0
