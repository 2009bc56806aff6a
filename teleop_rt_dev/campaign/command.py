"""Run a campaign by its name: `teleop-rt-dev campaign NAME [options]`."""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path


def campaigns() -> dict[str, str]:
    """Return the first line about each campaign, by name: each other module of this folder."""
    return {
        file.stem: (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "")
        .partition("\n")[0]
        for file in sorted(Path(__file__).parent.glob("*.py"))
        if file.stem not in {"__init__", "command"}
    }  # fmt: skip


def main(arguments: Sequence[str]) -> int:
    """Run the campaign that the first argument names; the others are its own."""
    name, options = (arguments[0] if arguments else ""), list(arguments[1:])
    known = campaigns()
    if name in known:
        code: int = importlib.import_module(f"{__package__}.{name}").main(options)
        return code
    asked = name in {"-h", "--help"}
    out = sys.stdout if asked else sys.stderr
    print("usage: teleop-rt-dev campaign NAME [options]; NAME is one of:\n", file=out)
    print("\n".join(f"  {one:13} {meaning}" for one, meaning in known.items()), file=out)
    return 0 if asked else 2
