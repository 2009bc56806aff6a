"""A group of commands that are imported when they are called; the help needs none of them."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from teleop_rt.cli.pairs import PairsCommand


@dataclass(frozen=True, slots=True)
class LazyCommand:
    """Where a command is, `module:name`, and the first paragraph of its help.

    The name is that of a function with typer's annotations, or of a group.
    """

    place: str
    help: str
    hidden: bool = False


class LazyGroup(TyperGroup):
    """Lists its commands from a table, and imports the one that is called."""

    def __init__(self, help_text: str, table: Mapping[str, LazyCommand]) -> None:
        """Make the group; `table` holds the commands by name, in the order of the help."""
        shown: dict[str, Any] = {
            name: TyperCommand(name, help=entry.help, hidden=entry.hidden)
            for name, entry in table.items()
        }
        super().__init__(name="teleop-rt", help=help_text, commands=shown, no_args_is_help=True)
        self._table = table

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the name of the command that is called, the command itself, and its arguments."""
        name, shown, rest = super().resolve_command(ctx, args)
        return name, shown if name is None else self.load(name), rest

    def load(self, name: str) -> Any:
        """Return a command of the table, imported."""
        entry = self._table[name]
        module, _, attribute = entry.place.partition(":")
        found = getattr(importlib.import_module(module), attribute)
        if isinstance(found, TyperGroup):
            return found
        app = typer.Typer(add_completion=False)
        app.command(name, cls=PairsCommand, hidden=entry.hidden)(found)
        return get_command(app)

    def load_all(self) -> dict[str, Any]:
        """Return all commands by name, imported: for who describes them whole."""
        return {name: self.load(name) for name in self._table}
