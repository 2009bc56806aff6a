"""Options of KEY=VALUE pairs that take several pairs after one flag."""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path
from typing import Any

from typer.core import TyperCommand, TyperOption


class PairsCommand(TyperCommand):
    """A command in which `--columns a=x b=y` reads as `--columns a=x --columns b=y`.

    This holds for every repeatable option whose metavar is a pair. A word that is an existing file
    stays an argument.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments, with the flag repeated before each further pair."""
        flags = {flag for parameter in self.params for flag in _flags_of_pairs(parameter)}
        expanded: list[str] = []
        place = 0
        while place < len(args):
            expanded.append(args[place])
            place += 1
            if expanded[-1] == "--":
                break
            if expanded[-1] in flags and place < len(args):
                more = list(takewhile(_is_pair, args[place + 1 :]))
                expanded += [args[place], *(word for pair in more for word in (expanded[-1], pair))]
                place += 1 + len(more)
        return list(super().parse_args(ctx, [*expanded, *args[place:]]))


def _flags_of_pairs(parameter: Any) -> list[str]:
    pairs = isinstance(parameter, TyperOption) and parameter.multiple
    return parameter.opts if pairs and "=" in str(parameter.metavar) else []


def _is_pair(word: str) -> bool:
    return "=" in word and not word.startswith("-") and not Path(word).exists()
