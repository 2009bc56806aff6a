"""A group of commands that are imported when they are called; the help needs none of them."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from teleop_rt.cli.pairs import PairsCommand
from teleop_rt.interrupts import INTERRUPTED


@dataclass(frozen=True, slots=True)
class LazyCommand:
    """A command's place, `module:name`, the first paragraph of its help, and its panel there.

    The name is that of a function with typer's annotations, or of a group.
    """

    place: str
    help: str
    hidden: bool = False
    panel: str | None = None


class LazyGroup(TyperGroup):
    """Lists its commands from a table, and imports the one that is called."""

    def __init__(
        self, help_text: str, table: Mapping[str, LazyCommand], options: Sequence[Any] = ()
    ) -> None:
        """Make the group; `table` holds the commands by name, in the order of the help."""
        shown: dict[str, Any] = {
            name: TyperCommand(
                name, help=entry.help, hidden=entry.hidden, rich_help_panel=entry.panel
            )
            for name, entry in table.items()
        }
        super().__init__(
            name="teleop-rt",
            help=help_text,
            commands=shown,
            params=list(options),
            no_args_is_help=True,
        )
        _show_flags_plainly(self)
        self._table = table

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the name of the command that is called, the command itself, and its arguments."""
        name, shown, rest = super().resolve_command(ctx, args)
        return name, shown if name is None else self.load(name), rest

    def make_context(self, *args: Any, **more: Any) -> Any:
        """Parse the options of the group, or end with a line where an interrupt comes."""
        with _interrupt_is_said():
            return super().make_context(*args, **more)

    def invoke(self, ctx: Any) -> Any:
        """Run the command, or end with a line where an interrupt comes that it does not handle."""
        with _interrupt_is_said():
            return super().invoke(ctx)

    def load(self, name: str) -> Any:
        """Return a command of the table, imported."""
        entry = self._table[name]
        module, _, attribute = entry.place.partition(":")
        found = getattr(importlib.import_module(module), attribute)
        if not isinstance(found, TyperGroup):
            app = typer.Typer(add_completion=False)
            app.command(name, cls=PairsCommand, hidden=entry.hidden)(found)
            found = get_command(app)
        _show_flags_plainly(found)
        return found

    def load_all(self) -> dict[str, Any]:
        """Return all commands by name, imported: for who describes them whole."""
        return {name: self.load(name) for name in self._table}


@contextmanager
def _interrupt_is_said() -> Iterator[None]:
    """End with a line on standard error, and the exit code of it; typer would end silently."""
    try:
        yield
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None


def _show_flags_plainly(command: Any) -> None:
    """Show no type beside the flags of a command and of those below it: a flag takes no value."""
    for inner in getattr(command, "commands", {}).values():
        _show_flags_plainly(inner)
    with command.context_class(command) as context:
        for parameter in command.get_params(context):
            if getattr(parameter, "is_flag", False):
                parameter.metavar = ""
