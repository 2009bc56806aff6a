"""The command that copies a trial and its rig, to start from."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from teleop_rt.outputs import refuse_existing, unwritable, whole_or_nothing, write_whole
from teleop_rt.shipped import EXAMPLES, describe, example, example_names

DEFAULT = "silicone_cube"
_SCHEMA = re.compile(r"\$schema=\.\./schema/([\w.]+)")
"""The line by which an editor finds the schema of a file; the schema is copied, too."""
_RIG = re.compile(r"\.\./rigs/(\w+)\.yaml")
"""The line by which a shipped trial names its rig; a copy keeps both folders."""


def new(
    folder: Annotated[Path, typer.Argument(help="folder to copy to; created if needed")],
    trial: Annotated[
        str | None,
        typer.Option(
            help=f"trial to copy: {', '.join(example_names('trials'))}; "
            f"asked for on a terminal, else {DEFAULT}",
            metavar="NAME",
        ),
    ] = None,
    rig: Annotated[
        str | None,
        typer.Option(
            help=f"rig to copy with it: {', '.join(example_names('rigs'))}; "
            "asked for on a terminal, else the trial's own",
            metavar="NAME",
        ),
    ] = None,
) -> None:
    """Copy a trial and its rig into a folder, to start from."""
    asks = sys.stdin.isatty() and sys.stdout.isatty()
    if trial is None:
        trial = _ask("trials", DEFAULT) if asks else DEFAULT
    source = example("trials", trial)
    text = source.read_text(encoding="utf-8")
    own = _RIG.findall(text)[0]
    if rig is None:
        rig = _ask("rigs", own) if asks else own
    text = text.replace(f"../rigs/{own}.yaml", f"../rigs/{example('rigs', rig).name}")
    files = {folder / "trials" / source.name: text}
    for name in _RIG.findall(text):
        named = example("rigs", name)
        files[folder / "rigs" / named.name] = named.read_text(encoding="utf-8")
    for name in sorted({name for text in files.values() for name in _SCHEMA.findall(text)}):
        files[folder / "schema" / name] = (EXAMPLES / "schema" / name).read_text(encoding="utf-8")
    _write(files, folder)
    print(*files, sep="\n")
    print(f"next: teleop-rt check {next(iter(files))}, then run it")


def _ask(kind: str, default: str) -> str:
    """Ask which example of a kind to copy."""
    for name in example_names(kind):
        print(f"  {name:24} {describe(example(kind, name))}")
    answer: str = typer.prompt(f"which of these {kind}", default=default)
    return answer.strip()


def _write(files: Mapping[Path, str], folder: Path) -> None:
    """Write files below a folder that are not there yet, or none of them. Raises OutputError.

    A file that exists with the same text is kept: a second trial shares its rig with the first.
    """
    missing = {path: text for path, text in files.items() if not _stands(path, text)}
    refuse_existing(missing or files, "name another folder")
    with whole_or_nothing(folder):
        for path, text in missing.items():
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(path, text)
            except OSError as error:
                raise unwritable(path, error, "name another folder") from None


def _stands(path: Path, text: str) -> bool:
    """Return whether a file is there with this text, and nothing else."""
    return path.is_file() and path.read_bytes() == text.encode()
