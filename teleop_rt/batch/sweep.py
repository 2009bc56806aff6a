"""Run many cases, keep each result at once, and resume where a run was interrupted."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from teleop_rt import __version__
from teleop_rt.batch.workers import Case, Evaluate, Result, Workers
from teleop_rt.outputs import OutputError, naming, refuse_file
from teleop_rt.trial.folder import plain_json, write_json

Progress = Callable[[int, int], None]
Lasts = Callable[[Case, Result], bool]
CASES, ABOUT = "cases.jsonl", "about.json"


def key_of(case: Case) -> str:
    """Return the unique text that identifies a case."""
    return json.dumps(case, sort_keys=True, allow_nan=False)


def open_folder(folder: Path, command: str, options: Mapping[str, Any] | None = None) -> Path:
    """Make the folder of a command's results, or resume one of the same command and version.

    `options` are those on which all its results depend: with others nothing is resumed.

    Raises OutputError for a folder that holds anything else.
    """
    about = {"command": command, "version": __version__}
    about |= {} if options is None else {"options": plain_json(options)}
    note = folder / ABOUT
    refuse_file(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if note.is_file() and json.loads(note.read_text(encoding="utf-8")) == about:
            return folder
        if any(folder.iterdir()):
            with_these = "" if options is None else " with these options"
            raise OutputError(
                f"{folder}: holds something other than `{command}` of version {__version__}"
                f"{with_these}: name another folder with --out"
            )
    except (OSError, ValueError) as error:
        raise OutputError(
            f"{folder}: cannot be used: {error}: name another folder with --out"
        ) from None
    write_json(note, about)
    return folder


def finished(path: Path) -> dict[str, Result]:
    """Return the results of finished cases by their key; a last line cut off is left out."""
    found: dict[str, Result] = {}
    if not path.is_file():
        return found
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        found[key_of(entry["case"])] = entry["result"]
    return found


def sweep(
    folder: Path, evaluate: Evaluate, cases: Sequence[Case], workers: Workers, progress: Progress
) -> list[Result]:
    """Run the cases that a folder lacks, and return the results of all in their order."""
    return list(in_order(folder / CASES, evaluate, cases, workers, progress))


def in_order(
    path: Path | None,
    evaluate: Evaluate,
    cases: Sequence[Case],
    workers: Workers,
    progress: Progress,
    lasts: Lasts = lambda _case, _result: True,
) -> Iterator[Result]:
    """Run the cases that `path` lacks; yield the results of all in their order, as they come.

    A case holds all that its result depends on, the seed included; each result that `lasts` is at
    once a line of `path`, which may be None, and is used by the next call while it still does.
    `progress` gets how many cases are done, of how many.
    """
    found = {} if path is None else finished(path)
    keys = [key_of(case) for case in cases]
    found = {
        key: found[key]
        for key, case in zip(keys, cases, strict=True)
        if key in found and lasts(case, found[key])
    }
    missing = [case for key, case in zip(keys, cases, strict=True) if key not in found]
    progress(len(cases) - len(missing), len(cases))
    yielded = 0
    for case, result in workers.run(evaluate, missing) if missing else ():
        plain: Result = plain_json(result)
        unkept = _unkept(path, case, plain) if path is not None and lasts(case, plain) else None
        found[key_of(case)] = plain
        progress(sum(key in found for key in keys), len(cases))
        while yielded < len(keys) and keys[yielded] in found:
            yield found[keys[yielded]]
            yielded += 1
        if unkept is not None:  # the results themselves are not lost
            yield from (found[key] for key in keys[yielded:] if key in found)
            raise unkept
    yield from (found[key] for key in keys[yielded:])


def _unkept(path: Path, case: Case, result: Result) -> OSError | None:
    """Write a line; return the error, which names the file, where it cannot be written."""
    try:
        with naming(path):
            _append(path, case, result)
    except OSError as error:
        return error
    return None


def _append(path: Path, case: Case, result: Result) -> None:
    """Write a line; after a line that was cut off, a new one."""
    with path.open("ab+") as file:
        if file.tell():
            file.seek(-1, 2)
            if file.read(1) != b"\n":
                file.write(b"\n")
        line = json.dumps({"case": case, "result": result}, allow_nan=False) + "\n"
        file.write(line.encode())
